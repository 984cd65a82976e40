"""The findings of measuring, each with its page in docs/findings, and how the end of an experiment becomes one."""

from collections.abc import Iterable, Iterator
from math import ceil, isfinite
from typing import assert_never

from rarms_iac.measuring.performance import MeasuredIndex, measured_indexes, why_unsteady
from rarms_iac.measuring.work_findings import MORE_MEMORY, why_out_of_memory
from rarms_iac.model.commands import Wording, command, prose
from rarms_iac.model.diagnostics import Diagnostic, Facts, Finding, Places
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.indexes import index_named, show_range, show_threshold, show_value
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
from rarms_iac.model.quantities import (
    ReservePercent,
    guaranteed,
    show_amount,
    show_duration,
    show_processors,
    show_reserve,
)
from rarms_iac.model.series import MOST_SAMPLES
from rarms_iac.model.setting import Setting, most_used
from rarms_iac.model.system import Measured
from rarms_iac.model.wording import counted, in_a_row
from rarms_iac.statistics.error_probability import LOOK_ERROR, describe_extreme
from rarms_iac.statistics.overload import describe_overload, find_overload, more_processors_help
from rarms_iac.statistics.verdicts import LONG

NOT_ACHIEVABLE = Finding.error("RARMS110", "Threshold performance is not achievable on this platform.")
NOT_RESOLVED = Finding.error("RARMS111", "It is not shown yet whether a threshold is met")
NO_STEADY_STATE = Finding.error("RARMS112", "A component reaches no steady state")
FAILED_SAMPLES = Finding.error("RARMS113", "Too many samples failed")
NOTHING_TO_RUN = Finding.error("RARMS114", "This host cannot run the component")
BUSY_HOST = Finding.error("RARMS115", "Something runs on the host")
RESERVED_HOST = Finding.error("RARMS116", "The paper's procedure needs a host without other reservations")
NO_ROOM = Finding.error("RARMS117", "There is no room for the test partitions")
MISSED = Finding.error("RARMS118", "A component misses its threshold in the layout")
NOT_APPLIED = Finding.error("RARMS119", "The layout is not on the host")
LEFT_BEHIND = Finding.note("RARMS261", "Test partitions of an earlier run were removed")
STILL_STOPPED = Finding.error("RARMS269", "Partitions that were stopped to measure do not run again")
CANNOT_MEASURE = Finding.error("RARMS262", "This version cannot measure on this host")
MEASURED_BUSY = Finding.warning("RARMS263", "Measured while something else ran")
NO_THRESHOLD = Finding.error("RARMS264", "There is no threshold to search for")
WEAK_ANSWER = Finding.error("RARMS326", "What was measured beside weak loads is no answer")
FIXED_ANYWAY = Finding.note("RARMS266", "The manifest fixes a reservation that was measured")
LESS_UNKNOWN = Finding.warning("RARMS267", "Less may be enough: settings below have no steady state")
WASTED_PROCESSORS = Finding.note("RARMS380", "Fixed virtual processors are not used")
MORE_PROCESSORS = Finding.note("RARMS381", "More processors are used at once than was seen before")


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


def failed_samples(failed: TooManyFailures, setting: str, places: Places, **values: float) -> Diagnostic:
    """Make the finding that more samples failed than a component allows.

    Args:
        failed: The verdict.
        setting: The setting or the layout, in words.
    """
    component, count = failed.component, len(failed.failures)
    reasons = "; ".join(dict.fromkeys(failed.failures[:SHOWN_FAILURES]))
    run_alone = prose("Run it alone and correct it: ", command("run", component), ". ")
    allow = f"Or allow that: `run: {{ failures: {count} }}`."
    return FAILED_SAMPLES.at(
        places.key("components", component),
        f"{component} {setting}: {counted(count, 'sample')} failed, and `run.failures` allows {failed.allowed}: "
        f"{reasons}.{why_out_of_memory(failed)}",
        MORE_MEMORY if failed.out_of_memory else prose(run_alone, allow),
        address=f"component/{component}",
        values={"component": component, "failed_samples": count, "killed_for_memory": failed.out_of_memory, **values},
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


def index_facts(measured: MeasuredIndex) -> Facts:
    """The numbers of an index beside its threshold, in its own unit.

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
                f"{measured.component} at {reserve} % of its VPs: {show_index(measured, helps=helps)}, and its "
                f"threshold is {show_threshold(index_named(measured.index), measured.threshold)}.{most}",
                NO_MORE_CPU
                if not helps
                else prose(
                    first,
                    command("select", measured.component, at="LEVEL", index=several and measured.index),
                    f" says which level holds){'.' if most else f', {last_resort}'}",
                ),
                address=f"component/{measured.component}",
                values={**index_facts(measured), "reserve_percent": reserve},
            )


def _waits_elsewhere(setting: Setting, experiment: Experiment) -> list[str]:
    """The component, alone in its partition, that falls behind and would with all processors, too."""
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
            f"{component} at {reserve} % of its VPs: {why}.",
            f"Look for what grows while it runs{_or_more_time(settings[-1], experiment)}.",
            address=f"component/{component}",
            values={"component": component, "reserve_percent": reserve, "reason": why},
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
        f"{experiment.name}: {'; '.join((end.reason, *shown))}.{early}",
        advice,
        address=f"component/{first}",
        values={"components": tuple(member.name for member in experiment.members), "reason": end.reason, **numbers},
    )


def _how_to_show(end: NotResolved, highest: Setting | None, experiment: Experiment) -> tuple[Wording, Facts]:
    """What would tell whether a threshold holds, and the numbers behind that."""
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
    """What to write so that a setting may take so long beside each of the loads that share its budget."""
    minutes = ceil(len(experiment.loads) * time_ms / 60_000)
    return f"`policy: {{ measuring: {{ setting: {minutes} min }} }}`"


def _ended_early(setting: Setting | None, experiment: Experiment) -> str:
    """That the budget was not spent, where it is not."""
    if setting is None or setting.host_ms >= (budget_ms := experiment.budget.at(setting.reserve)):
        return ""
    took, may_take = show_duration(setting.host_ms), show_duration(budget_ms)
    return f" The setting ended after {took} of the {may_take} that it may take: the rest would hardly have shown it."


def _or_more_time(setting: Setting, experiment: Experiment) -> str:
    """More advice where the budget ended a setting before its steady state could show."""
    if max(len(series.samples) for series in setting.series) >= LONG:
        return ""
    return f", or allow it more time: {_setting_budget(3 * experiment.budget.at(setting.reserve), experiment)}"


def _unsteady(settings: Iterable[Setting]) -> list[tuple[int, str, str]]:
    """The CR, the component and the reason of each series without a steady state."""
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
        f"{experiment.name}: {end.reserve} % of its VPs is enough{lowest}. "
        f"Of {in_a_row(end.inconclusive)} % of them nothing is known: "
        f"{pronoun} reached no steady state ({component} at {reserve} % of its VPs: {reason}).",
        f"Look for what grows in {component} while it runs{more_time}. Or leave it.",
        address=f"component/{experiment.members[0].name}",
        values={
            "components": tuple(member.name for member in experiment.members),
            "reserve_percent": end.reserve,
            "failed_percent": end.failed or 0,
            "unsteady_percent": tuple(map(str, end.inconclusive)),
        },
    )


def _fixed_anyway(experiment: Experiment, reserve: ReservePercent, places: Places) -> Iterator[Diagnostic]:
    """Of a component measured alone: a plan takes what the manifest fixes, and not this."""
    for member in experiment.members if len(experiment.members) == 1 else ():
        if member.cpu.reserve is None or isinstance(member.cpu.reserve, Measured):
            continue
        yield FIXED_ANYWAY.at(
            places.value("components", member.name, "cpu", "reserve"),
            f"{member.name} meets its thresholds with {show_reserve(reserve, experiment.setup.processors)}, and the "
            f"manifest reserves {show_amount(member.cpu.reserve)} for it all the same.",
            "For a plan to take what was measured, write `reserve: measured`, or "
            f"`reserve: {show_processors(guaranteed(reserve, experiment.setup.processors))}`.",
            address=f"component/{member.name}",
            values={"component": member.name, "measured_percent": reserve, "fixed": show_amount(member.cpu.reserve)},
        )


def _wasted_processors(
    experiment: Experiment, reserve: ReservePercent, settings: tuple[Setting, ...], places: Places
) -> Iterator[Diagnostic]:
    """Of what the manifest fixes: a CR is per cent of all virtual processors, whether they are used or not."""
    processors, used = experiment.setup.processors, most_used(settings)
    if not experiment.fixes_processors or used is None or used >= processors:
        return
    names = in_a_row(experiment.setup.members)
    now, then = (show_processors(guaranteed(reserve, count)) for count in (processors, used))
    yield WASTED_PROCESSORS.at(
        places.key("components", experiment.members[0].name),
        f"{names} used at most {used} of the {processors} virtual processors that the manifest fixes at once. A CR of "
        f"{reserve} % of its VPs is {now}, and would be {then} with {used}.",
        prose("Leave `processors` out, and measure again: ", command("measure", *experiment.setup.members), "."),
        address=f"component/{experiment.members[0].name}",
        values={
            "components": tuple(experiment.setup.members),
            "processors": processors,
            "used_processors": used,
            "reserve_percent": reserve,
        },
    )


def more_processors(experiment: Experiment, used: int, places: Places) -> Diagnostic:
    """Make the finding that components use more processors at once than was seen before.

    Args:
        experiment: As it was measured, with the number that was seen before.
        used: The number from here on.
    """
    processors = experiment.setup.processors
    return MORE_PROCESSORS.at(
        places.key("components", experiment.members[0].name),
        f"{in_a_row(experiment.setup.members)} used {used} processors at once, and at most {processors} when its "
        f"number of virtual processors was chosen. It is measured with {used} from here on; settings with {processors} "
        "stay in the log and no longer count.",
        "Nothing. To keep a number, write it: `processors`.",
        address=f"component/{experiment.members[0].name}",
        values={
            "components": tuple(experiment.setup.members),
            "processors": processors,
            "used_processors": used,
        },
    )
