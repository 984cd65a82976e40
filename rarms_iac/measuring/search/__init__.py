"""The search for the least sufficient reservation: strategies are pure functions of the settings measured so far.

A history of trials and a goal come in (`trials.py`, where to begin), the next step comes out (`model/outcomes.py`).
Resuming is replaying the history out of the data log: the same history gives the same step. `bracketing.py`
has bisection, the paper's walk, and the default: it needs fewer settings, by where it reads the threshold
off the settings so far, and takes at most one more than bisection as long as no verdict is wrong.
"""

from rarms_iac.measuring.search.bracketing import bisect, search_with_few_settings, walk_by_ten
from rarms_iac.measuring.search.trials import SearchMethod

STRATEGIES: dict[str, SearchMethod] = {
    "default": search_with_few_settings,
    "bisection": bisect,
    "paper": walk_by_ten,
}
"""By the name that `--strategy` takes."""
