"""What the probabilities beside a result mean: the same words in the terminal, in the report and in the glossary."""

from rarms_iac.statistics.estimates import SAFE_SIDE, USUAL_ERROR
from rarms_iac.statistics.verdict import LAST_EARLY_LOOK, VERDICT_ERROR

PASSING = SAFE_SIDE + LAST_EARLY_LOOK * VERDICT_ERROR
"""Of "enough": at a setting's end by the safe side, or before by what early looks may spend."""


def share(error: float) -> str:
    """`2.5 %`."""
    return f"{100 * error:.3g} %"


def wrong(error: float) -> str:
    """What stands behind a verdict: `wrong in at most 1 %`."""
    return f"wrong in at most {share(error)}"


ERRORS = (
    "Wrong in: how often such a verdict is wrong at most. A reserve is enough where the safe side of the interval "
    f"meets the threshold: {share(SAFE_SIDE)}, or {share(PASSING)} where the setting could end early. That a threshold "
    f"is missed, and what is proven, is said with {share(VERDICT_ERROR)}. An interval (from to) leaves the truth out "
    f"in at most {share(USUAL_ERROR)} of cases, half of that on each side."
)
"""The figures that measuring shows, and what each is of."""
