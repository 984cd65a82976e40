"""The one error that is said of measured numbers, and how it is spent.

Everything that rarms concludes from samples it says wrongly in at most `ERROR` of the runs: that a setting is enough,
that a threshold is missed, that a layout holds, and that the truth is not beyond a bound. All that is said of several
things together shares it.
"""

from typing import Final

ERROR: Final = 0.01
"""The probability with which what is said may be wrong."""

FIRST_LOOK: Final = 40
"""Samples before the first look at a setting that is being measured."""

LOOK_APART: Final = 2.0**0.5
"""How many times as many samples there are at the next look."""

LOOK_ERROR: Final = ERROR / 14
"""The error of each look at a setting, however many there are: a constant boundary (Pocock 1977).

The largest of the standardised means at 40, 57, 80, ... 40,000 samples lies above 3.18, where one lies with a
probability of 0.00074, in 1 % of runs: 21 looks count like 14 independent ones, since they share their samples
(`laboratory/benchmarks/verdicts.py` simulates it). So the bounds of a setting hold whenever it ended, and need not know
why.
"""


def shared_error(parts: int, error: float = ERROR) -> float:
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

    Args:
        samples: how many there are now.

    Returns:
        A larger count. The counts grow geometrically, so that the looks stay few.
    """
    look = float(FIRST_LOOK)
    while round(look) <= samples:
        look *= LOOK_APART
    return round(look)


def describe_error(error: float = ERROR) -> str:
    """Write how sure a statement is, the same everywhere.

    Args:
        error: the probability, 0..1, that it is wrong.

    Returns:
        Words to append to a message: `wrong in at most 1 of 100 runs`.
    """
    return f"wrong in at most {100 * error:.3g} of 100 runs"


def describe_extreme(beyond: float) -> str:
    """Write what an extreme says of jobs to come, the same everywhere.

    Args:
        beyond: the share of jobs, in per cent, that may yet lie beyond it (`Estimate.beyond`).

    Returns:
        Words to append to a value: `so far; up to 2.3 % of the jobs may lie beyond it`.
    """
    return f"so far; up to {beyond:.2g} % of the jobs may lie beyond it"


ERRORS_EXPLAINED: Final = (
    f"What is said of measured numbers is {describe_error()}: that a reserve is enough, that a threshold is missed, "
    "and what is proven of all components of a host together. A bound (from, to) has the truth beyond it as rarely. "
    "Jobs of a kind that no sample showed are counted in, taking up to twice the mean time, or as long as the longest "
    "seen. Of a maximum or minimum nothing more is said than what was seen so far, and the share of jobs that may lie "
    "beyond it."
)
"""The same words in the terminal, in the report and in the documentation."""
