"""All findings of measuring, and the texts of those on the end of an experiment.

Each has its page in docs/findings. `other_work.py` has the texts on other work, idle loads and messages,
`missed_thresholds.py` those of a proof, `run_component.py` those of `rarms run`.
"""

from collections.abc import Iterable, Iterator, Sequence
from math import ceil, isfinite
from typing import Any, TypeAlias, assert_never

from rarms_iac.measuring.evidence import MeasuredIndex, measured_indexes, why_unsteady
from rarms_iac.model.commands import Wording, command, prose
from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.indexes import index_named
from rarms_iac.model.outcomes import (
    WIDTH,
    Conclusion,
    NotAchievable,
    NotResolved,
    SettingFailed,
    Stopped,
    Sufficient,
    Swept,
    TooManyFailures,
)
from rarms_iac.model.quantities import ReservePercent, guaranteed
from rarms_iac.model.series import MOST_SAMPLES
from rarms_iac.model.setting import Setting, most_used
from rarms_iac.model.system import Measured
from rarms_iac.statistics.distributions import LOOK_ERROR, describe_extreme
from rarms_iac.statistics.overload import describe_overload, find_overload, more_processors_help
from rarms_iac.statistics.verdicts import LONG
from rarms_iac.texts.findings import Finding
from rarms_iac.texts.indexes import show_range, show_threshold, show_value
from rarms_iac.texts.messages import counted
from rarms_iac.texts.quantities import show_amount, show_duration, show_processors, show_reserve

UNUSED_VPS = Finding.note("RARMS380", "Components have more processors than they use")
FAILURES = Finding.error("RARMS113", "Too many samples failed")
UNABLE = Finding.error("RARMS114", "The host cannot run the component")
OCCUPIED = Finding.error("RARMS115", "The host is not free to measure")
NOT_ACHIEVABLE = Finding.error("RARMS110", "Threshold performance is not achievable on this platform.")
NOT_RESOLVED = Finding.error("RARMS111", "The samples do not show whether a threshold is met")
NO_STEADY_STATE = Finding.error("RARMS112", "A component does not reach a steady state")
NOT_APPLIED = Finding.error("RARMS119", "The layout is not on the host")
STILL_STOPPED = Finding.error("RARMS269", "Partitions did not start again after a measurement")
FIXED_ANYWAY = Finding.note("RARMS266", "The manifest fixes a measured reservation")
LESS_UNKNOWN = Finding.warning("RARMS267", "A smaller reservation may be enough; it had no steady state")
MISSED = Finding.error("RARMS118", "A component misses its threshold in the layout")
MISSED_UNRESERVED = Finding.warning("RARMS288", "A threshold is missed even without load")
OTHER_FILE = Finding.error("RARMS411", "A file of a component differs on the robot")
WEAK_ANSWER = Finding.error("RARMS326", "A measurement with weak loads was rejected")
BUSY_HOST = Finding.note("RARMS392", "Other programs used more processor time than the component")
WORK_OUTSIDE = Finding.warning("RARMS393", "A component's work runs outside its partition")
MEMORY_KILLS = Finding.warning("RARMS394", "The kernel killed processes for lack of memory")
THREADS = Finding.warning("RARMS395", "Threads do not have the priority of their task class")
OTHER_CLOCK = Finding.warning("RARMS430", "Message stamps are from another clock")
SIMULATED_TIME = Finding.warning("RARMS431", "The robot runs on simulated time")

NO_MORE_CPU = "More CPU time does not help: the jobs wait for something else. Increase the period, or shorten the wait."
"""The advice to a component that falls behind on all processors."""

MORE_MEMORY = "Raise `memory` of the component or of its partition, and try again."

MeasuredExperiment: TypeAlias = tuple[Experiment, ReservePercent, Sequence[Setting]]
"""An experiment with its answer and its settings."""

MINUTE_MS = 60_000

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
    run_alone = prose("Run the component alone and correct the cause: ", command("run", component), ". ")
    allow = f"Or allow failed samples: `run: {{ failures: {count} }}`."
    return FAILURES.at(
        places.key("components", component),
        (
            "{component} {setting}: {failed_samples:sample} failed, but `run.failures` allows {allowed}: "
            "{reasons}.{_why_out_of_memory}"
        ),
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


def why_out_of_memory(killed: int) -> str:
    """Say that the kernel killed so many processes of a component; empty: it killed none."""
    processes = "1 process" if killed == 1 else f"{killed} processes"
    why = f" The kernel killed {processes} of its partition, because the partition ran out of memory."
    return why if killed else ""


def show_index(measured: MeasuredIndex, *, helps: bool = True) -> str:
    """Write an index with its bounds: `mean_response_time 94.1 ms (93.5 to 94.8 ms)`.

    Args:
        measured: with its estimate.

    Returns:
        Words for a message; without an estimate the reason.
    """
    if measured.overload is not None:
        return f"{measured.index} keeps growing ({describe_overload(measured.overload, helps=helps)})"
    if measured.estimate is None:
        return f"{measured.index} is not known: {measured.reason}"
    index = index_named(measured.index)
    estimate, threshold = measured.estimate, measured.threshold
    value = show_value(index, estimate.value, threshold)
    if estimate.beyond is not None:
        return f"{measured.index} {value} {describe_extreme(estimate.beyond)}"
    return f"{measured.index} {value} ({show_range(index, estimate.lower, estimate.upper, threshold)})"


def index_facts(measured: MeasuredIndex) -> dict[str, Any]:
    """Return the numbers of an index against its threshold, in its own unit.

    Args:
        measured: with or without an estimate.

    Returns:
        Without `value` without an estimate; `lower` and `upper` only where the samples give these bounds.
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
    most = (
        ""
        if reserve == 100
        else f" {experiment.host.name} cannot give the component more than {reserve} % of its VPs now."
    )
    otherwise = "free processors on the host" if most else "make the component cheaper, or use a faster platform"
    for setting in last:
        waiting = _waits_elsewhere(setting, experiment)
        indexes = measured_indexes(setting, experiment)
        # What is on the right side, and not for sure, is not met either.
        for measured in [index for index in indexes if index.misses] or indexes:
            helps = measured.component not in waiting
            several = len(experiment.apts[measured.component]) > 1
            yield NOT_ACHIEVABLE.at(
                places.value("components", measured.component, "apt", measured.index),
                "{component} at {reserve_percent} % of its VPs: {_measured}; the threshold is {_asked}.{_most}",
                NO_MORE_CPU
                if not helps
                else prose(
                    "Relax the threshold: ",
                    command("select", measured.component, at="LEVEL", index=several and measured.index),
                    f". Or {otherwise}.",
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
            f"Check for a growing queue or cache{_or_more_time(settings[-1], experiment)}.",
            address=f"component/{component}",
            component=component,
            reserve_percent=reserve,
            reason=why,
        )
    if unsteady:
        return
    highest = max(settings, key=lambda setting: setting.reserve, default=None)
    shown = [show_index(index) for index in measured_indexes(highest, experiment)] if highest else []
    advice, numbers = _how_to_show(end, highest, experiment)
    early = _ended_early(highest, experiment) if "needs_setting_ms" in numbers else ""
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
    """Return the advice that would decide a threshold, and its numbers."""
    series = highest.series if highest else ()
    there = min((len(each.samples) for each in series if end.member in ("", each.component)), default=0)
    taken = counted(there, "sample") + (f" of {end.member}" if end.member and len(series) > 1 else "")
    move_away = f"Change the threshold. The measured value is too close to decide with {MOST_SAMPLES} samples."
    if end.more_settings:
        more = counted(end.more_settings, "setting")
        return f"Run the same command to continue with up to {more} more.", {"more_settings": end.more_settings}
    if highest is None or not there or (end.samples or 0) > MOST_SAMPLES:
        return move_away, {}
    if end.ends_at_until:
        many = min(MOST_SAMPLES, end.samples or 10 * there)
        again = command("measure", *experiment.setup.members, strategy="paper", again=True, samples=many)
        longer = prose(f"`run.until` ended the setting after {taken}. Take more samples: ", again, ".")
        return longer, {"samples": there}
    spent = show_duration(highest.host_ms)
    if end.samples is not None:
        takes_ms = highest.host_ms * end.samples / there
        minutes = _more_minutes(1.5 * takes_ms, experiment)
        each = f" with each of {len(experiment.loads)} loads" if len(experiment.loads) > 1 else ""
        advice = (
            f"{taken} took {spent}. The threshold needs about {end.samples} samples, {show_duration(takes_ms)} "
            f"per setting{each}. Allow more time: {_setting_budget(minutes)}."
        )
        needs = {"needs_samples": end.samples, "takes_ms": takes_ms, "needs_setting_ms": minutes * MINUTE_MS}
        return advice, {"samples": there, **needs}
    if there < MOST_SAMPLES:
        minutes = _more_minutes(3 * highest.host_ms, experiment)
        advice = (
            f"{taken} took {spent}. The necessary number is not known yet. Allow more time: {_setting_budget(minutes)}."
        )
        return advice, {"samples": there, "needs_setting_ms": minutes * MINUTE_MS}
    return move_away, {}


def _more_minutes(time_ms: float, experiment: Experiment) -> int:
    """Return a budget with so much time under each of the loads that share it: at least twice the present one.

    NOTE: a setting also ends early where the rest of its budget would not be enough. Less than now cannot help.
    """
    return ceil(max(len(experiment.loads) * time_ms, 2 * experiment.budget.most_ms) / MINUTE_MS)


def _setting_budget(minutes: int) -> str:
    """Return the manifest's line that gives a setting so much time."""
    return f"`policy: {{ measuring: {{ setting: {minutes} min }} }}`"


def _ended_early(setting: Setting | None, experiment: Experiment) -> str:
    """Say that the budget was not spent, if so."""
    if setting is None or setting.host_ms >= (budget_ms := experiment.budget.at(setting.reserve)):
        return ""
    took, may_take = show_duration(setting.host_ms), show_duration(budget_ms)
    return f" The setting ended after {took}, because the rest of its {may_take} would probably not be enough."


def _or_more_time(setting: Setting, experiment: Experiment) -> str:
    """Add the advice to raise the budget, if it ended a setting before its steady state could show."""
    if max(len(series.samples) for series in setting.series) >= LONG:
        return ""
    minutes = _more_minutes(3 * experiment.budget.at(setting.reserve), experiment)
    return f", or measure longer: {_setting_budget(minutes)}"


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
    lowest = f"; {end.failed} % is too little" if end.failed else ""
    yield LESS_UNKNOWN.at(
        places.value("components", experiment.members[0].name, "apt"),
        (
            "{experiment}: {reserve_percent} % of its VPs is enough{_lowest}. rarms did not judge "
            "{unsteady_percent:all} %. {component} at {_reserve} % of its VPs: {reason}."
        ),
        f"Check {component} for a growing queue{more_time}. It is safe to ignore this.",
        address=f"component/{experiment.members[0].name}",
        components=tuple(member.name for member in experiment.members),
        reserve_percent=end.reserve,
        failed_percent=end.failed or 0,
        unsteady_percent=tuple(map(str, end.inconclusive)),
        experiment=experiment.name,
        _lowest=lowest,
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
            "{component} meets its thresholds with {_show_reserve}, but the manifest fixes {fixed}.",
            "Plans use the fixed value. To use the measured value, write `reserve: measured`, or "
            f"`reserve: {show_processors(guaranteed(reserve, experiment.setup.processors))}`.",
            address=f"component/{member.name}",
            component=member.name,
            measured_percent=reserve,
            fixed=show_amount(member.cpu.reserve),
            _show_reserve=show_reserve(reserve, experiment.setup.processors),
        )


def unused_processors(answers: Iterable[MeasuredExperiment], places: Places) -> Iterator[Diagnostic]:
    """Report the fixed virtual processors that components do not use, once for each host.

    A CR is per cent of all virtual processors.

    Args:
        answers: of each partition the one that decides.
    """
    by_host: dict[str, list[tuple[Experiment, ReservePercent, int]]] = {}
    for experiment, reserve, settings in answers:
        used = most_used(settings)
        if experiment.fixes_processors and used is not None and used < experiment.setup.processors:
            by_host.setdefault(experiment.host.name, []).append((experiment, reserve, used))
    for host, unused in by_host.items():
        enough: dict[tuple[int, int], list[str]] = {}
        for experiment, reserve, used in unused:
            amount = show_processors(guaranteed(reserve, used))
            enough.setdefault((experiment.setup.processors, used), []).append(f"{experiment.name} {amount}")
        yield UNUSED_VPS.of_host(
            host,
            "{_sentences}",
            prose("Remove `processors` from the manifest, then: ", command("measure"), "."),
            place=places.key("components", unused[0][0].members[0].name) if len(unused) == 1 else None,
            components=tuple(experiment.name for experiment, _, _ in unused),
            processors=tuple(str(experiment.setup.processors) for experiment, _, _ in unused),
            used_processors=tuple(str(used) for _, _, used in unused),
            reserve_percent=tuple(str(reserve) for _, reserve, _ in unused),
            _sentences=" ".join(
                f"With {counted(used, 'VP')} instead of {processors}, less is enough: {', '.join(amounts)}."
                for (processors, used), amounts in enough.items()
            ),
        )
