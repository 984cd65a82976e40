"""Overload: a periodic component that falls behind its jobs misses its response times by arithmetic.

Where jobs end further apart than they are due, the queue grows and response times with it, for as long as that goes on.
Response times then have no steady state, and need none: no threshold holds. What is steady is the time between two
ends, and that is what is looked at. Begin at `find_overload`.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt
from statistics import fmean, stdev

from rarms_iac.model.indexes import index_named
from rarms_iac.model.outcomes import Estimate, NoEstimate, Overload, Unsteady
from rarms_iac.model.quantities import Unit
from rarms_iac.model.run import Periodic, Run
from rarms_iac.model.series import SampleColumns, Series, columns_of
from rarms_iac.statistics.distributions import LOOK_ERROR, student_quantile
from rarms_iac.statistics.estimates import estimate, estimate_steady, mean_estimate, share_estimate
from rarms_iac.statistics.samples import ends_ms, successes
from rarms_iac.statistics.steady_state import find_steady_part

_ON_SCHEDULE = 0.01  # a part of the period by which the beginnings of two jobs may be off it

_INTERRUPTS = 0.03  # a part of a processor that interrupts may take: who waits no longer waits for nothing else

_QUARTERS = 4
_FEWEST = 40  # ends: of fewer, quarters say nothing


def find_overload(series: Series, run: Run, *, error: float) -> Overload | None:
    """Find whether a periodic component falls behind: its jobs end further apart than they are due.

    A component that leaves jobs out when it is late (its samples begin further apart than the period) catches up by
    that; what it left out is taken off what it fell behind.

    Args:
        series: of one component at one setting, in the order in which its jobs ended.
        run: the component's, with its period.
        error: of a verdict, 0..1. Half of it is the probability with which a component that keeps up is said to fall
            behind; the other half is for what else its samples show.

    Returns:
        None: it is not periodic, its host had not settled, or it was not shown to fall behind.
    """
    if not isinstance(run.arrival, Periodic) or series.unsettled or len(series.samples) < 2:
        return None
    period = float(run.arrival.period)
    samples = columns_of(series.samples)
    restarts = (*series.runs, *series.starts)
    steps = samples.remember(("steps", period, restarts), lambda: _steps(samples, period, restarts))
    return samples.remember(
        ("overload", period, error, series.wanders, series.cpu_ms, restarts),
        lambda: _overload(steps, series, period, error / 2),
    )


def _overload(steps: "_Steps", series: Series, period: float, error: float) -> Overload | None:
    first = find_steady_part(steps.between_ms)
    if isinstance(first, Unsteady):
        if not series.wanders:
            return None
        first = 0
    times = steps.between_ms[first:]
    if len(times) < 2 or len(times) * (_least_mean(times, error, wanders=series.wanders) - period) <= steps.left_out_ms:
        return None
    return Overload(
        period_ms=period,
        between_ms=fmean(times),
        job_cpu_ms=series.cpu_ms / len(series.samples) if series.cpu_ms else None,
    )


def grows_without_end(index: str, series: Series, run: Run) -> bool:
    """Tell whether an overloaded component misses every threshold of an index, with any samples.

    Args:
        series: says whether real processes ran: whether these succeed, only they know.

    Returns:
        True for response times and what is made of them; False where the samples have to tell: of a minimum, which an
            early job keeps, of throughput, and of successes that do not depend on the time.
    """
    if index == "success_rate":
        return not series.wanders and run.success_within is not None
    if index == "deadline_miss_rate":
        return run.deadline is not None
    return index_named(index).unit is Unit.TIME and index != "minimum_response_time"


def estimate_of_setting(index: str, series: Series, run: Run, *, error: float = LOOK_ERROR) -> Estimate | NoEstimate:
    """Estimate a performance index of a setting: over its steady part, or of an overloaded component over all of it.

    Throughput and successes that do not depend on the time stay what they are while response times grow.

    Args:
        series: the samples of one component at one setting, in order.

    Returns:
        As of `estimate_steady`; of an overloaded component no estimate of what misses by arithmetic.
    """
    overload = find_overload(series, run, error=error)
    if overload is None:
        return estimate_steady(index, series, run, error=error)
    if grows_without_end(index, series, run):
        return NoEstimate(reason=describe_overload(overload), overload=overload)
    if index == "throughput":
        return estimate(index, series, run, error=error)
    if index == "success_rate" and not series.wanders:
        return share_estimate(successes(series.samples), error)
    # NOTE: real processes may call a late job unsuccessful, and jobs become later and later.
    return estimate_steady(index, series, run, error=error)


def describe_overload(overload: Overload, *, helps: bool = True) -> str:
    """Write what an overloaded component needs.

    Args:
        helps: whether more CPU does (`more_processors_help`); if it waits for something else, no LPs are given.

    Returns:
        A clause with numbers: `overloaded: needs 1.3 LP, has 1.0`.
    """
    if not helps or overload.needed_lp is None or overload.received_lp is None:
        return f"overloaded: jobs arrive every {overload.period_ms:.4g} ms but end every {overload.between_ms:.4g} ms"
    return f"overloaded: needs {overload.needed_lp:.3g} LP, has {overload.received_lp:.3g}"


def more_processors_help(overload: Overload, share: float, processors: int) -> bool:
    """Tell whether a larger reservation could end an overload, as far as the samples rule that out.

    A demand of more LPs than the partition has processors asks for more of them. Otherwise, while a job waits for a
    processor it gets at least what the partition reserves, but for interrupts; so what a job takes beyond its processor
    time by that share, it waits for something else.

    Args:
        share: of one of the partition's processors that is reserved, 0..1; the component has it for itself.

    Returns:
        False: with all processors for itself, it would fall behind all the same, since it waits.
    """
    if overload.job_cpu_ms is None or overload.job_cpu_ms >= processors * overload.period_ms:
        return True
    waits_ms = overload.between_ms - overload.job_cpu_ms / share
    if waits_ms <= _INTERRUPTS * overload.between_ms:
        return True
    return waits_ms + overload.job_cpu_ms / processors <= overload.period_ms


@dataclass(frozen=True, slots=True, kw_only=True)
class _Steps:
    """From one job to the next."""

    between_ms: Sequence[float]  # from end to end, where the later one began a period after the earlier
    left_out_ms: float  # by how much other pairs began further apart than a period


def _steps(samples: SampleColumns, period: float, restarts: Collection[int]) -> _Steps:
    """Return the steps between jobs; those between two runs or starts of a load are left out: the queue differs."""
    pairs = zip(pairwise(samples.began_ms), pairwise(ends_ms(samples)), strict=True)
    spans = [
        (began[1] - began[0], ended[1] - ended[0]) for at, (began, ended) in enumerate(pairs, 1) if at not in restarts
    ]
    return _Steps(
        between_ms=[ended for began, ended in spans if _is_on_schedule(began, period)],
        left_out_ms=sum(max(0.0, began - period) for began, _ in spans if not _is_on_schedule(began, period)),
    )


def _is_on_schedule(between_ms: float, period: float) -> bool:
    return abs(between_ms - period) <= _ON_SCHEDULE * period


def _least_mean(times: Sequence[float], error: float, *, wanders: bool) -> float:
    """Return the lower bound of the mean; of a machine whose speed wanders also by its quarters, as of batch means."""
    bounds = [seen.lower] if isinstance(seen := mean_estimate(times, error), Estimate) else []
    if wanders and len(times) >= _FEWEST:
        length = len(times) // _QUARTERS
        means = [fmean(times[at * length : (at + 1) * length]) for at in range(_QUARTERS)]
        away = student_quantile(1.0 - error, _QUARTERS - 1.0) * stdev(means) / sqrt(_QUARTERS)
        bounds.append(fmean(means) - away)
    return min(bounds, default=0.0)
