"""What each setting showed of an index, as the statistics judge it: value, interval, verdict and its error."""

from collections.abc import Mapping
from typing import assert_never

from rarms_iac.model.measurement import Series, Setting
from rarms_iac.model.outcomes import Met, Missed, TooFewSamples, TooManyFailures, Unsteady, Verdict, WithinNoise
from rarms_iac.model.system import Run, Threshold
from rarms_iac.statistics.curves import curve_of
from rarms_iac.statistics.estimates import SAFE_SIDE
from rarms_iac.statistics.samples import failures
from rarms_iac.statistics.verdicts import judge
from rarms_iac.storage.datalog.log import Recorded
from rarms_iac.views.reports.model import Point


def points_of(
    recorded: tuple[Recorded, ...], component: str, index: str, apt: Mapping[str, Threshold], run: Run
) -> tuple[Point, ...]:
    """A point a setting in which the component was measured, by reserve."""
    found = [
        _point(one.setting, series, index, {index: apt[index]} if index in apt else {}, run)
        for one in recorded
        for series in one.setting.series
        if series.component == component
    ]
    return tuple(sorted(found, key=lambda point: point.reserve))


def _point(setting: Setting, series: Series, index: str, apt: Mapping[str, Threshold], run: Run) -> Point:
    estimates = curve_of([setting], series.component, index, run).estimates
    verdict = judge(series, apt, run, error=SAFE_SIDE)
    told, error, remark = _in_words(verdict)
    if not estimates:
        return Point(
            reserve=setting.reserve,
            value=None,
            low=0.0,
            high=0.0,
            samples=len(series.samples),
            failed=len(failures(series)),
            effective=0.0,
            verdict=told,
            remark=remark,
        )
    [estimate] = estimates
    beyond = "" if estimate.beyond is None else f"up to {estimate.beyond:.2g} % of the jobs may lie beyond it"
    return Point(
        reserve=setting.reserve,
        value=estimate.value,
        low=estimate.lower,
        high=estimate.upper,
        samples=len(series.samples),
        failed=len(failures(series)),
        effective=estimate.effective_samples,
        verdict=told if apt else "",
        error=error if apt else None,
        remark="; ".join(one for one in (remark, beyond) if one),
    )


def _in_words(verdict: Verdict) -> tuple[str, float | None, str]:
    """A word, the probability that it is wrong, and what else is to be said."""
    match verdict:
        case Met(error=error, warm_up=warm_up):
            return "meets the APT", error, _warm_up(warm_up)
        case Missed(error=error, warm_up=warm_up):
            return "misses the APT", error, _warm_up(warm_up)
        case WithinNoise(error=error, warm_up=warm_up):
            return "within the noise", error, _warm_up(warm_up)
        case Unsteady(reason=why):
            return "no steady state", None, why
        case TooManyFailures(failures=failed, allowed=allowed):
            return "too many failed samples", None, f"{len(failed)} failed, {allowed} allowed"
        case TooFewSamples(reason=why):
            return "too few samples", None, why
        case _:
            assert_never(verdict)


def _warm_up(samples: int) -> str:
    return f"{samples} samples of warm-up left out" if samples else ""
