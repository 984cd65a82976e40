"""How much a test run may try: the usual counts, the large ones of `make test-long`, or few.

Few are enough where the same laws run with the usual counts in the same CI: under wine, with the lowest versions.
"""

import os

LONG = os.environ.get("RARMS_LONG") == "1"
GROWTH = 50  # the long run tries this many times as much
FEW = os.environ.get("RARMS_FEW") == "1"
FEWER = 4  # the short run tries this part of it


def examples(usual: int) -> int:
    """The count for `@settings(max_examples=...)` or a loop, from the count of a usual run."""
    if LONG:
        return usual * GROWTH
    return max(1, usual // FEWER) if FEW else usual
