"""What a setting tells a search besides pass and fail: the level of the response, how well known, at what CPU cost."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, log, sqrt
from statistics import NormalDist

from rarms_iac.measuring.search.trials import Goal, Member, SearchTrial
from rarms_iac.model.measurement import Series
from rarms_iac.model.outcomes import NoEstimate
from rarms_iac.model.system import AtLeast, AtMost, Threshold
from rarms_iac.statistics import samples as values
from rarms_iac.statistics.estimates import estimate

_ONE_DEVIATION = 0.3173  # the error at which bounds are one standard deviation away
_UNSEEN_VARIATION = 0.1  # of response times that are not shown, as a first guess


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingObservation:
    """One setting as a point of a falling curve."""

    reserve: int
    level: float  # logarithm of what falls as the CR rises: ms, or ms a job
    error: float  # one standard deviation of it
    served: float | None  # logarithm of the level that the consumed CPU time alone would have at CR 1; None: unknown


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """One index of one member: at which CR does the level fall to the target?"""

    observations: tuple[SettingObservation, ...]
    lowest: float  # the target's logarithm lies between these two; equal where the APT names it
    highest: float
    vague: float  # one standard deviation of both


def questions(history: Sequence[SearchTrial], goal: Goal) -> tuple[Question, ...]:
    """One for each index of each member that says anything beyond pass and fail."""
    asked = (
        _question(history, member, index, threshold)
        for member in goal.members
        for index, threshold in member.apt.items()
    )
    return tuple(question for question in asked if question is not None and question.observations)


def _question(history: Sequence[SearchTrial], member: Member, index: str, threshold: Threshold) -> Question | None:
    found = [
        (trial.reserve, series)
        for trial in history
        for series in trial.setting.series
        if series.component == member.name and series.samples
    ]
    match index, threshold:
        case "success_rate", AtLeast(value=limit):
            return _success_question(found, member, float(limit) / 100)
        case "deadline_miss_rate", AtMost(value=limit):
            return _deadline_question(found, member, 1.0 - float(limit) / 100)
        case "throughput", AtLeast(value=limit) if limit > 0:
            points = _observations(found, member, index, sign=-1.0)
            target = -log(float(limit))
        case _, AtMost(value=limit) if limit > 0:
            points = _observations(found, member, index, sign=1.0)
            target = log(float(limit))
        case _:
            return None
    return Question(observations=points, lowest=target, highest=target, vague=0.0)


def _observations(
    found: Sequence[tuple[int, Series]], member: Member, index: str, *, sign: float
) -> tuple[SettingObservation, ...]:
    points: list[SettingObservation] = []
    for reserve, series in found:
        seen = estimate(index, series, member.run, error=_ONE_DEVIATION)
        if isinstance(seen, NoEstimate) or seen.value <= 0.0:
            continue
        above = (seen.upper if seen.upper < inf else 1.1 * seen.value) - seen.value
        level = sign * log(seen.value)
        points.append(
            SettingObservation(
                reserve=reserve,
                level=level,
                error=max(above / seen.value, 1e-4),
                served=_served(series, level, while_answering=index != "throughput"),
            )
        )
    return tuple(points)


def _served(series: Series, level: float, *, while_answering: bool) -> float | None:
    """The level at CR 1 if a job did nothing but use one processor for the CPU time that jobs took here.

    Of response times only the time counts in which there is a job; a throughput has all of it, also what a periodic
    component waits.
    """
    if series.cpu_ms is None or series.cpu_ms <= 0.0:
        return None
    time = sum(values.response_times(series.samples)) if while_answering else 0.0
    return level + log(100 * series.cpu_ms / (time or series.elapsed_ms))


def _deadline_question(found: Sequence[tuple[int, Series]], member: Member, share: float) -> Question | None:
    """A share of jobs within a deadline: the mean level at which that share of a job's spread is within it."""
    points = _observations(found, member, "mean_response_time", sign=1.0)
    if not points or member.run.deadline is None or not 0.0 < share < 1.0:
        return None
    spread, vague = _spread(found, share)
    target = log(float(member.run.deadline)) - spread
    return Question(observations=points, lowest=target, highest=target, vague=vague)


def _success_question(found: Sequence[tuple[int, Series]], member: Member, share: float) -> Question | None:
    """What makes a job a success is not known; if it is being soon enough, its response times enclose the limit."""
    if not 0.0 < share < 1.0:
        return None
    points = _observations(found, member, "mean_response_time", sign=1.0)
    if len(points) < len(found) or not points:
        return _unseen_question(found, share)
    lowest, highest = _limit_between(found)
    if lowest > highest + 0.02:
        return _unseen_question(found, share)  # slow successes, quick failures: time is not what decides
    spread, vague = _spread(found, share)
    return Question(observations=points, lowest=lowest - spread, highest=highest - spread, vague=vague)


def _limit_between(found: Sequence[tuple[int, Series]]) -> tuple[float, float]:
    """Logarithms of the slowest success and the quickest failure; infinite where there is none."""
    samples = [sample for _, series in found for sample in series.samples if sample.response_ms]
    slowest = max((sample.response_ms or 0.0 for sample in samples if sample.successful), default=0.0)
    quickest = min((sample.response_ms or 0.0 for sample in samples if not sample.successful), default=inf)
    return log(slowest) if slowest > 0.0 else -inf, log(quickest) if quickest < inf else inf


def _spread(found: Sequence[tuple[int, Series]], share: float) -> tuple[float, float]:
    """By how much, on a logarithmic scale, this share of jobs stays below its mean's multiple, and its deviation.

    All settings together, each divided by its own mean: the spread's form hardly depends on the CR.
    """
    scaled: list[float] = []
    for _, series in found:
        times = values.response_times(series.samples)
        mean = sum(times) / len(times)
        scaled += [time / mean for time in times]
    scaled.sort()
    count = len(scaled)
    at = share * (count - 1)
    reach = max(1.0, sqrt(count * share * (1.0 - share)))
    low, middle, high = (scaled[round(min(count - 1.0, max(0.0, rank)))] for rank in (at - reach, at, at + reach))
    return log(middle), max(1e-4, (log(high) - log(low)) / 2)


def _unseen_question(found: Sequence[tuple[int, Series]], share: float) -> Question | None:
    """Successes only: time a job says where on the curve a setting lies, the share of successes how far from the limit.

    With a lognormal spread s, log(limit) = level + s * z(share seen): the level wanted is level + s * (z - z wanted).
    """
    normal = NormalDist()
    wanted = normal.inv_cdf(share)
    points: list[SettingObservation] = []
    lowest, highest = -inf, inf
    for reserve, series in found:
        count, gained = len(series.samples), sum(values.successes(series.samples))
        level = log(series.elapsed_ms / count)
        points.append(
            SettingObservation(
                reserve=reserve,
                level=level,
                error=_UNSEEN_VARIATION / sqrt(count),
                served=_served(series, level, while_answering=True),
            )
        )
        away = normal.inv_cdf((gained + 0.5) / (count + 1.0)) - wanted
        if away > 0.0:
            lowest = max(lowest, level)
        else:
            highest = min(highest, level)
    return Question(observations=tuple(points), lowest=lowest, highest=highest, vague=0.01)
