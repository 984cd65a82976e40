"""What the end of an experiment is told as, where it is not simply a reservation."""

from collections.abc import Iterable, Iterator
from typing import assert_never

from rarms_iac.measuring.findings import (
    FAILED_SAMPLES,
    FIXED_ANYWAY,
    LESS_UNKNOWN,
    NO_STEADY_STATE,
    NOT_ACHIEVABLE,
    NOT_RESOLVED,
)
from rarms_iac.measuring.performance import MeasuredIndex, measured_indexes, why_unsteady
from rarms_iac.measuring.search.default import WIDTH
from rarms_iac.measuring.setup import Experiment
from rarms_iac.model import indexes
from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.indexes import find_index
from rarms_iac.model.measurement import Setting
from rarms_iac.model.outcomes import Conclusion, NotAchievable, NotResolved, SettingFailed, Stopped, Sufficient, Swept
from rarms_iac.model.quantities import Unit, show_amount
from rarms_iac.model.system import Measured, Threshold
from rarms_iac.model.wording import in_a_row

UNITS = {Unit.TIME: " ms", Unit.SHARE: " %", Unit.RATE: " /s"}

SHOWN_FAILURES = 3
"""How many of the reasons why samples failed are told."""


def findings_of(
    experiment: Experiment, conclusion: Conclusion, settings: tuple[Setting, ...], places: Places
) -> Iterator[Diagnostic]:
    """What a person must hear of this end."""
    match conclusion:
        case NotAchievable(reserve=reserve):
            yield from _not_achievable(experiment, reserve, settings, places)
        case NotResolved(reason=says):
            yield from _not_resolved(experiment, says, settings, places)
        case SettingFailed(reserve=reserve, component=component, failures=failures):
            told = "; ".join(dict.fromkeys(failures[:SHOWN_FAILURES]))
            yield FAILED_SAMPLES.at(
                places.key("components", component),
                f"{component} at {reserve} %: {len(failures)} failed, and `run.failures` allows fewer: {told}.",
                f"Run it alone and mend what fails, or allow it: `run: {{ failures: {len(failures)} }}`.",
                address=f"component/{component}",
            )
        case Sufficient(reserve=reserve):
            yield from _less_unknown(experiment, conclusion, settings, places)
            yield from _fixed_anyway(experiment, reserve, places)
        case Swept() | Stopped():
            return
        case _:
            assert_never(conclusion)


def show_value(index: str, value: float) -> str:
    """A measured value in the index's own unit, with as many digits as a person reads."""
    found = find_index(index)
    unit = UNITS[found.unit] if found else ""
    digits = 1 if abs(value) >= 10 else 2
    return f"{value:.{digits}f}".rstrip("0").rstrip(".") + unit


def show_threshold(index: str, threshold: Threshold) -> str:
    """`at most 100 ms`."""
    found = find_index(index)
    assert found is not None, "a manifest names no other index"
    return indexes.show_threshold(found, threshold)


def show_measured(shown: MeasuredIndex) -> str:
    """`mean_response_time 94.1 ms (93.5 to 94.8 ms)`."""
    if shown.estimate is None:
        return f"{shown.index} cannot be told: {shown.why}"
    value = show_value(shown.index, shown.estimate.value)
    if shown.estimate.beyond is not None:
        return f"{shown.index} {value}, beyond which up to {shown.estimate.beyond:.2g} % of the jobs may lie"
    lower, upper = (show_value(shown.index, side) for side in (shown.estimate.lower, shown.estimate.upper))
    return f"{shown.index} {value} ({lower.rpartition(' ')[0]} to {upper})"


def _not_achievable(
    experiment: Experiment, reserve: int, settings: tuple[Setting, ...], places: Places
) -> Iterator[Diagnostic]:
    last = [one for one in settings if one.reserve == reserve][-1:]
    most = "" if reserve == 100 else f" {reserve} % is the most that {experiment.host.name} can give it now."
    advice = "Relax the threshold, make the component cheaper, or use a faster platform."
    if most:
        advice = "Free the host, where something else holds its processors; else relax the threshold."
    for setting in last:
        found = measured_indexes(setting, experiment)
        # What is on the right side, and not for sure, is not met either.
        for one in [each for each in found if each.misses] or found:
            yield NOT_ACHIEVABLE.at(
                places.value("components", one.component, "apt", one.index),
                f"{one.component} at {reserve} %: {show_measured(one)}, and its threshold is "
                f"{show_threshold(one.index, one.threshold)}.{most}",
                advice,
                address=f"component/{one.component}",
            )


def _not_resolved(
    experiment: Experiment, says: str, settings: tuple[Setting, ...], places: Places
) -> Iterator[Diagnostic]:
    first = experiment.members[0].name
    unsteady = _unsteady(settings[-1:])
    for reserve, component, why in unsteady:
        yield NO_STEADY_STATE.at(
            places.key("components", component),
            f"{component} at {reserve} %: {why}.",
            "Look for what grows while it runs, or give it more samples: `--again --samples 2000`.",
            address=f"component/{component}",
        )
    if not unsteady:
        yield NOT_RESOLVED.at(
            places.value("components", first, "apt"),
            f"{experiment.name}: {says}.",
            "Allow more samples (`--again --samples 2000`), or move the threshold away from what the component just "
            "reaches.",
            address=f"component/{first}",
        )


def _unsteady(settings: Iterable[Setting]) -> list[tuple[int, str, str]]:
    """The CR, the component and why, of each series without a steady state."""
    return [
        (setting.reserve, series.component, why)
        for setting in settings
        for series in setting.series
        if (why := why_unsteady(series))
    ]


def _less_unknown(
    experiment: Experiment, found: Sufficient, settings: tuple[Setting, ...], places: Places
) -> Iterator[Diagnostic]:
    """Where a search would have had a fail close below, and has but settings that say neither."""
    if not found.untold or found.reserve - (found.failed or 0) <= WIDTH:
        return
    reserve, component, why = _unsteady(setting for setting in settings if setting.reserve == found.untold[-1])[-1]
    many = "it" if len(found.untold) == 1 else "they"
    lowest = f"; {found.failed} % is not shown to be" if found.failed else ""
    yield LESS_UNKNOWN.at(
        places.value("components", experiment.members[0].name, "apt"),
        f"{experiment.name}: {found.reserve} % is enough{lowest}. Of {in_a_row(found.untold)} % nothing is known: "
        f"{many} reached no steady state ({component} at {reserve} %: {why}).",
        f"To find out whether less is enough, measure longer: `rarms measure {_asked_for(experiment)} --again "
        "--samples 2000`.",
        address=f"component/{experiment.members[0].name}",
    )


def _asked_for(experiment: Experiment) -> str:
    names = " ".join(member.name for member in experiment.members)
    return f"{names} --together" if len(experiment.members) > 1 else names


def _fixed_anyway(experiment: Experiment, reserve: int, places: Places) -> Iterator[Diagnostic]:
    """Of a component measured alone: a plan takes what the manifest fixes, and not this."""
    for member in experiment.members if len(experiment.members) == 1 else ():
        if member.cpu.reserve is None or isinstance(member.cpu.reserve, Measured):
            continue
        yield FIXED_ANYWAY.at(
            places.value("components", member.name, "cpu", "reserve"),
            f"{member.name} meets its thresholds at a CR of {reserve} %, and the manifest reserves "
            f"{show_amount(member.cpu.reserve)} for it, whatever is measured.",
            "For a plan to take what was measured, write `reserve: measured`.",
            address=f"component/{member.name}",
        )
