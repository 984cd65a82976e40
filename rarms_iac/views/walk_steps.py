"""The sentences of `rarms explain COMPONENT`, step by step; each says something, if only that there is nothing."""

from collections.abc import Iterator
from fractions import Fraction

from rarms_iac.model.indexes import find_index
from rarms_iac.model.quantities import guaranteed, in_processors, show_bytes, show_percent, show_processors
from rarms_iac.model.system import AtMost, Component, Threshold
from rarms_iac.model.thresholds import show_threshold, show_value
from rarms_iac.statistics.curve import Point, holds
from rarms_iac.statistics.told_errors import wrong
from rarms_iac.views.placement import placement_says
from rarms_iac.views.walk import HostWalk, Looked, Measured, Step, Walk


def steps_of(walk: Walk | HostWalk) -> tuple[Step, ...]:
    """The steps in order."""
    made = _on_the_host(walk) if isinstance(walk, HostWalk) else _in_a_partition(walk)
    steps = ((topic, tuple(says)) for topic, says in made)
    return tuple(Step(topic=topic, says=says) for topic, says in steps if says)


def _in_a_partition(walk: Walk) -> Iterator[tuple[str, Iterator[str]]]:
    yield "APT", _apt(walk)
    yield "data log", _data_log(walk)
    yield "setting and verdict", _verdicts(walk)
    yield "reservation", _reservation(walk)
    yield "rounding", _rounding(walk)
    yield "partition", _partition(walk)
    yield "host", _host(walk)
    yield "limit and weight", _leftover(walk)
    yield "rejected", _rejected(walk)
    yield "no layout", iter(walk.misfit)


def _on_the_host(walk: HostWalk) -> Iterator[tuple[str, Iterator[str]]]:
    one, name = walk.component, walk.component.name
    hosts = ", ".join(host.name for host in walk.hosts) or "no host of the manifest"
    task = f"robotic task class {one.task}: `rarms plan` shows its values" if one.task else "no robotic task class"
    kept = [
        f"{host.name} keeps {show_processors(in_processors(host.keep_for_host.processor, host.logical_processors))}"
        for host in walk.hosts
    ]
    yield "APT", _thresholds(one, "")
    yield "data log", iter(["none: rarms measures what runs in partitions"])
    yield "setting and verdict", iter([f"not measured: {name} runs on the host itself (`runs_on: host`)"])
    yield "reservation", iter(["none: only partitions have one; `keep_for_host` is for all that runs outside", *kept])
    yield "rounding", iter(["none: nothing is reserved"])
    yield "partition", iter(["none: it is combined with nobody"])
    yield "host", iter([f"wherever it is started: {hosts}"])
    yield "limit and weight", iter(["none: both are of partitions", task])
    yield "rejected", iter(["nothing: nothing is placed, combined or measured"])


def _apt(walk: Walk) -> Iterator[str]:
    for one in sorted(walk.group.members, key=lambda each: each is not walk.component):
        if one is walk.component:
            yield from _thresholds(one, "")
        elif one.apt:
            yield from _thresholds(one, f"{one.name}, in the same partition: ")


def _thresholds(one: Component, whose: str) -> Iterator[str]:
    for name, threshold in one.apt.items():
        yield f"{whose}{name} {_shown(name, threshold)}"
    if not one.apt:
        yield f"{one.name} has none: nothing says how well it must do"


def _shown(name: str, threshold: Threshold) -> str:
    index = find_index(name)
    assert index is not None, "a manifest's APT names indexes that there are"
    return show_threshold(index, threshold)


def _data_log(walk: Walk) -> Iterator[str]:
    log = walk.measured
    if walk.fixed_by:
        yield f"none is needed: {walk.fixed_by} fixes the reserve"
    elif log is not None:
        yield from _log(log)
    elif walk.wanted is None:
        yield f"none that holds: {walk.cannot}"
    else:
        yield "none is needed: nothing is reserved"


def _log(log: Measured) -> Iterator[str]:
    when = log.first if log.first == log.last else f"{log.first} to {log.last}"
    yield f"{log.path}, {_settings(len(log.reserves))}, measured {when}"
    smt = "with SMT" if log.smt else "without SMT"
    build = f", build {log.os_build}" if log.os_build else ""
    yield (
        f"bench: {log.provider}, {log.processor or 'no processor model'}, "
        f"{show_processors(log.logical_processors)} {smt}, scheduler {log.scheduler.value}{build}; "
        f"against {log.interference}"
    )


def _settings(number: int) -> str:
    return "one setting" if number == 1 else f"{number} settings"


def _verdicts(walk: Walk) -> Iterator[str]:
    if walk.measured is None:
        yield _why_not_measured(walk)
        yield from walk.remarks
        return
    at = walk.least.reserve if walk.least is not None else max(walk.measured.reserves, default=0)
    for one in walk.looked:
        point = one.curve.value_at(at)
        if point is not None:
            yield _verdict(walk, one, point, at)
    if untold := sorted({each for one in walk.looked for each in one.curve.untold}):
        yield f"measured without a verdict (no steady state, or too few answers): {_listed(untold)}"
    if walk.least is not None and walk.least.interpolated:
        below = max((one for one in walk.measured.reserves if one < walk.least.reserve), default=None)
        above = min((one for one in walk.measured.reserves if one > walk.least.reserve), default=None)
        yield (
            f"looked up on the curve between the settings at {below} % and {above} %, not measured itself: "
            f"`{walk.measured.again} --verify` measures it"
        )
    yield from walk.remarks


def _why_not_measured(walk: Walk) -> str:
    if walk.wanted is None:
        return "not measured: there is no data log that holds"
    if walk.fixed_by:
        met = "nothing says whether its APT is met" if any(one.apt for one in walk.group.members) else "no APT asks"
        return f"not measured: the reserve is fixed, and {met}"
    return "not measured: nothing is reserved, and no APT asks"


def _verdict(walk: Walk, one: Looked, point: Point, at: int) -> str:
    seen = (
        f"at {at} %: {_name(walk, one)} {_value(one, point.value)}, "
        f"between {_value(one, point.lower)} and {_value(one, point.upper)} "
        f"(the truth lies outside in at most {_percent(one.curve.error)} of cases{_samples(one, point)})"
    )
    if holds(one.curve, one.threshold, at):
        return f"{seen}: met, as the safe side of that is {_beside(one)}; {wrong(one.curve.error / 2)}"
    return f"{seen}: not met for sure, as the safe side of that is not {_beside(one)}"


def _listed(reserves: list[int]) -> str:
    return ", ".join(f"{one} %" for one in reserves)


def _name(walk: Walk, one: Looked) -> str:
    return one.index if one.member == walk.component.name else f"{one.index} of {one.member}"


def _samples(one: Looked, point: Point) -> str:
    found = [
        made.samples
        for at, made in zip(one.curve.points, one.curve.estimates, strict=True)
        if at.reserve == point.reserve
    ]
    return f", {found[0]} samples" if found else ""


def _beside(one: Looked) -> str:
    return _shown(one.index, one.threshold)


def _value(one: Looked, value: float) -> str:
    index = find_index(one.index)
    assert index is not None, "a curve is of an index that there is"
    if value in (float("inf"), float("-inf")):
        return "no bound"
    return show_value(index, Fraction(str(round(value, 1))))


def _percent(error: float) -> str:
    return show_percent(Fraction(error).limit_denominator(10_000) * 100)


def _reservation(walk: Walk) -> Iterator[str]:
    whole = walk.host.logical_processors
    if walk.wanted is None:
        yield f"not known: {_what_is_missing(walk)}"
        return
    if walk.least is not None and walk.measured is not None:
        yield (
            f"CR {walk.least.reserve} %: the least whole per cent of P1's "
            f"{_virtual(walk.measured.processors)} at which every APT of the partition is seen to hold"
        )
    elif not walk.wanted:
        yield "none: nothing asks for one"
        return
    else:
        yield f"as {walk.fixed_by} fixes it"
    yield f"{show_processors(walk.wanted)}, {show_percent(100 * walk.wanted / whole)} of {walk.host.name}"


def _what_is_missing(walk: Walk) -> str:
    return "no setting that was measured is enough" if walk.measured is not None else "not measured"


def _rounding(walk: Walk) -> Iterator[str]:
    placed = walk.placed
    if walk.wanted is None or walk.cannot:
        yield "none: " + (walk.cannot if walk.wanted is not None else "there is no reservation to round yet")
        return
    if not placed.reserve:
        yield "none: nothing is reserved"
        return
    lost = guaranteed(placed.reserve, placed.processors) - walk.wanted
    grain = f"{placed.reserve} % of each of its {_virtual(placed.processors)} (whole per cent are the provider's grain)"
    if placed.processors == 1:
        grain = f"{placed.reserve} % of its virtual processor (whole per cent are the provider's grain)"
    yield f"{grain}: {show_processors(placed.reserved)}, " + (
        f"rounded up by {show_processors(lost)}" if lost else "nothing is lost"
    )


def _virtual(processors: int) -> str:
    return "one virtual processor" if processors == 1 else f"{processors} virtual processors"


def _partition(walk: Walk) -> Iterator[str]:
    others = [one for one in walk.group.members if one is not walk.component]
    if not others:
        yield f"{walk.placed.name}: {walk.component.name} is alone, as nothing asks to combine it"
    else:
        names = ", ".join(f"{one.name} (criticality {one.criticality})" for one in others)
        yield f"{walk.placed.name}: {walk.component.name} is combined with {names}"
        yield from walk.why_together
    yield f"memory {show_bytes(walk.placed.memory)}, {_virtual(walk.placed.processors)}"


def _host(walk: Walk) -> Iterator[str]:
    whole = Fraction(walk.host.logical_processors)

    def share(processors: Fraction) -> str:
        return f"{show_processors(processors)} ({show_percent(100 * processors / whole)})"

    if walk.cannot:
        known = "once its reservation is known" if walk.wanted is None else "if it could be there"
        yield f"{walk.host.name}, {known}: it has {show_processors(whole)}"
    elif walk.on_host is None:
        yield f"{walk.host.name}, if there were room: {share(walk.placed.reserved)} of its {show_processors(whole)}"
    else:
        yield f"{walk.host.name}: {share(walk.placed.reserved)} of its {show_processors(whole)}"
    if walk.where_now:
        yield walk.where_now
    if walk.unseen:
        yield f"not looked at, so that the manifest alone counts of it: {', '.join(walk.unseen)}"
    if walk.on_host is None:
        return
    beside = ", ".join(f"{name} {show_processors(amount)}" for name, amount in walk.on_host.beside)
    if beside:
        yield f"beside it: {beside}"
    if walk.on_host.foreign:
        yield f"machines that are not ours: {share(walk.on_host.foreign)}"
    if walk.on_host.kept:
        yield f"kept for the host: {share(walk.on_host.kept)}"
    taken = walk.placed.reserved + walk.on_host.foreign
    taken += sum((amount for _, amount in walk.on_host.beside), Fraction(0))
    yield f"left over: {share(walk.on_host.capacity - taken)}"
    if walk.on_host.placement is not None:
        yield placement_says(walk.on_host.placement)


def _leftover(walk: Walk) -> Iterator[str]:
    yield f"limit {walk.placed.limit} %: {walk.placed.why_limit}"
    yield f"weight {walk.placed.weight}: {walk.placed.why_weight}"


def _rejected(walk: Walk) -> Iterator[str]:
    yield from _other_reserves(walk)
    if walk.apart:
        yield walk.apart
    yield from walk.shared
    yield from walk.partners
    for one in walk.elsewhere:
        yield f"on {one.host}: {one.says}"
    if not walk.elsewhere:
        yield "another host: the manifest has no other"


def _other_reserves(walk: Walk) -> Iterator[str]:
    if walk.fixed_by:
        yield f"another reserve: none was looked for, as {walk.fixed_by} fixes it"
    elif walk.wanted is None:
        yield f"another reserve: {_what_is_missing(walk)}"
    elif walk.least is None:
        yield "a reserve: nothing asks for one"
    elif walk.least.reserve == 1:
        yield "a lower reserve: there is none"
    else:
        yield from _one_less(walk, walk.least.reserve - 1)


def _one_less(walk: Walk, less: int) -> Iterator[str]:
    """Why not one per cent less: the index that its curve shows to fail there."""
    missed = [
        (one, at)
        for one in walk.looked
        if (at := one.curve.value_at(less)) and not holds(one.curve, one.threshold, less)
    ]
    for one, point in missed:
        how = "measured" if any(at.reserve == less for at in one.curve.points) else "looked up"
        how = f"{how}, as what was measured there gave no verdict" if less in one.curve.untold else how
        side = point.upper if isinstance(one.threshold, AtMost) else point.lower
        yield (
            f"{less} %, one less: {_name(walk, one)} {_value(one, point.value)} ({how}), and {_value(one, side)} "
            f"on the safe side; it must be {_beside(one)}"
        )
    if missed:
        return
    untold = sorted({at for one in walk.looked for at in one.curve.untold if at <= less})
    if less in untold:
        yield f"{less} %, one less: it was measured, and gave no verdict, so nothing says that it would do"
    elif untold:
        yield (
            f"{less} %, one less: not measured; lower settings gave no verdict ({_listed(untold)}), so nothing says "
            "that it would do"
        )
    else:
        yield f"{less} %, one less: nothing so low was measured, so nothing says that it would do"
