"""The one error that is said of measured numbers, and how it is spent.

Everything that rarms concludes from samples it says wrongly in at most `ERROR` of the runs: that a setting is enough,
that a threshold is missed, that a layout holds, and that the truth is not beyond a bound. All that is said of several
things together shares it.
"""

from math import ceil, log, log1p
from typing import Final

from rarms_iac.model.indexes import percentile_of
from rarms_iac.model.series import MOST_SAMPLES
from rarms_iac.model.system import AtLeast, AtMost, Threshold

ERROR: Final = 0.01
"""The probability with which what is said may be wrong."""

FIRST_LOOK: Final = 40
"""Samples before the first look at a setting that is being measured."""

LOOK_GROWTH: Final = 2.0**0.5
"""How many times as many samples there are at the next look."""

LOOK_ERROR: Final = ERROR / 43
"""The error of each look at a setting, at any count of samples: a constant boundary.

The standardised mean of the first n samples lies above 3.5 at any n from 40 to 40,000 in 1 % of series, where one lies
with a probability of 0.00023 (`benchmarks/verdicts.py` simulates it). So what is said of a setting holds
however often it was looked at, whenever it ended, and after any further samples.
"""

PERIODIC_STARTS: Final = ceil(log(LOOK_ERROR) / log(0.75))
"""Starts of a load, 30, that a bound of a periodic component needs: it may lock into one phase for each.

A phase that a quarter of all starts lead to is in none of so many with a probability of at most `LOOK_ERROR`. Where
starts are alike nothing else shows it: all jobs of a start have its phase.
"""


def shared_error(parts: int, error: float) -> float:
    """Share an error among several statements, so that it holds for all of them together (union bound).

    Args:
        parts: how many statements; none counts as one.
        error: the probability, 0..1, that any of them is wrong.

    Returns:
        The error of each.
    """
    return error / max(1, parts)


def next_look(samples: int) -> int:
    """Say at which count of samples to look at a setting next.

    Returns:
        A larger count. The counts grow geometrically, so that the looks stay few.
    """
    look = float(FIRST_LOOK)
    while round(look) <= samples:
        look *= LOOK_GROWTH
    return round(look)


def samples_needed(index: str, threshold: Threshold) -> int:
    """Say with how many samples an index is shown to meet its threshold at the earliest, where all of them are good.

    Args:
        threshold: in its unit.

    Returns:
        Independent samples: `FIRST_LOOK` at least, and more than `MOST_SAMPLES` where no setting may have enough; of a
            share of jobs that may be bad, those of which all are good but for the error at greater shares.
    """
    match threshold:
        case AtMost() if (percentile := percentile_of(index)) is not None:
            bad = 1.0 - float(percentile) / 100
        case AtLeast(value=share) if index == "success_rate":
            bad = 1.0 - float(share) / 100
        case AtMost(value=share) if index == "deadline_miss_rate":
            bad = float(share) / 100
        case _:
            return FIRST_LOOK
    if bad <= 0.0:
        return MOST_SAMPLES + 1
    return FIRST_LOOK if bad >= 1.0 else max(FIRST_LOOK, ceil(log(LOOK_ERROR) / log1p(-bad)))


def describe_error() -> str:
    """Return how sure a statement is, to append to a message: `99 % sure`."""
    return f"{100 - 100 * ERROR:.4g} % sure"


def describe_errors(*, sure: bool, so_far: bool) -> str:
    """Write how sure several verdicts are, below their table.

    Args:
        sure: some are wrong with a known probability: each with `ERROR`, and so is that all of them are met.
        so_far: some are of a maximum or minimum, whose probability is unknown.

    Returns:
        A sentence; empty where there is nothing of either.
    """
    each = f"{100 - 100 * ERROR:.4g} % confidence each" if sure else ""
    extremes = "a maximum or minimum is met so far" if so_far else ""
    sentence = "; ".join(filter(None, (each, extremes)))
    return f"{sentence.capitalize()}." if sentence else ""


def describe_extreme(beyond: float) -> str:
    """Write what an extreme says of jobs to come, the same everywhere.

    Args:
        beyond: the share of jobs, in per cent, that may yet lie beyond it (`Estimate.beyond`).

    Returns:
        Words to append to a value: `so far; up to 2.3 % of the jobs may lie beyond it`.
    """
    return f"so far; up to {beyond:.2g} % of the jobs may lie beyond it"


ERRORS_EXPLAINED: Final = (
    f"Each sentence on measured numbers is {describe_error()}: that a reserve is enough, that a threshold is missed, "
    "and that all thresholds of a layout are met. A bound (from, to) has the truth beyond it as rarely. "
    "Jobs of a kind that no sample showed are counted in, taking up to twice the mean time, or as long as the longest "
    "seen. Of a maximum or minimum nothing more is said than what was seen so far, and the share of jobs that may lie "
    "beyond it."
)
"""What the terminal, the report and the documentation say of errors."""
