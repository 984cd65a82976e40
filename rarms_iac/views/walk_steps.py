"""The sentences of `rarms explain COMPONENT`, step by step; each says something, if only that there is nothing."""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from rarms_iac.app.explanation import DataLogSummary, Explanation, HostExplanation
from rarms_iac.model.quantities import guaranteed, in_processors, show_bytes, show_percent, show_processors
from rarms_iac.model.system import Component
from rarms_iac.views.placement import placement_says
from rarms_iac.views.walk_curves import one_less, shown, verdicts


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplanationStep:
    """A step of an explanation: what it is about, and its sentences."""

    topic: str
    says: tuple[str, ...]


def steps_of(walk: Explanation | HostExplanation) -> tuple[ExplanationStep, ...]:
    """The steps in order."""
    made = _on_the_host(walk) if isinstance(walk, HostExplanation) else _in_a_partition(walk)
    steps = ((topic, tuple(says)) for topic, says in made)
    return tuple(ExplanationStep(topic=topic, says=says) for topic, says in steps if says)


def _in_a_partition(walk: Explanation) -> Iterator[tuple[str, Iterator[str]]]:
    yield "APT", _apt(walk)
    yield "data log", _data_log(walk)
    yield "setting and verdict", verdicts(walk)
    yield "reservation", _reservation(walk)
    yield "rounding", _rounding(walk)
    yield "partition", _partition(walk)
    yield "host", _host(walk)
    yield "limit and weight", _leftover(walk)
    yield "rejected", _rejected(walk)
    yield "no layout", iter(walk.misfit)


def _on_the_host(walk: HostExplanation) -> Iterator[tuple[str, Iterator[str]]]:
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


def _apt(walk: Explanation) -> Iterator[str]:
    for member in sorted(walk.group.members, key=lambda each: each is not walk.component):
        if member is walk.component:
            yield from _thresholds(member, "")
        elif member.apt:
            yield from _thresholds(member, f"{member.name}, in the same partition: ")


def _thresholds(component: Component, whose: str) -> Iterator[str]:
    for name, threshold in component.apt.items():
        yield f"{whose}{name} {shown(name, threshold)}"
    if not component.apt:
        yield f"{component.name} has none: nothing says how well it must do"


def _data_log(walk: Explanation) -> Iterator[str]:
    log = walk.measured
    if walk.fixed_by:
        yield f"none is needed: {walk.fixed_by} fixes the reserve"
    elif log is not None:
        yield from _log(log)
    elif walk.wanted is None:
        yield f"none that holds: {walk.cannot}"
    else:
        yield "none is needed: nothing is reserved"


def _log(log: DataLogSummary) -> Iterator[str]:
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


def _reservation(walk: Explanation) -> Iterator[str]:
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


def _what_is_missing(walk: Explanation) -> str:
    return "no setting that was measured is enough" if walk.measured is not None else "not measured"


def _rounding(walk: Explanation) -> Iterator[str]:
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


def _partition(walk: Explanation) -> Iterator[str]:
    others = [member for member in walk.group.members if member is not walk.component]
    if not others:
        yield f"{walk.placed.name}: {walk.component.name} is alone, as nothing asks to combine it"
    else:
        names = ", ".join(f"{other.name} (criticality {other.criticality})" for other in others)
        yield f"{walk.placed.name}: {walk.component.name} is combined with {names}"
        yield from walk.why_together
    yield f"memory {show_bytes(walk.placed.memory)}, {_virtual(walk.placed.processors)}"


def _host(walk: Explanation) -> Iterator[str]:
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


def _leftover(walk: Explanation) -> Iterator[str]:
    yield f"limit {walk.placed.limit} %: {walk.placed.why_limit}"
    yield f"weight {walk.placed.weight}: {walk.placed.why_weight}"


def _rejected(walk: Explanation) -> Iterator[str]:
    yield from _other_reserves(walk)
    if walk.apart:
        yield walk.apart
    yield from walk.shared
    yield from walk.partners
    for one in walk.elsewhere:
        yield f"on {one.host}: {one.says}"
    if not walk.elsewhere:
        yield "another host: the manifest has no other"


def _other_reserves(walk: Explanation) -> Iterator[str]:
    if walk.fixed_by:
        yield f"another reserve: none was looked for, as {walk.fixed_by} fixes it"
    elif walk.wanted is None:
        yield f"another reserve: {_what_is_missing(walk)}"
    elif walk.least is None:
        yield "a reserve: nothing asks for one"
    elif walk.least.reserve == 1:
        yield "a lower reserve: there is none"
    else:
        yield from one_less(walk, walk.least.reserve - 1)
