"""What the probabilities beside a result mean: the same words in the terminal, in the report and in the glossary."""

from rarms_iac.statistics.estimates import USUAL_ERROR
from rarms_iac.statistics.verdict import VERDICT_ERROR


def share(error: float) -> str:
    """`2.5 %`."""
    return f"{100 * error:.2g} %"


def wrong(error: float) -> str:
    """What stands behind a verdict: `wrong in at most 1 %`."""
    return f"wrong in at most {share(error)}"


ERRORS = (
    f"Wrong in: how often such a verdict is wrong at most. {share(VERDICT_ERROR)}: it was measured until it was clear; "
    f"{share(USUAL_ERROR / 2)}: it rests on the safe side of an interval, as a plan does. Intervals (from to) leave "
    f"the truth out in at most {share(USUAL_ERROR)} of cases, half of that on each side."
)
"""The three figures that measuring shows, and what each is of."""
