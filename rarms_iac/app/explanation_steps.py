"""The sentences of `rarms explain COMPONENT`, step by step; each says something, if only that there is nothing."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from fractions import Fraction

from rarms_iac.app.explained_partition import ExplainedPartition
from rarms_iac.app.explained_sharing import (
    NOT_LOOKED_FOR,
    PreviousTuning,
    describe_own_partitions,
    describe_partners,
    previous_tuning,
    rejected_compounds,
    why_together,
)
from rarms_iac.app.explanation import (
    ComponentExplanation,
    DataLogSummary,
    Explanation,
    ExplanationStep,
    HostExplanation,
    MemberCurve,
)
from rarms_iac.model.commands import PLAN, Wording, prose
from rarms_iac.model.diagnostics import Diagnostic, has_errors
from rarms_iac.model.indexes import index_named, show_threshold, show_value
from rarms_iac.model.layout import PlacedPartition, describe_placement
from rarms_iac.model.quantities import (
    guaranteed,
    in_processors,
    share_of_host,
    share_of_processors,
    show_bytes,
    show_processors,
    show_reserve,
)
from rarms_iac.model.system import AtMost, Component
from rarms_iac.model.wording import counted, in_a_row
from rarms_iac.planner.alternatives import ChosenPlace, elsewhere
from rarms_iac.planner.reservations import depends_on_a_log
from rarms_iac.planner.totals import totals_by_host
from rarms_iac.statistics.curves import Point, holds
from rarms_iac.statistics.error_probability import describe_error, describe_extreme


def verdicts(explanation: Explanation) -> Iterator[Wording]:
    """What was measured at the reservation, or why nothing was."""
    if explanation.measured is None:
        yield _why_not_measured(explanation)
        yield from explanation.remarks
        return
    at = explanation.least if explanation.least is not None else max(explanation.measured.reserves, default=0)
    for apt in explanation.curves:
        point = apt.curve.value_at(at)
        if point is not None:
            yield _verdict(explanation, apt, point, at)
    if inconclusive := sorted({each for apt in explanation.curves for each in apt.curve.inconclusive}):
        yield f"measured without a verdict (no steady state, or too few answers): {_list_reserves(inconclusive)}"
    yield from explanation.remarks


def why_not_less(explanation: Explanation, less: int) -> Iterator[str]:
    """Return why not one per cent less: the index that its curve shows to fail there.

    Args:
        explanation: Of a component that was measured.
        less: The reservation that is one below the least, in per cent of a processor.
    """
    missed = [
        (apt, at)
        for apt in explanation.curves
        if (at := apt.curve.value_at(less)) and not holds(apt.curve, apt.threshold, less)
    ]
    for apt, point in missed:
        how = "measured" if any(setting.reserve == less for setting in apt.curve.points) else "looked up"
        how = f"{how}, as what was measured there gave no verdict" if less in apt.curve.inconclusive else how
        side = _value(apt, _safe_side(apt, point))
        safe = "" if index_named(apt.index).is_extreme else f", and {side} on the safe side"
        yield (
            f"{_share(explanation, less)}, one less: {_name(explanation, apt)} {_value(apt, point.value)} ({how})"
            f"{safe}; it must be {_bound(apt)}"
        )
    overloaded = {at for apt in explanation.curves for at in apt.curve.overloaded if at <= less}
    if less in overloaded and not missed:
        yield f"{_share(explanation, less)}, one less: it falls behind its jobs: response times grow without an end"
    if missed or less in overloaded:
        return
    below = f"{_share(explanation, less)}, one less"
    inconclusive = sorted({at for apt in explanation.curves for at in apt.curve.inconclusive if at <= less})
    if less in inconclusive:
        yield f"{below}: it was measured and gave no verdict, so it is unknown whether it is enough"
    elif inconclusive:
        yield (
            f"{below}: not measured; lower settings gave no verdict ({_list_reserves(inconclusive)}), "
            "so it is unknown whether it is enough"
        )
    else:
        yield f"{below}: nothing so low was measured, so it is unknown whether it is enough"


def _why_not_measured(explanation: Explanation) -> str:
    if explanation.wanted is None:
        return "not measured: there is no data log that holds"
    if explanation.fixed_by and explanation.log is not None:
        return _measured_despite_fixed(explanation, explanation.log)
    if explanation.fixed_by:
        met = (
            "it is unknown whether its APT is met"
            if any(member.apt for member in explanation.partition.group.members)
            else "no APT asks"
        )
        return f"not measured: the reserve is fixed, and {met}"
    return "not measured: nothing is reserved, and no APT asks"


def _measured_despite_fixed(explanation: Explanation, log: DataLogSummary) -> str:
    """As in: measured: 1.24 LP (62 % of onboard) is enough; the manifest fixes 1.25 LP (63 % of onboard)."""

    def amount(processors: Fraction) -> str:
        host = explanation.place.host
        return f"{show_processors(processors)} ({share_of_host(processors, host.logical_processors, host.name)})"

    least = explanation.least
    enough = f"{amount(guaranteed(least, log.processors))} is" if least else "no setting that was measured is"
    fixed = f"; the manifest fixes {amount(explanation.wanted)}" if explanation.wanted is not None else ""
    return f"measured: {enough} enough{fixed}"


def _verdict(explanation: Explanation, apt: MemberCurve, point: Point, at: int) -> str:
    """What was measured there, beside what the curve, on which every reservation rests, makes of it."""
    estimate = apt.curve.estimate_at(at)
    seen = point if estimate is None else estimate
    value = f"at {_share(explanation, at)}: {_name(explanation, apt)} {_value(apt, seen.value)}"
    samples = "" if estimate is None else f" ({counted(estimate.samples, 'sample')})"
    met = holds(apt.curve, apt.threshold, at)
    if index_named(apt.index).is_extreme:
        beyond = "so far" if estimate is None or estimate.beyond is None else describe_extreme(estimate.beyond)
        return f"{value} {beyond}{samples}: {'met so far' if met else 'not met'}, as it must be {_bound(apt)}"
    sentence = f"{value}, between {_value(apt, seen.lower)} and {_value(apt, seen.upper)}{samples}"
    curve = f"as the safe side of the curve, {_value(apt, _safe_side(apt, point))},"
    if met:
        return f"{sentence}: met, {curve} is {_bound(apt)}, {describe_error()}"
    return f"{sentence}: not shown to be met, {curve} is not {_bound(apt)}"


def _share(explanation: Explanation, reserve: int) -> str:
    assert explanation.measured is not None, "a curve is of a log"
    return share_of_processors(reserve, explanation.measured.processors)


def _safe_side(apt: MemberCurve, point: Point) -> float:
    return point.upper if isinstance(apt.threshold, AtMost) else point.lower


def _list_reserves(reserves: list[int]) -> str:
    return ", ".join(f"{reserve} % of its VPs" for reserve in reserves)


def _name(explanation: Explanation, apt: MemberCurve) -> str:
    return apt.index if apt.member == explanation.component.name else f"{apt.index} of {apt.member}"


def _bound(apt: MemberCurve) -> str:
    return show_threshold(index_named(apt.index), apt.threshold)


def _value(apt: MemberCurve, value: float) -> str:
    return show_value(index_named(apt.index), value)


def explain(explanation: Explanation | HostExplanation, errors: tuple[Diagnostic, ...] = ()) -> ComponentExplanation:
    """Say step by step what leads to what a component gets.

    Args:
        explanation: the facts.
        errors: why nothing says how much it needs.

    Returns:
        Steps with at least one sentence each, and what they come to.
    """
    steps = _on_the_host(explanation) if isinstance(explanation, HostExplanation) else _in_a_partition(explanation)
    walk = ComponentExplanation(
        component=explanation.component.name,
        criticality=explanation.component.criticality,
        steps=tuple(step for step in steps if step.sentences),
        errors=errors,
    )
    if isinstance(explanation, HostExplanation):
        return walk
    place, partition = explanation.place, explanation.place.partition
    settings = partition.settings
    return replace(
        walk,
        partition=partition.name,
        host=partition.host,
        fits=explanation.partition.layout is not None,
        data_log=None if explanation.measured is None else explanation.measured.path,
        least=None if explanation.fixed_by else explanation.least,
        wanted_lp=explanation.wanted,
        reserved_lp=None if place.no_host_because else partition.reserved,
        reserve=None if place.no_host_because else settings.reserve,
        processors=settings.processors,
        limit=settings.limit,
        weight=settings.weight,
    )


def _in_a_partition(explanation: Explanation) -> Iterator[ExplanationStep]:
    previous = previous_tuning(explanation.partition.measurements, explanation.place.host)
    yield _step("APT", _apt(explanation))
    yield _step("data log", _data_log(explanation))
    yield _step("setting and verdict", verdicts(explanation))
    yield _step("reservation", _reservation(explanation))
    yield _step("rounding", _rounding(explanation))
    yield _step("partition", _partition(explanation, previous))
    yield _step("host", _host(explanation))
    yield _step("limit and weight", _limit_and_weight(explanation.place.partition))
    yield _step("rejected", _rejected(explanation, previous))
    yield _step("no layout", _no_layout(explanation.partition), repeats_findings=True)


def _on_the_host(explanation: HostExplanation) -> Iterator[ExplanationStep]:
    component, name = explanation.component, explanation.component.name
    hosts = ", ".join(host.name for host in explanation.hosts) or "no host of the manifest"
    task = (
        prose(f"robotic task class {component.task}: ", PLAN, " shows its values")
        if component.task
        else "no robotic task class"
    )
    kept_for_hosts = [
        f"{host.name} keeps {show_processors(in_processors(host.keep_for_host.processor, host.logical_processors))}"
        for host in explanation.hosts
    ]
    yield _step("APT", _thresholds(component, ""))
    yield _step("data log", ["none: rarms measures what runs in partitions"])
    yield _step("setting and verdict", [f"not measured: {name} runs on the host itself (`runs_on: host`)"])
    yield _step(
        "reservation",
        ["none: only partitions have one; `keep_for_host` is for all that runs outside", *kept_for_hosts],
    )
    yield _step("rounding", ["none: nothing is reserved"])
    yield _step("partition", ["none: it is combined with no other"])
    yield _step("host", [f"where it is started: {hosts}"])
    yield _step("limit and weight", ["none: both are of partitions", task])
    yield _step("rejected", ["nothing: nothing is placed, combined or measured"])


def _step(topic: str, sentences: Iterable[Wording], *, repeats_findings: bool = False) -> ExplanationStep:
    return ExplanationStep(topic=topic, sentences=tuple(map(prose, sentences)), repeats_findings=repeats_findings)


def _apt(explanation: Explanation) -> Iterator[str]:
    for member in sorted(explanation.partition.group.members, key=lambda each: each is not explanation.component):
        if member is explanation.component:
            yield from _thresholds(member, "")
        elif member.apt:
            yield from _thresholds(member, f"{member.name}, in the same partition: ")


def _thresholds(component: Component, prefix: str) -> Iterator[str]:
    for name, threshold in component.apt.items():
        yield f"{prefix}{name} {show_threshold(index_named(name), threshold)}"
    if not component.apt:
        yield f"{component.name} has none: the manifest does not say how well it must do"


def _data_log(explanation: Explanation) -> Iterator[str]:
    log = explanation.measured
    if explanation.fixed_by:
        if explanation.log is not None:
            yield from _log(explanation.log)
        none = "none is needed" if explanation.log is None else "not used"
        yield f"{none}: {explanation.fixed_by} fixes the reserve"
    elif log is not None:
        yield from _log(log)
    elif explanation.wanted is None:
        yield f"none that holds: {explanation.place.no_host_because}"
    else:
        yield "none is needed: nothing is reserved"


def _log(log: DataLogSummary) -> Iterator[str]:
    when = log.first if log.first == log.last else f"{log.first} to {log.last}"
    yield f"{log.path}, {counted(len(log.reserves), 'setting')}, measured {when}"
    smt = "with SMT" if log.smt else "without SMT"
    build = f", build {log.os_build}" if log.os_build else ""
    yield (
        f"machine: {log.provider}, {log.processor or 'no processor model'}, "
        f"{show_processors(log.logical_processors)} {smt}, scheduler {log.scheduler.value}{build}; "
        f"against {log.interference}{_others(log)}"
    )


def _others(log: DataLogSummary) -> str:
    """The loads that ask for no more, where there are several."""
    return f", which asks for most; {in_a_row(log.other_loads)} for no more" if log.other_loads else ""


def _reservation(explanation: Explanation) -> Iterator[str]:
    whole = explanation.place.host.logical_processors
    if explanation.wanted is None:
        yield f"not known: {_what_is_missing(explanation)}"
        return
    if explanation.least is not None and explanation.measured is not None:
        processors = explanation.measured.processors
        yield (
            f"{show_reserve(explanation.least, processors)}: the least whole per cent of P1's processors at which "
            "every APT of the partition is seen to hold"
        )
    elif not explanation.wanted:
        yield "none: nothing asks for one"
        return
    else:
        yield f"as {explanation.fixed_by} fixes it"
    share = share_of_host(explanation.wanted, whole, explanation.place.host.name)
    yield f"{show_processors(explanation.wanted)}, {share}"


def _what_is_missing(explanation: Explanation) -> str:
    return "no setting that was measured is enough" if explanation.measured is not None else "not measured"


def _rounding(explanation: Explanation) -> Iterator[str]:
    place, partition = explanation.place, explanation.place.partition
    if explanation.wanted is None or place.no_host_because:
        yield "none: " + (
            place.no_host_because if explanation.wanted is not None else "there is no reservation to round yet"
        )
        return
    if not partition.settings.reserve:
        yield "none: nothing is reserved"
        return
    lost = guaranteed(partition.settings.reserve, partition.settings.processors) - explanation.wanted
    given = show_reserve(partition.settings.reserve, partition.settings.processors)
    yield f"{given}: whole per cent are the provider's grain, " + (
        f"rounded up by {show_processors(lost)}" if lost else "nothing is lost"
    )


def _partition(explanation: Explanation, previous: PreviousTuning) -> Iterator[str]:
    partition, place = explanation.partition, explanation.place
    others = [member for member in partition.group.members if member is not explanation.component]
    if not others:
        yield f"{place.partition.name}: {explanation.component.name} is alone, as nothing asks to combine it"
    else:
        names = ", ".join(f"{other.name} (criticality {other.criticality})" for other in others)
        yield f"{place.partition.name}: {explanation.component.name} is combined with {names}"
        yield from why_together(partition.group, partition.system, previous)
    processors = counted(place.partition.settings.processors, place.host.processor_word)
    yield f"memory {show_bytes(place.partition.settings.memory)}, {processors}"


def _host(explanation: Explanation) -> Iterator[str]:
    partition, place = explanation.partition, explanation.place
    layout = partition.layout
    name, whole = place.host.name, Fraction(place.host.logical_processors)

    def share(processors: Fraction) -> str:
        return f"{show_processors(processors)} ({share_of_host(processors, whole, name)})"

    if place.no_host_because:
        condition = "once its reservation is known" if explanation.wanted is None else "if it could be there"
        yield f"{name}, {condition}: it has {show_processors(whole)}"
    elif layout is None:
        yield f"{name}, if there were room: {share(place.partition.reserved)} of its {show_processors(whole)}"
    else:
        yield f"{name}: {share(place.partition.reserved)} of its {show_processors(whole)}"
    if partition.current_host == place.host.name:
        yield partition.why_bound or "it is there now"
    elif partition.current_host:
        yield f"it is on {partition.current_host} now: applied, it is made anew on {name}"
    if not_observed := sorted(partition.system.hosts.keys() - partition.states.keys()):
        yield f"not looked at, so that the manifest alone counts of it: {', '.join(not_observed)}"
    if layout is None:
        return
    others = sorted(
        (other.name, other.reserved)
        for other in layout.partitions
        if other.host == name and other.name != place.partition.name
    )
    if others:
        yield f"beside it: {', '.join(f'{other} {show_processors(amount)}' for other, amount in others)}"
    totals = totals_by_host(partition.system, layout.partitions, partition.views)[name]
    if totals.unmanaged_lp:
        yield f"unmanaged machines: {share(totals.unmanaged_lp)}"
    if totals.kept_lp:
        yield f"kept for the host: {share(totals.kept_lp)}"
    yield f"headroom: {share(totals.free_lp)}"
    if layout.placement is not None:
        yield describe_placement(layout.placement)


def _limit_and_weight(partition: PlacedPartition) -> Iterator[str]:
    yield f"limit {show_reserve(partition.settings.limit, partition.settings.processors)}: {partition.why_limit}"
    yield f"weight {partition.settings.weight}: {partition.why_weight}"
    if partition.mechanism:
        yield partition.mechanism


def _rejected(explanation: Explanation, previous: PreviousTuning) -> Iterator[Wording]:
    partition, place = explanation.partition, explanation.place
    yield from _other_reserves(explanation)
    if own_partitions := describe_own_partitions(partition, place):
        yield own_partitions
    if depends_on_a_log(partition.group):
        yield from rejected_compounds(partition.group, previous, place.host)
    else:
        yield NOT_LOOKED_FOR
    if explanation.measured is not None:
        yield from describe_partners(partition, place.host)
    chosen = ChosenPlace(
        partition=place.partition, layout=partition.layout, views=partition.views, stays=partition.why_bound
    )
    others = elsewhere(partition.group, chosen, partition.system, partition.reservations)
    yield from (f"on {other.host}: {other.message}" for other in others)
    if not others:
        yield "another host: the manifest has no other"


def _no_layout(partition: ExplainedPartition) -> Iterator[str]:
    if partition.layout is None:
        for finding in partition.planning.findings:
            if has_errors([finding]):
                yield f"{finding.summary} ({finding.code}): {finding.detail} {finding.advice}"


def _other_reserves(explanation: Explanation) -> Iterator[str]:
    if explanation.fixed_by:
        yield f"another reserve: none was looked for, as {explanation.fixed_by} fixes it"
    elif explanation.wanted is None:
        yield f"another reserve: {_what_is_missing(explanation)}"
    elif explanation.least is None:
        yield "a reserve: nothing asks for one"
    elif explanation.least == 1:
        yield "a lower reserve: there is none"
    else:
        yield from why_not_less(explanation, explanation.least - 1)
