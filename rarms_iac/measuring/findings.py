"""The findings of measuring, each with its page in docs/findings.

`findings_of` reports how an experiment ended, `proof_findings` how a proof did, `work_of_settings` work that ran
outside of its partition.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil, isfinite
from statistics import fmean
from typing import Any, assert_never

from rarms_iac.app.hosts import Hosts
from rarms_iac.applying.desired_hosts import totals_after
from rarms_iac.manifest.checks.measurement import advice_on_weak_loads
from rarms_iac.measuring.evidence import MeasuredIndex, idle_share, measured_indexes, why_unsteady
from rarms_iac.measuring.proof import IndexVerdict, LayoutProof
from rarms_iac.model.capacity import shared_processors
from rarms_iac.model.commands import Wording, command, prose
from rarms_iac.model.diagnostics import Diagnostic, Facts, Finding, Places
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.host import Host
from rarms_iac.model.indexes import index_named, show_range, show_threshold, show_value
from rarms_iac.model.loads import BUSY_LOOP, could_take_all
from rarms_iac.model.outcomes import (
    WIDTH,
    Conclusion,
    Met,
    Missed,
    NotAchievable,
    NotResolved,
    SettingFailed,
    Stopped,
    Sufficient,
    Swept,
    TooFewSamples,
    TooManyFailures,
    Unsteady,
    WithinNoise,
)
from rarms_iac.model.quantities import (
    ReservePercent,
    Unit,
    guaranteed,
    show_amount,
    show_duration,
    show_processors,
    show_reserve,
)
from rarms_iac.model.series import MOST_SAMPLES, Series
from rarms_iac.model.setting import ALL_PARTITIONS, P1, P2, OutsideWork, Setting, SettingEvidence, most_used
from rarms_iac.model.state import State
from rarms_iac.model.system import AtLeast, AtMost, Measured, Threshold
from rarms_iac.model.totals import host_totals
from rarms_iac.model.wording import counted, in_a_row
from rarms_iac.planner.groups import groups_of
from rarms_iac.running.work_places import add_up
from rarms_iac.statistics.curves import threshold_met_by
from rarms_iac.statistics.distributions import LOOK_ERROR, describe_extreme
from rarms_iac.statistics.overload import describe_overload, find_overload, more_processors_help
from rarms_iac.statistics.samples import response_times
from rarms_iac.statistics.verdicts import LONG

VPS_USED = Finding.note("RARMS380", "The component uses another number of processors")

FAILURES = Finding.error("RARMS113", "Too many samples failed")

UNABLE = Finding.error("RARMS114", "This host cannot measure the component")

OCCUPIED = Finding.error("RARMS115", "The host is not free to measure")

NOT_ACHIEVABLE = Finding.error("RARMS110", "Threshold performance is not achievable on this platform.")
NOT_RESOLVED = Finding.error("RARMS111", "It is not shown yet whether a threshold is met")
NO_STEADY_STATE = Finding.error("RARMS112", "A component reaches no steady state")
MISSED = Finding.error("RARMS118", "A component misses its threshold in the layout")
NOT_APPLIED = Finding.error("RARMS119", "The layout is not on the host")
STILL_STOPPED = Finding.error("RARMS269", "Partitions that were stopped to measure do not run again")
WEAK_ANSWER = Finding.error("RARMS326", "A measurement with weak loads is not an answer")
FIXED_ANYWAY = Finding.note("RARMS266", "The manifest fixes a reservation that was measured")
LESS_UNKNOWN = Finding.warning("RARMS267", "Less may be enough: settings below have no steady state")


NO_MORE_CPU = (
    "More CPU does not help: its jobs wait for something else than a processor, and end further apart than they are "
    "due. Give them a longer period, or shorten what they wait for."
)
"""The advice to a component that falls behind on all processors."""

SHOWN_FAILURES = 3
"""How many of the reasons why samples failed a finding lists."""


def findings_of(
    experiment: Experiment, conclusion: Conclusion, settings: tuple[Setting, ...], places: Places
) -> Iterator[Diagnostic]:
    """Report what a person must hear of how an experiment ended, where that is not simply a reservation.

    Args:
        settings: all of the experiment, in the order in which they were run.

    Returns:
        Findings, none where there is nothing to hear beyond the reservation.
    """
    match conclusion:
        case NotAchievable(reserve=reserve):
            yield from _not_achievable(experiment, reserve, settings, places)
        case NotResolved():
            yield from _not_resolved(experiment, conclusion, settings, places)
        case SettingFailed(reserve=reserve, verdict=TooManyFailures() as failed):
            yield failed_samples(failed, f"at {reserve} % of its VPs", places, reserve_percent=reserve)
        case Sufficient(reserve=reserve):
            yield from _less_unknown(experiment, conclusion, settings, places)
            yield from _fixed_anyway(experiment, reserve, places)
            yield from _wasted_processors(experiment, reserve, settings, places)
        case Swept() | Stopped():
            return
        case _:
            assert_never(conclusion)


def failed_samples(
    failed: TooManyFailures, setting: str, places: Places, *, advice: Wording = "", **values: Any
) -> Diagnostic:
    """Make the finding that more samples failed than a component allows.

    Args:
        advice: Where enough memory was left; empty: to run it alone, or to allow as many failures.
    """
    component, count = failed.component, len(failed.failures)
    reasons = "; ".join(dict.fromkeys(failed.failures[:SHOWN_FAILURES]))
    run_alone = prose("Run it alone and correct it: ", command("run", component), ". ")
    allow = f"Or allow that: `run: {{ failures: {count} }}`."
    return FAILURES.at(
        places.key("components", component),
        "{component} {setting}: {failed_samples:sample} failed, and `run.failures` allows {allowed}: "
        "{reasons}.{_why_out_of_memory}",
        MORE_MEMORY if failed.out_of_memory else advice or prose(run_alone, allow),
        address=f"component/{component}",
        component=component,
        failed_samples=count,
        killed_for_memory=failed.out_of_memory,
        setting=setting,
        allowed=failed.allowed,
        reasons=reasons,
        _why_out_of_memory=why_out_of_memory(failed.out_of_memory),
        **values,
    )


def show_index(measured: MeasuredIndex, *, helps: bool = True) -> str:
    """Write an index with its bounds: `mean_response_time 94.1 ms (93.5 to 94.8 ms)`.

    Args:
        measured: with its estimate, in the unit of the index.
        helps: as of `describe_overload`.

    Returns:
        Words for a message; without an estimate the reason.
    """
    if measured.overload is not None:
        return f"{measured.index} grows without an end ({describe_overload(measured.overload, helps=helps)})"
    if measured.estimate is None:
        return f"{measured.index} cannot be told: {measured.reason}"
    index = index_named(measured.index)
    value = show_value(index, measured.estimate.value)
    if measured.estimate.beyond is not None:
        return f"{measured.index} {value} {describe_extreme(measured.estimate.beyond)}"
    return f"{measured.index} {value} ({show_range(index, measured.estimate.lower, measured.estimate.upper)})"


def index_facts(measured: MeasuredIndex) -> dict[str, Any]:
    """Return the numbers of an index against its threshold, in its own unit.

    Args:
        measured: with or without an estimate.

    Returns:
        Without `value` where there is no estimate; `lower` and `upper` only where the samples give these bounds.
    """
    facts: dict[str, str | float] = {
        "component": measured.component,
        "index": measured.index,
        "unit": measured.unit,
        "threshold": float(measured.threshold.value),
    }
    if measured.estimate is not None:
        bounds = {"value": measured.estimate.value, "lower": measured.estimate.lower, "upper": measured.estimate.upper}
        facts |= {name: bound for name, bound in bounds.items() if isfinite(bound)}
        facts["samples"] = measured.estimate.samples
    return facts


def _not_achievable(
    experiment: Experiment, reserve: ReservePercent, settings: tuple[Setting, ...], places: Places
) -> Iterator[Diagnostic]:
    last = [setting for setting in settings if setting.reserve == reserve][-1:]
    most = "" if reserve == 100 else f" {reserve} % of its VPs is the most that {experiment.host.name} can give it now."
    first, last_resort = "Relax the threshold (", "make the component cheaper, or use a faster platform."
    if most:
        first = "Free the host, where something else holds its processors; else relax the threshold ("
    for setting in last:
        waiting = _waits_elsewhere(setting, experiment)
        indexes = measured_indexes(setting, experiment)
        # What is on the right side, and not for sure, is not met either.
        for measured in [index for index in indexes if index.misses] or indexes:
            helps = measured.component not in waiting
            several = len(experiment.apts[measured.component]) > 1
            yield NOT_ACHIEVABLE.at(
                places.value("components", measured.component, "apt", measured.index),
                "{component} at {reserve_percent} % of its VPs: {_measured}, and its threshold is {_asked}.{_most}",
                NO_MORE_CPU
                if not helps
                else prose(
                    first,
                    command("select", measured.component, at="LEVEL", index=several and measured.index),
                    f" says which level holds){'.' if most else f', {last_resort}'}",
                ),
                address=f"component/{measured.component}",
                reserve_percent=reserve,
                _measured=show_index(measured, helps=helps),
                _asked=show_threshold(index_named(measured.index), measured.threshold),
                _most=most,
                **index_facts(measured),
            )


def _waits_elsewhere(setting: Setting, experiment: Experiment) -> list[str]:
    """Return the component, alone in its partition, that falls behind and would with all processors, too."""
    if len(experiment.members) > 1:
        return []
    return [
        series.component
        for series in setting.series
        if (overload := find_overload(series, experiment.runs[series.component], error=LOOK_ERROR))
        and not more_processors_help(overload, setting.reserve / 100, experiment.setup.processors)
    ]


def _not_resolved(
    experiment: Experiment, end: NotResolved, settings: tuple[Setting, ...], places: Places
) -> Iterator[Diagnostic]:
    first = experiment.members[0].name
    unsteady = _unsteady(settings[-1:])
    for reserve, component, why in unsteady:
        yield NO_STEADY_STATE.at(
            places.key("components", component),
            "{component} at {reserve_percent} % of its VPs: {reason}.",
            f"Look for what grows while it runs{_or_more_time(settings[-1], experiment)}.",
            address=f"component/{component}",
            component=component,
            reserve_percent=reserve,
            reason=why,
        )
    if unsteady:
        return
    highest = max(settings, key=lambda setting: setting.reserve, default=None)
    shown = [show_index(index) for index in measured_indexes(highest, experiment)] if highest else []
    # NOTE: the highest setting of a search that may go on may be clear.
    early = "" if end.more_settings or end.ends_at_until else _ended_early(highest, experiment)
    advice, numbers = _how_to_show(end, highest, experiment)
    yield NOT_RESOLVED.at(
        places.value("components", first, "apt"),
        "{experiment}: {_parts:;}.{_early}",
        advice,
        address=f"component/{first}",
        components=tuple(member.name for member in experiment.members),
        reason=end.reason,
        experiment=experiment.name,
        _parts=(end.reason, *shown),
        _early=early,
        **numbers,
    )


def _how_to_show(end: NotResolved, highest: Setting | None, experiment: Experiment) -> tuple[Wording, dict[str, Any]]:
    """Return what would tell whether a threshold holds, and the numbers behind that."""
    there = min((len(series.samples) for series in highest.series), default=0) if highest else 0
    taken = counted(there, "sample")
    move_away = f"Move the threshold away from what the component just reaches: {MOST_SAMPLES} samples would not tell."
    if end.more_settings:
        more = counted(end.more_settings, "setting")
        return f"Run the same command: up to {more} more may show one.", {"more_settings": end.more_settings}
    if highest is None or not there or (end.samples or 0) > MOST_SAMPLES:
        return move_away, {}
    if end.ends_at_until:
        many = min(MOST_SAMPLES, end.samples or 10 * there)
        again = command("measure", *experiment.setup.members, strategy="paper", again=True, samples=many)
        longer = prose(f"A setting ends at `run.until` at the latest: {taken} were taken. Take more: ", again, ".")
        return longer, {"samples": there}
    spent = show_duration(highest.host_ms)
    if end.samples is not None:
        takes_ms = highest.host_ms * end.samples / there
        advice = (
            f"{spent} were spent: {taken} were taken, and about {end.samples} would show it, in "
            f"{show_duration(takes_ms)} a setting. Allow that: {_setting_budget(1.5 * takes_ms, experiment)}."
        )
        return advice, {"samples": there, "needs_samples": end.samples, "takes_ms": takes_ms}
    if there < MOST_SAMPLES:
        advice = (
            f"{spent} were spent on {taken}, which do not say yet how many would show it. "
            f"Allow more: {_setting_budget(3 * highest.host_ms, experiment)}."
        )
        return advice, {"samples": there}
    return move_away, {}


def _setting_budget(time_ms: float, experiment: Experiment) -> str:
    """Return what to write so that a setting may take so long with each of the loads that share its budget."""
    minutes = ceil(len(experiment.loads) * time_ms / 60_000)
    return f"`policy: {{ measuring: {{ setting: {minutes} min }} }}`"


def _ended_early(setting: Setting | None, experiment: Experiment) -> str:
    """Say that the budget was not spent, if so."""
    if setting is None or setting.host_ms >= (budget_ms := experiment.budget.at(setting.reserve)):
        return ""
    took, may_take = show_duration(setting.host_ms), show_duration(budget_ms)
    return f" The setting ended after {took} of the {may_take} that it may take: the rest would hardly have shown it."


def _or_more_time(setting: Setting, experiment: Experiment) -> str:
    """Add the advice to raise the budget, if it ended a setting before its steady state could show."""
    if max(len(series.samples) for series in setting.series) >= LONG:
        return ""
    return f", or allow it more time: {_setting_budget(3 * experiment.budget.at(setting.reserve), experiment)}"


def _unsteady(settings: Iterable[Setting]) -> list[tuple[int, str, str]]:
    """Return the CR, the component and the reason of each series without a steady state."""
    return [
        (setting.reserve, series.component, reason)
        for setting in settings
        for series in setting.series
        if (reason := why_unsteady(series))
    ]


def _less_unknown(
    experiment: Experiment, end: Sufficient, settings: tuple[Setting, ...], places: Places
) -> Iterator[Diagnostic]:
    """Warn where between the answer and the next CR that missed there are only settings without a steady state."""
    if end.more_settings or not end.inconclusive or end.reserve - (end.failed or 0) <= WIDTH:
        return
    highest = [setting for setting in settings if setting.reserve == end.inconclusive[-1]]
    reserve, component, reason = _unsteady(highest)[-1]
    more_time = _or_more_time(highest[-1], experiment)
    pronoun = "it" if len(end.inconclusive) == 1 else "they"
    lowest = f"; {end.failed} % of them is too little" if end.failed else ""
    yield LESS_UNKNOWN.at(
        places.value("components", experiment.members[0].name, "apt"),
        "{experiment}: {reserve_percent} % of its VPs is enough{_lowest}. Of {unsteady_percent:all} % of them "
        "nothing is known: {_pronoun} reached no steady state ({component} at {_reserve} % of its VPs: "
        "{reason}).",
        f"Look for what grows in {component} while it runs{more_time}. Or leave it.",
        address=f"component/{experiment.members[0].name}",
        components=tuple(member.name for member in experiment.members),
        reserve_percent=end.reserve,
        failed_percent=end.failed or 0,
        unsteady_percent=tuple(map(str, end.inconclusive)),
        experiment=experiment.name,
        _lowest=lowest,
        _pronoun=pronoun,
        component=component,
        _reserve=reserve,
        reason=reason,
    )


def _fixed_anyway(experiment: Experiment, reserve: ReservePercent, places: Places) -> Iterator[Diagnostic]:
    """Report a component measured alone whose fixed reserve a plan takes instead of the measured one."""
    for member in experiment.members if len(experiment.members) == 1 else ():
        if member.cpu.reserve is None or isinstance(member.cpu.reserve, Measured):
            continue
        yield FIXED_ANYWAY.at(
            places.value("components", member.name, "cpu", "reserve"),
            "{component} meets its thresholds with {_show_reserve}, and the manifest reserves {fixed} for "
            "it all the same.",
            "For a plan to take what was measured, write `reserve: measured`, or "
            f"`reserve: {show_processors(guaranteed(reserve, experiment.setup.processors))}`.",
            address=f"component/{member.name}",
            component=member.name,
            measured_percent=reserve,
            fixed=show_amount(member.cpu.reserve),
            _show_reserve=show_reserve(reserve, experiment.setup.processors),
        )


def _wasted_processors(
    experiment: Experiment, reserve: ReservePercent, settings: tuple[Setting, ...], places: Places
) -> Iterator[Diagnostic]:
    """Report fixed virtual processors that are not used: a CR is per cent of all of them."""
    processors, used = experiment.setup.processors, most_used(settings)
    if not experiment.fixes_processors or used is None or used >= processors:
        return
    names = in_a_row(experiment.setup.members)
    now, then = (show_processors(guaranteed(reserve, count)) for count in (processors, used))
    yield VPS_USED.at(
        places.key("components", experiment.members[0].name),
        "{_names} used at most {used_processors} of the {processors} virtual processors that the manifest "
        "fixes at once. A CR of {reserve_percent} % of its VPs is {_now}, and would be {_then} with "
        "{used_processors}.",
        prose("Leave `processors` out, and measure again: ", command("measure", *experiment.setup.members), "."),
        address=f"component/{experiment.members[0].name}",
        components=tuple(experiment.setup.members),
        processors=processors,
        used_processors=used,
        reserve_percent=reserve,
        _names=names,
        _now=now,
        _then=then,
    )


def more_processors(experiment: Experiment, used: int, places: Places) -> Diagnostic:
    """Make the finding that components use more processors at once than was seen before.

    Args:
        experiment: As it was measured, with the number that was seen before.
    """
    processors = experiment.setup.processors
    return VPS_USED.at(
        places.key("components", experiment.members[0].name),
        "{components:all} used {used_processors} processors at once, and at most {processors} when its "
        "number of virtual processors was chosen. It is measured with {used_processors} from here on; "
        "settings with {processors} stay in the log and no longer count.",
        "Nothing. To keep a number, write it: `processors`.",
        address=f"component/{experiment.members[0].name}",
        components=tuple(experiment.setup.members),
        processors=processors,
        used_processors=used,
    )


MEMORY_KILLS = Finding.warning("RARMS394", "The kernel killed processes that needed more memory")
WORK_OUTSIDE = Finding.warning("RARMS393", "A component's work may run outside its partition")

LEAST_USE = 1e-3
"""Processor time for each unit of response time: a component that uses less mostly waits."""

_ID = re.compile(r"[0-9a-f]{16,}")
"""The id of a container or of a transient unit in a group's name: each start has another."""

SAME_TIMES = 0.1
"""Mean response times that differ by at most this part do not change with CR."""

MORE_MEMORY = "Raise `memory` of the component or of its partition, and try again."


def why_out_of_memory(killed: int) -> str:
    """Say that the kernel killed so many processes of a component; empty: it killed none."""
    processes = "1 process" if killed == 1 else f"{killed} processes"
    why = f" The kernel killed {processes} of its partition, because the partition's memory was used up."
    return why if killed else ""


def work_of_evidence(names: Sequence[str], evidence: Sequence[SettingEvidence], places: Places) -> Iterator[Diagnostic]:
    """Find work outside of the components' groups, and processes killed for memory.

    Args:
        evidence: Counts of the host, of each setting or start; entries of one process and group are added up.
    """
    found = add_up(replace(work, group=_ID.sub("*", work.group)) for each in evidence for work in each.outside)
    escaped = [work for work in found if work.component]
    others = [work for work in found if not work.component]
    sentences = []
    if escaped:
        left = in_a_row(sorted({work.component for work in escaped}))
        sentences.append(f"Processes of {left} left their group: {'; '.join(map(_described, escaped))}.")
    if others:
        sentences.append(
            f"While {in_a_row(names)} ran, processes outside used more processor time: "
            f"{'; '.join(map(_described, others))}. The reservation does not reach them."
        )
    if found:
        yield WORK_OUTSIDE.at(
            places.key("components", names[0]),
            "{_sentences}",
            'Start the work in the partition: a container with --cgroup-parent "$RARMS_CGROUP_PARENT", a unit of '
            "systemd with --slice. If these are other programs, stop them and try again.",
            address=f"component/{names[0]}",
            components=tuple(names),
            processes=tuple(work.name for work in found),
            groups=tuple(work.group for work in found),
            outside_cpu_ms=sum(work.cpu_ms for work in found),
            _sentences=" ".join(sentences),
        )
    killed = Counter[str]()
    for each in evidence:
        killed.update(each.out_of_memory)
    for component, count in sorted(killed.items()):
        yield MEMORY_KILLS.at(
            places.key("components", component),
            "{component}:{_kills}",
            MORE_MEMORY,
            address=f"component/{component}",
            component=component,
            killed_for_memory=count,
            _kills=why_out_of_memory(count),
        )


def work_of_settings(experiment: Experiment, settings: Sequence[Setting], places: Places) -> Iterator[Diagnostic]:
    """Find work outside of P1, components that only wait, and kills for memory, in the settings of an experiment.

    Args:
        settings: All settings, with one load or several.
    """
    evidence = [setting.evidence for setting in settings if setting.evidence is not None]
    yield from work_of_evidence(experiment.setup.members, evidence, places)
    by_reserve: dict[str, dict[int, list[Series]]] = {}
    for setting in settings:
        if setting.evidence is not None:
            for series in setting.series:
                by_reserve.setdefault(series.component, {}).setdefault(setting.reserve, []).append(series)
    for name, series_at in sorted(by_reserve.items()):
        if (use := unused_time(series_at)) is not None:
            low, high = min(series_at), max(series_at)
            yield WORK_OUTSIDE.at(
                places.key("components", name),
                "{component} used {_shown} of processor time in each second of response time, and its "
                "response times are the same at {lowest} % and at {highest} % of its VPs.",
                prose("Find out where its work runs. A reservation does not shorten the wait for another machine."),
                address=f"component/{name}",
                component=name,
                cpu_ms_per_second=use * 1000,
                lowest=low,
                highest=high,
                _shown=_shown(use * 1000),
            )


def unused_time(series_at: Mapping[int, Sequence[Series]]) -> float | None:
    """Return the processor time for each unit of response time of a component that only waits.

    Returns:
        Less than `LEAST_USE`; None: it used more, a series has no `cpu_ms`, fewer than two reserves were measured, or
        its mean response times differ by more than `SAME_TIMES`.
    """
    used = answered = 0.0
    means = []
    for all_series in series_at.values():
        times = [time for series in all_series for time in response_times(series.samples)]
        if not times or any(series.cpu_ms is None for series in all_series):
            return None
        used += sum(series.cpu_ms or 0.0 for series in all_series)
        answered += sum(times)
        means.append(fmean(times))
    if len(means) < 2 or not answered or used >= LEAST_USE * answered:
        return None
    return used / answered if max(means) <= (1 + SAME_TIMES) * min(means) else None


def _shown(time_ms: float) -> str:
    return f"{time_ms:.2g} ms" if time_ms < 10 else f"{time_ms:.0f} ms"


def _described(work: OutsideWork) -> str:
    name = work.name if work.processes else "processes that ended"
    return f"{name}{f' in {work.group}' if work.group.strip('/') else ''} {_shown(work.cpu_ms)}"


LEAST_SHARE = 0.01
"""Part of the processor time from which a process or limit is listed."""

_LIMITS = {P1: "the limit of P1", P2: "the limit of P2", ALL_PARTITIONS: "the limit of all partitions"}


def describe_idle(load: str, evidence: SettingEvidence, host: Host) -> str:
    """Describe the processor time that a load did not use, and the processes that used it.

    Returns:
        Sentences.
    """
    shared = shared_processors(host, host.logical_processors)
    whole_ms = evidence.elapsed_ms * float(shared)
    idle = f"{load} left {100 * idle_share(evidence, shared):.0f} % of {show_processors(shared)}."
    had = [
        f"{work.name}{f' in {work.group}' if work.group.strip('/') else ''} had {100 * work.cpu_ms / whole_ms:.0f} %"
        for work in evidence.others
        if work.cpu_ms >= LEAST_SHARE * whole_ms
    ]
    limits = [
        f"{_LIMITS[name]} stopped its threads for {show_duration(time_ms)}, added up over the processors"
        for name, time_ms in sorted(evidence.throttled_ms.items())
        if name in _LIMITS and time_ms >= LEAST_SHARE * evidence.elapsed_ms
    ]
    reasons = [f"Of {show_processors(shared)}, {in_a_row(had)}."] if had else []
    reasons += [f"{reason[0].upper()}{reason[1:]}." for reason in limits]
    return " ".join((idle, *(reasons or ["No other process and no limit had it: the load waited."])))


def weak_answer(
    hosts: Hosts, members: tuple[str, ...], idle: Mapping[str, SettingEvidence | None], host: Host
) -> Diagnostic:
    """Make the finding on a result whose loads leave processors idle.

    Args:
        hosts: The manifest, with the positions of its lines.
        idle: By load, the counts of a setting in which it left processors idle; None: there is no such setting.
    """
    loads = tuple(idle)
    seen = {name: evidence for name, evidence in idle.items() if evidence is not None}
    idle_loads = "".join(f" {describe_idle(name, evidence, host)}" for name, evidence in seen.items())
    facts: dict[str, Any] = {}
    for evidence in [*seen.values()][:1]:
        facts = {
            "idle_percent": 100 * idle_share(evidence, shared_processors(host, host.logical_processors)),
            "processes": tuple(work.name for work in evidence.others),
            "groups": tuple(work.group for work in evidence.others),
            "throttled_ms": sum(evidence.throttled_ms.values()),
        }
    again = BUSY_LOOP in loads and could_take_all(hosts.system.interference[BUSY_LOOP], host.logical_processors)
    measure = command("measure", *members, interference=BUSY_LOOP, together=len(members) > 1, again=again)
    advice = advice_on_weak_loads(hosts.system, host, members, loads, measure)
    return WEAK_ANSWER.at(
        hosts.manifest.places.key("components", members[0]),
        "{loads:all} {_verb} not take all that {components:all} did not reserve on {host}.{_idle_loads} "
        "The reservation that is enough with it may be too small with other loads.",
        prose(advice, " Or use it all the same: --weak-load."),
        address=f"component/{members[0]}",
        components=tuple(members),
        loads=loads,
        host=host.name,
        _verb="did" if idle_loads else "can",
        _idle_loads=idle_loads,
        **facts,
    )


HUNDREDTHS = 100
"""LPs are told in hundredths, rounded up where they are asked for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WaysOut:
    """What would let a component meet the threshold that it missed in the layout."""

    helps: bool  # False: it waits for something else than a processor
    reserved_lp: Fraction | None  # of its partition; None: it has none, or runs in the host's own system
    asked_lp: Fraction | None  # that its slowdown asks for; None: nothing tells
    free_lp: Fraction  # that its host has left
    hosts: Mapping[str, Fraction]  # others that have what is asked for, with the LPs that they have left
    processors: int  # VPs of its partition; 0: it has none
    shares_with: tuple[str, ...]  # components in its partition
    holds: Threshold | None  # the tightest that was shown to be met; None: there is none

    @property
    def facts(self) -> Facts:
        """The values behind the ways out, as a finding carries them."""
        facts: dict[str, str | float | tuple[str, ...]] = {"free_lp": float(self.free_lp)}
        if self.asked_lp is not None:
            facts["asked_lp"] = float(self.asked_lp)
        if self.hosts:
            facts["other_hosts"] = tuple(self.hosts)
        if self.shares_with:
            facts["shares_with"] = self.shares_with
        if self.holds is not None:
            facts["threshold_that_holds"] = float(self.holds.value)
        return facts


def proof_findings(
    hosts: Hosts, proofs: Sequence[LayoutProof], states: Mapping[str, State], *, load_host: bool
) -> Iterator[Diagnostic]:
    """Report every threshold that a proof did not show to be met.

    Args:
        states: of all hosts that could be reached, as they were before the proof.
        load_host: whether the use of all idle time was asked for, so that it is recommended with the next proof.

    Returns:
        Findings in the order of the proofs; a miss has its ways out.
    """
    free = {name: _free_lp(hosts, name, state) for name, state in sorted(states.items())}
    more_samples = _more_samples(proofs, load_host=load_host)
    for proof in proofs:
        for verdict in proof.not_met:
            measured, ways = verdict.measured, _ways_out(hosts, proof, verdict, free)
            index, load = index_named(measured.index), proof.interference
            with_load = f" under {load}" if load else ""
            finding, advice = _finding_of(verdict, ways, more_samples)
            facts: dict[str, Any] = {**index_facts(measured), **({"interference": load} if load else {})}
            if verdict.samples_needed:
                facts["samples_needed"] = verdict.samples_needed
            if isinstance(verdict.verdict, Missed):
                facts |= ways.facts
            yield finding.at(
                hosts.manifest.places.value("components", measured.component, "apt", measured.index),
                "{component} on {host}{_with_load}: {_measured}, and its threshold is {_asked}.",
                advice,
                address=f"component/{measured.component}",
                host=proof.host,
                _with_load=with_load,
                _measured=show_index(measured, helps=ways.helps),
                _asked=show_threshold(index, measured.threshold),
                **facts,
            )


def _finding_of(verdict: IndexVerdict, ways: WaysOut, more_samples: Wording) -> tuple[Finding, Wording]:
    """Return the finding for a verdict that is not met, and the advice with it."""
    match verdict.verdict:
        case Unsteady():
            return NO_STEADY_STATE, "Look for what grows while it runs."
        case WithinNoise() | TooFewSamples() | TooManyFailures():
            return NOT_RESOLVED, more_samples if verdict.samples_needed else _TOO_NEAR
        case Met() | Missed():
            return MISSED, _advice(verdict.measured, ways)
        case _:
            assert_never(verdict.verdict)


_TOO_NEAR = "It is too near its threshold for any number of samples: raise its reservation, or relax its APT."


def _more_samples(proofs: Sequence[LayoutProof], *, load_host: bool) -> Wording:
    """Advise one proof for all that is not shown yet, with the samples of the index that needs most."""
    many = max((verdict.samples_needed or 0 for proof in proofs for verdict in proof.not_met), default=0)
    takes = show_duration(many * sum(map(_sample_ms, proofs)))
    return prose(
        f"About {many} samples of each component may tell, in about {takes}: ",
        command("prove", samples=many, load_host=load_host),
        ". Or raise its reservation.",
    )


def _sample_ms(proof: LayoutProof) -> float:
    """Return the user's waiting time for a sample of each component."""
    return 1000 * proof.wall_seconds / min((len(series.samples) or 1 for series in proof.series.values()), default=1)


def _advice(measured: MeasuredIndex, ways: WaysOut) -> Wording:
    """Write each way out as its own sentence."""
    if not ways.helps:
        return NO_MORE_CPU
    sentences = list(_reserves(measured, ways))
    if ways.shares_with:
        sentences.append(f"Give it a partition of its own, without {in_a_row(ways.shares_with)}: `dedicated: true`.")
    if ways.holds is not None:
        sentences.append(f"A threshold of {show_threshold(index_named(measured.index), ways.holds)} held.")
    again = command("measure", measured.component, again=True, stop_partitions=True)
    return prose(" ".join(sentences), " Or measure what it needs: ", again, ".")


def _reserves(measured: MeasuredIndex, ways: WaysOut) -> Iterator[str]:
    if ways.reserved_lp is None:
        yield "It runs in the host's own system, where nothing is reserved for it: give it a partition."
        return
    if ways.asked_lp is None:
        yield f"Raise its reservation: {show_processors(ways.free_lp)} are free on its host."
        return
    asks = f"asks for about {show_processors(ways.asked_lp)}, and its partition has {show_processors(ways.reserved_lp)}"
    more = ways.asked_lp - ways.reserved_lp
    why = "Its demand" if measured.overload else "Its slowdown"
    if more <= ways.free_lp:
        yield f"{why} {asks}: reserve that, of the {show_processors(ways.free_lp)} that are free on its host."
    else:
        yield f"{why} {asks}; its host has only {show_processors(ways.free_lp)} left."
    if 0 < ways.processors < ways.asked_lp:
        yield f"That is more than {counted(ways.processors, 'virtual processor')} can give: it needs more of them."
    for name, free in ways.hosts.items():
        yield f"Or put it on {name}, which has {show_processors(free)} left."


def _ways_out(hosts: Hosts, proof: LayoutProof, verdict: IndexVerdict, free: Mapping[str, Fraction]) -> WaysOut:
    measured, layout = verdict.measured, proof.layout
    name = measured.component
    partition = layout.partition_of(name)
    reserved = layout.reserves.get(partition)
    reserved_lp = None if reserved is None else Fraction(reserved).limit_denominator(HUNDREDTHS**2)
    others = tuple(member.name for member in layout.partitions.get(partition, ()) if member.name != name)
    asked = None if reserved_lp is None else _asked_lp(measured, reserved_lp)
    component = hosts.system.components[name]
    elsewhere = {
        other: free_lp
        for other, free_lp in free.items()
        if asked is not None and other != proof.host and component.may_run_on(other) and free_lp >= asked
    }
    return WaysOut(
        helps=measured.overload is None or layout.more_processors_help(name, measured.overload),
        reserved_lp=reserved_lp,
        asked_lp=asked,
        free_lp=free.get(proof.host, Fraction(0)),
        hosts=elsewhere,
        processors=layout.processors.get(partition, 0),
        shares_with=others,
        holds=_threshold_that_held(measured),
    )


def _asked_lp(measured: MeasuredIndex, reserved_lp: Fraction) -> Fraction | None:
    """Return the LPs that it would need for its threshold, if its time is in inverse proportion to what it gets."""
    if measured.overload is not None:
        needed = measured.overload.needed_lp
        return None if needed is None else _round_up(needed)
    estimate, limit = measured.estimate, float(measured.threshold.value)
    if estimate is None or estimate.value <= 0.0 or limit <= 0.0:
        return None
    match index_named(measured.index).unit, measured.threshold:
        case Unit.TIME, AtMost():
            slowdown = estimate.value / limit
        case Unit.RATE, AtLeast():
            slowdown = limit / estimate.value
        case _:
            return None
    return _round_up(float(reserved_lp) * slowdown) if slowdown > 1.0 else None


def _round_up(lp: float) -> Fraction:
    return Fraction(ceil(lp * HUNDREDTHS), HUNDREDTHS)


def _threshold_that_held(measured: MeasuredIndex) -> Threshold | None:
    if measured.estimate is None:
        return None
    smaller_is_better = index_named(measured.index).smaller_is_better
    safe = measured.estimate.upper if smaller_is_better else measured.estimate.lower
    return threshold_met_by(measured.index, safe)


def _free_lp(hosts: Hosts, name: str, state: State) -> Fraction:
    system = hosts.system
    named = [group.name for group in groups_of(system)]
    return host_totals(system.hosts[name], state.facts, totals_after(state, system.application.name, (), named)).free_lp
