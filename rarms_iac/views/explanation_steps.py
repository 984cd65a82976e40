"""The sentences of `rarms explain COMPONENT`, step by step; each says something, if only that there is nothing."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction

from rarms_iac.app.explanation import ComponentExplanation, DataLogSummary, ExplainedIndex, Explanation, HostExplanation
from rarms_iac.app.previous_tuning import PreviousTuning, RejectedCompound
from rarms_iac.model.commands import Prose, Wording, prose
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.model.indexes import index_named, show_threshold, show_value
from rarms_iac.model.layout import PlacedPartition, describe_placement
from rarms_iac.model.processor_number import ProcessorSource
from rarms_iac.model.quantities import (
    guaranteed,
    in_processors,
    share_of_host,
    share_of_processors,
    show_bytes,
    show_processors,
    show_reserve,
)
from rarms_iac.model.system import Component
from rarms_iac.model.wording import counted, in_a_row, natural_order
from rarms_iac.planner.reservations import depends_on_a_log, names_of
from rarms_iac.statistics.error_probability import describe_error, describe_extreme

STRATEGIES = {"default": "the default strategy", "paper": "the paper's procedure"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplanationStep:
    """A step of an explanation: what it is about, and its sentences."""

    topic: str
    sentences: tuple[Prose, ...]
    repeats_findings: bool = False  # says nothing but why there is no layout


def explanation_steps(explanation: ComponentExplanation) -> tuple[ExplanationStep, ...]:
    """Say step by step what leads to what a component gets; each step has at least one sentence."""
    steps = _on_the_host(explanation) if isinstance(explanation, HostExplanation) else _in_a_partition(explanation)
    return tuple(step for step in steps if step.sentences)


def _verdicts(explanation: Explanation) -> Iterator[Wording]:
    """What was measured at the reservation, or why nothing was."""
    if explanation.measured is None:
        yield _why_not_measured(explanation)
        return
    yield from (_verdict(explanation, index) for index in explanation.verdicts)
    if explanation.inconclusive:
        reserves = _list_reserves(explanation.inconclusive)
        yield f"measured{_load_suffix(explanation)} without a verdict (no steady state, or too few answers): {reserves}"
    yield from explanation.remarks


def _why_not_less(explanation: Explanation, less: int) -> Iterator[str]:
    """Why not one per cent less: the index that its curve shows to fail there."""
    below = f"one less, {_share(explanation, less)}{_load_suffix(explanation)}"
    missed = [index for index in explanation.one_less if not index.met]
    for index in missed:
        how = "measured" if index.samples is not None else "estimated between two measured settings"
        how = f"{how}, since what was measured there gave no verdict" if index.inconclusive else how
        safe = "" if index_named(index.index).is_extreme else f", at worst {_value(index, index.safe)}"
        yield f"{below}: {_name(explanation, index)} {_value(index, index.point.value)} ({how}){safe}; it must be " + (
            _bound(index)
        )
    if missed:
        return
    inconclusive = [at for at in explanation.inconclusive if at <= less]
    if less in explanation.overloaded:
        yield f"{below}: it falls behind its jobs: response times grow without an end"
    elif less in inconclusive:
        yield f"{below}: it was measured and gave no verdict, so it is unknown whether it is enough"
    elif inconclusive:
        yield (
            f"{below}: not measured; lower settings gave no verdict ({_list_reserves(inconclusive)}), "
            "so it is unknown whether it is enough"
        )
    else:
        yield f"{below}: nothing so low was measured, so it is unknown whether it is enough"


def _why_not_measured(explanation: Explanation) -> str:
    if explanation.wanted_lp is None:
        return "not measured: there is no data log that holds"
    if explanation.is_fixed and explanation.data_log is not None:
        return _measured_despite_fixed(explanation, explanation.data_log)
    if explanation.is_fixed:
        met = (
            "it is unknown whether its APT is met"
            if any(member.apt for member in explanation.shared.group.members)
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
    fixed = f"; the manifest fixes {amount(explanation.wanted_lp)}" if explanation.wanted_lp is not None else ""
    return f"measured: {enough} enough{fixed}"


def _verdict(explanation: Explanation, index: ExplainedIndex) -> str:
    """What was measured there, beside what the curve, on which every reservation rests, makes of it."""
    estimate = index.estimate
    seen = estimate or index.point
    setting = f"at {_share(explanation, index.reserve)}{_load_suffix(explanation)}"
    value = f"{setting}: {_name(explanation, index)} {_value(index, seen.value)}"
    samples = "" if estimate is None else f" ({counted(estimate.samples, 'sample')})"
    if index_named(index.index).is_extreme:
        beyond = "so far" if estimate is None or estimate.beyond is None else describe_extreme(estimate.beyond)
        return f"{value} {beyond}{samples}: {'met so far' if index.met else 'not met'}, as it must be {_bound(index)}"
    sentence = f"{value}, between {_value(index, seen.lower)} and {_value(index, seen.upper)}{samples}"
    worse = f"the worse end, {_value(index, index.safe)}"
    if estimate is not None and index.safe not in (estimate.lower, estimate.upper):
        worse += " with what other settings tell"
    if index.met:
        return f"{sentence}: met, as {worse}, is {_bound(index)}, {describe_error()}"
    if index.missed:
        return f"{sentence}: missed, it must be {_bound(index)}"
    return f"{sentence}: not shown yet to be met, as {worse}, is not {_bound(index)}"


def _share(explanation: Explanation, reserve: int) -> str:
    assert explanation.measured is not None, "a curve is of a log"
    return share_of_processors(reserve, explanation.measured.processors)


def _load_suffix(explanation: Explanation) -> str:
    """The load whose log a sentence is of, where there are several."""
    log = explanation.measured
    return f" beside {log.interference}" if log is not None and log.other_loads else ""


def _list_reserves(reserves: Iterable[int]) -> str:
    return ", ".join(f"{reserve} % of its VPs" for reserve in reserves)


def _name(explanation: Explanation, index: ExplainedIndex) -> str:
    return index.index if index.member == explanation.component else f"{index.index} of {index.member}"


def _bound(index: ExplainedIndex) -> str:
    return show_threshold(index_named(index.index), index.threshold)


def _value(index: ExplainedIndex, value: float) -> str:
    return show_value(index_named(index.index), value, index.threshold.value)


def _fixed_by(explanation: Explanation) -> str:
    if explanation.fixed_partition:
        return f"the manifest's partition {explanation.fixed_partition}"
    return f"the manifest, for {' and '.join(explanation.fixed_members)},"


def _in_a_partition(explanation: Explanation) -> Iterator[ExplanationStep]:
    yield _step("APT", _apt(explanation))
    yield _step("data log", _data_log(explanation))
    yield _step("setting and verdict", _verdicts(explanation))
    yield _step("reservation", _reservation(explanation))
    yield _step("rounding", _rounding(explanation))
    yield _step("partition", _partition(explanation))
    yield _step("host", _host(explanation))
    yield _step("limit and weight", _limit_and_weight(explanation.place.partition))
    yield _step("rejected", _rejected(explanation))
    yield _step("no layout", _no_layout(explanation), repeats_findings=True)


def _on_the_host(explanation: HostExplanation) -> Iterator[ExplanationStep]:
    component, name = explanation.subject, explanation.component
    hosts = ", ".join(explanation.hosts) or "no host of the manifest"
    task = (
        prose(f"robotic task class {component.task}: ", *explanation.commands, " shows its values")
        if component.task
        else "no robotic task class"
    )
    kept_for_hosts = [
        f"{host.name} keeps {show_processors(in_processors(host.keep_for_host.processor, host.logical_processors))}"
        for host in explanation.places
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
    for member in sorted(explanation.shared.group.members, key=lambda each: each is not explanation.subject):
        if member is explanation.subject:
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
    if explanation.is_fixed:
        if explanation.data_log is not None:
            yield from _log(explanation.data_log)
        none = "none is needed" if explanation.data_log is None else "not used"
        yield f"{none}: {_fixed_by(explanation)} fixes the reserve"
    elif log is not None:
        yield from _log(log)
    elif explanation.wanted_lp is None:
        yield f"none that holds: {explanation.place.no_host_because}"
    else:
        yield "none is needed: nothing is reserved"


def _log(log: DataLogSummary) -> Iterator[str]:
    when = log.first if log.first == log.last else f"{log.first} to {log.last}"
    yield f"{log.path}, {counted(len(log.reserves), 'setting')}, measured {when}"
    if log.others:
        yield f"{counted(log.others, 'setting')} more in it from other conditions, not used"
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
    if explanation.wanted_lp is None:
        yield f"not known: {_what_is_missing(explanation)}"
        return
    if explanation.least is not None and explanation.measured is not None:
        processors = explanation.measured.processors
        yield (
            f"{show_reserve(explanation.least, processors)}: the least whole per cent of its processors at which "
            "every APT of the partition is seen to hold"
        )
    elif not explanation.wanted_lp:
        yield "none: nothing asks for one"
        return
    else:
        yield f"as {_fixed_by(explanation)} fixes it"
    share = share_of_host(explanation.wanted_lp, whole, explanation.place.host.name)
    yield f"{show_processors(explanation.wanted_lp)}, {share}"


def _what_is_missing(explanation: Explanation) -> str:
    return "no setting that was measured is enough" if explanation.measured is not None else "not measured"


def _rounding(explanation: Explanation) -> Iterator[str]:
    place, partition = explanation.place, explanation.place.partition
    if explanation.wanted_lp is None or place.no_host_because:
        yield "none: " + (
            place.no_host_because if explanation.wanted_lp is not None else "there is no reservation to round yet"
        )
        return
    if not partition.settings.reserve:
        yield "none: nothing is reserved"
        return
    lost = guaranteed(partition.settings.reserve, partition.settings.processors) - explanation.wanted_lp
    given = show_reserve(partition.settings.reserve, partition.settings.processors)
    yield f"{given}: whole per cent are the provider's grain, " + (
        f"rounded up by {show_processors(lost)}" if lost else "nothing is lost"
    )


def _partition(explanation: Explanation) -> Iterator[str]:
    partition, place = explanation.shared, explanation.place
    others = [member for member in partition.group.members if member is not explanation.subject]
    if not others:
        yield f"{place.partition.name}: {explanation.component} is alone, as nothing asks to combine it"
    else:
        names = ", ".join(f"{other.name} (criticality {other.criticality})" for other in others)
        yield f"{place.partition.name}: {explanation.component} is combined with {names}"
        yield from _why_together(explanation)
    processors = counted(place.partition.settings.processors, place.host.processor_word)
    why = _WHY_PROCESSORS[explanation.measured.processors_from] if explanation.measured else ""
    yield f"memory {show_bytes(place.partition.settings.memory)}, {processors}{why}"


_WHY_PROCESSORS = {
    ProcessorSource.MANIFEST: ", as the manifest says",
    ProcessorSource.USED: ": the most that was seen to be used at once",
    ProcessorSource.MEMBERS: ": those of its components together, at most the host's",
    ProcessorSource.HOST: ": as many as the host has, since it was not seen how many are used at once",
}


def _host(explanation: Explanation) -> Iterator[str]:
    partition, place = explanation.shared, explanation.place
    layout = partition.layout
    name, whole = place.host.name, Fraction(place.host.logical_processors)

    def share(processors: Fraction) -> str:
        return f"{show_processors(processors)} ({share_of_host(processors, whole, name)})"

    if place.no_host_because:
        condition = "once its reservation is known" if explanation.wanted_lp is None else "if it could be there"
        yield f"{name}, {condition}: it has {show_processors(whole)}"
    elif layout is None:
        yield f"{name}, once there is a layout: {share(place.partition.reserved)} of its {show_processors(whole)}"
    else:
        yield f"{name}: {share(place.partition.reserved)} of its {show_processors(whole)}"
    if partition.current_host == place.host.name:
        yield partition.why_bound or "it is there now"
    elif partition.current_host:
        yield f"it is on {partition.current_host} now: applied, it is made anew on {name}"
    if not_observed := sorted(partition.system.hosts.keys() - partition.states.keys(), key=natural_order):
        yield f"not looked at, so that the manifest alone counts of it: {', '.join(not_observed)}"
    if layout is None:
        return
    here = (other for other in layout.on(name) if other.name != place.partition.name)
    others = [(other.name, other.reserved) for other in sorted(here, key=lambda other: natural_order(other.name))]
    if others:
        yield f"beside it: {', '.join(f'{other} {show_processors(amount)}' for other, amount in others)}"
    totals = explanation.totals
    assert totals is not None, "there is a layout"
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


def _rejected(explanation: Explanation) -> Iterator[Wording]:
    yield from _other_reserves(explanation)
    yield from map(_compound, explanation.compounds)
    if not explanation.compounds:
        yield f"sharing with others: {_why_no_compounds(explanation)}"
    yield from (f"on {other.host}: {other.message}" for other in explanation.elsewhere)
    if not explanation.elsewhere:
        yield "another host: the manifest has no other"


def _why_no_compounds(explanation: Explanation) -> str:
    if not depends_on_a_log(explanation.shared.group):
        return "not looked for, as its reserve rests on no measurement"
    if explanation.previous.unreadable:
        return f"what `rarms tune` measured cannot be told: {explanation.previous.unreadable}"
    if not explanation.previous.runs:
        return f"`rarms tune` has measured nothing on {explanation.place.host.platform}"
    return "`rarms tune` measured no other compound with it"


def _compound(compound: RejectedCompound) -> str:
    answers = []
    if compound.enough is not None:
        answers.append(f"{compound.enough} % of its VPs is enough, and another layout was taken")
    if compound.missed is not None:
        worse = " and ".join(compound.worse)
        answers.append(f"{compound.missed} % of its VPs is not enough for {worse} for sure")
    why = f"; outdated: {compound.outdated}" if compound.outdated else ""
    return f"{'+'.join(compound.components)}, as `rarms tune` measured it: {'; '.join(answers)}{why}"


def _why_together(explanation: Explanation) -> Iterator[str]:
    """What put the members of a partition together: the manifest, and who wrote that there."""
    group = explanation.shared.group
    if group.name in explanation.shared.system.partitions:
        by_tuning = _combined_by_tuning(explanation.previous, names_of(group.members))
        by_hand = "no run of `rarms tune` that is on record here wrote it, so it was written by hand"
        yield f"the manifest's `partitions` puts them together ({group.name}); {by_tuning or by_hand}"
    for member in group.members:
        others = [name for name in member.together if name in names_of(group.members)]
        if others:
            yield f"{member.name} says that it must be together with {', '.join(others)}"


def _combined_by_tuning(previous: PreviousTuning, members: tuple[str, ...]) -> str:
    combined = previous.combined(members)
    if combined is None:
        return ""
    run, partition = combined
    claim = f", {run.claim} to be the best" if run.strategy == "default" else ""
    before = show_processors(partition.parts_lp or Fraction(0))
    return (
        f"`rarms tune` combined them at {run.when}, by {STRATEGIES[run.strategy]}{claim}: CR "
        f"{show_processors(partition.reserved_lp)} ({partition.reserve} % of its VPs) instead of {before} apart"
    )


def _no_layout(explanation: Explanation) -> Iterator[str]:
    if not explanation.fits:
        for finding in explanation.shared.planning.findings:
            if has_errors([finding]):
                yield f"{finding.summary} ({finding.code}): {finding.detail} {finding.advice}"


def _other_reserves(explanation: Explanation) -> Iterator[str]:
    if explanation.is_fixed:
        yield f"another reserve: none was looked for, as {_fixed_by(explanation)} fixes it"
    elif explanation.wanted_lp is None:
        yield f"another reserve: {_what_is_missing(explanation)}"
    elif explanation.least is None:
        yield "a reserve: nothing asks for one"
    elif explanation.least == 1:
        yield "a lower reserve: there is none"
    else:
        yield from _why_not_less(explanation, explanation.least - 1)
