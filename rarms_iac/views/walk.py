"""`rarms explain COMPONENT`: from the APT to the per cent that its partition gets, step by step."""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from rarms_iac.model.indexes import find_index
from rarms_iac.model.layout import PlacedPartition, Placement
from rarms_iac.model.quantities import (
    LogicalProcessors,
    guaranteed,
    show_bytes,
    show_percent,
    show_processors,
)
from rarms_iac.model.system import AtMost, Component, Host, SchedulerType, Threshold
from rarms_iac.model.thresholds import show_threshold, show_value
from rarms_iac.planner.alternatives import Elsewhere
from rarms_iac.planner.groups import Group
from rarms_iac.statistics.curve import Curve, LeastReserve, Point
from rarms_iac.statistics.told_errors import wrong
from rarms_iac.views.as_json import as_json
from rarms_iac.views.diagnostics.layout import wrap
from rarms_iac.views.output.choosing import WalkOutput, WalkStepOutput
from rarms_iac.views.placement import placement_says

WIDTH = 80
_MARGIN = "  "


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """The data log that a reservation rests on."""

    path: str
    first: str  # when its first setting was measured; empty: it has none
    last: str
    reserves: tuple[int, ...]  # the CRs that it has, ascending
    interference: str
    processors: int  # of P1: a CR is per cent of these
    provider: str
    processor: str
    logical_processors: int
    smt: bool
    scheduler: SchedulerType
    os_build: int
    again: str  # the command that measures it


@dataclass(frozen=True, slots=True, kw_only=True)
class Looked:
    """One index of the APT of one member, with its curve."""

    member: str
    index: str
    threshold: Threshold
    curve: Curve


@dataclass(frozen=True, slots=True, kw_only=True)
class OnHost:
    """What the partition's host has promised in the layout."""

    capacity: LogicalProcessors
    kept: LogicalProcessors
    beside: tuple[tuple[str, LogicalProcessors], ...]  # other partitions there, by name
    placement: Placement | None = None  # how good the choice of hosts is, where there was one


@dataclass(frozen=True, slots=True, kw_only=True)
class Walk:
    """All that leads from a component's APT to what its partition gets."""

    component: Component
    group: Group
    host: Host
    placed: PlacedPartition
    wanted: LogicalProcessors  # before rounding
    fixed_by: str  # who fixes the reserve in the manifest; empty: it rests on the data log, or there is none
    measured: Measured | None
    looked: tuple[Looked, ...]
    least: LeastReserve | None
    remarks: tuple[str, ...]
    why_together: tuple[str, ...]
    apart: str  # what its members would need in partitions of their own; empty: it cannot be told, or is alone
    partners: tuple[str, ...]  # with whom it would probably save something; predicted
    on_host: OnHost | None  # None: there is no layout
    elsewhere: tuple[Elsewhere, ...]
    misfit: tuple[str, ...]  # why there is no layout; empty: there is one


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A step of the walk: what it is about, and its sentences."""

    topic: str
    says: tuple[str, ...]


def walk_text(walk: Walk, width: int = WIDTH) -> str:
    """The walk for a terminal of so many columns."""
    lines = [f"{walk.component.name} (criticality {walk.component.criticality})", ""]
    for step in steps_of(walk):
        lines.append(step.topic)
        for sentence in step.says:
            lines += wrap(sentence, width, _MARGIN)
    return "\n".join(lines) + "\n"


def walk_json(walk: Walk) -> str:
    """The same for programs."""
    placed = walk.placed
    return as_json(
        WalkOutput(
            component=walk.component.name,
            partition=placed.name,
            host=placed.host,
            fits=not walk.misfit,
            data_log=None if walk.measured is None else walk.measured.path,
            cr=None if walk.least is None else walk.least.reserve,
            interpolated=walk.least is not None and walk.least.interpolated,
            wanted_processors=float(walk.wanted),
            reserved_processors=float(placed.reserved),
            reserve=placed.reserve,
            processors=placed.processors,
            limit=placed.limit,
            weight=placed.weight,
            steps=tuple(WalkStepOutput(topic=one.topic, says=one.says) for one in steps_of(walk)),
        )
    )


def steps_of(walk: Walk) -> tuple[Step, ...]:
    """The steps that have something to say, in order."""
    made = (
        ("APT", _apt(walk)),
        ("data log", _data_log(walk)),
        ("setting and verdict", _verdicts(walk)),
        ("reservation", _reservation(walk)),
        ("rounding", _rounding(walk)),
        ("partition", _partition(walk)),
        ("host", _host(walk)),
        ("limit and weight", _leftover(walk)),
        ("rejected", _rejected(walk)),
        ("does not fit", iter(walk.misfit)),
    )
    steps = ((topic, tuple(says)) for topic, says in made)
    return tuple(Step(topic=topic, says=says) for topic, says in steps if says)


def _apt(walk: Walk) -> Iterator[str]:
    for one in sorted(walk.group.members, key=lambda each: each is not walk.component):
        whose = "" if one is walk.component else f"{one.name}, in the same partition: "
        for name, threshold in one.apt.items():
            index = find_index(name)
            assert index is not None, "a manifest's APT names indexes that there are"
            yield f"{whose}{name} {show_threshold(index, threshold)}"
    if not walk.component.apt:
        yield f"{walk.component.name} has none: nothing says how well it must do"


def _data_log(walk: Walk) -> Iterator[str]:
    log = walk.measured
    if walk.fixed_by:
        yield f"none is needed: {walk.fixed_by} fixes the reserve"
    elif log is None:
        yield "none is needed: nothing is reserved"
    else:
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
    if walk.least is None or walk.measured is None:
        return
    for one in walk.looked:
        point = one.curve.value_at(walk.least.reserve)
        if point is not None:
            yield (
                f"at {walk.least.reserve} %: {_name(walk, one)} {_value(one, point.value)}, "
                f"between {_value(one, point.lower)} and {_value(one, point.upper)} "
                f"(the truth lies outside in at most {_percent(one.curve.error)} of cases{_samples(one, point)}): "
                f"met, as the safe side of that is {_beside(one)}; {wrong(one.curve.error / 2)}"
            )
    if walk.least.interpolated:
        below = max((one for one in walk.measured.reserves if one < walk.least.reserve), default=None)
        above = min((one for one in walk.measured.reserves if one > walk.least.reserve), default=None)
        yield (
            f"looked up on the curve between the settings at {below} % and {above} %, not measured itself: "
            f"`{walk.measured.again} --verify` measures it"
        )
    yield from walk.remarks


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
    index = find_index(one.index)
    assert index is not None, "a curve is of an index that there is"
    return show_threshold(index, one.threshold)


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
    share = show_percent(100 * walk.wanted / whole)
    if walk.least is not None and walk.measured is not None:
        yield (
            f"CR {walk.least.reserve} %: the least whole per cent of P1's "
            f"{_virtual(walk.measured.processors)} at which every APT of the partition holds"
        )
    elif not walk.wanted:
        yield "none: nothing asks for one"
        return
    else:
        yield f"as {walk.fixed_by} fixes it"
    yield f"{show_processors(walk.wanted)}, {share} of {walk.host.name}"


def _rounding(walk: Walk) -> Iterator[str]:
    placed = walk.placed
    if not placed.reserve:
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

    if walk.on_host is None:
        yield f"{walk.host.name}, if there were room: {share(walk.placed.reserved)} of its {show_processors(whole)}"
        return
    yield f"{walk.host.name}: {share(walk.placed.reserved)} of its {show_processors(whole)}"
    beside = ", ".join(f"{name} {show_processors(amount)}" for name, amount in walk.on_host.beside)
    if beside:
        yield f"beside it: {beside}"
    if walk.on_host.kept:
        yield f"kept for the host: {share(walk.on_host.kept)}"
    taken = walk.placed.reserved + sum((amount for _, amount in walk.on_host.beside), Fraction(0))
    yield f"left over: {share(walk.on_host.capacity - taken)}"
    if walk.on_host.placement is not None:
        yield placement_says(walk.on_host.placement)


def _leftover(walk: Walk) -> Iterator[str]:
    yield f"limit {walk.placed.limit} %: {walk.placed.why_limit}"
    yield f"weight {walk.placed.weight}: {walk.placed.why_weight}"


def _rejected(walk: Walk) -> Iterator[str]:
    yield from _one_less(walk)
    if walk.apart:
        yield walk.apart
    yield from walk.partners
    for one in walk.elsewhere:
        yield f"on {one.host}: {one.says}"


def _one_less(walk: Walk) -> Iterator[str]:
    """Why not one per cent less: the index that its curve shows to fail there."""
    if walk.least is None or walk.least.reserve == 1:
        return
    less = walk.least.reserve - 1
    missed = [(one, at) for one in walk.looked if (at := one.curve.value_at(less)) and not _holds(one, at)]
    outside = [one for one in walk.looked if one.curve.value_at(less) is None]
    for one, point in missed:
        how = "measured" if any(at.reserve == less for at in one.curve.points) else "looked up"
        side = point.upper if isinstance(one.threshold, AtMost) else point.lower
        yield (
            f"{less} %, one less: {_name(walk, one)} {_value(one, point.value)} ({how}), and {_value(one, side)} "
            f"on the safe side; it must be {_beside(one)}"
        )
    if outside and not missed:
        yield f"{less} %, one less: nothing so low was measured, so nothing says that it would do"


def _holds(one: Looked, point: Point) -> bool:
    match one.threshold:
        case AtMost(value=limit):
            return point.upper <= float(limit)
        case _:
            return point.lower >= float(one.threshold.value)
