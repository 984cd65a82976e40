"""How much a test run may try: the usual counts, or the large ones of `make test-long`."""

import os

LONG = os.environ.get("RARMS_LONG") == "1"
GROWTH = 50  # the long run tries this many times as much


def examples(usual: int) -> int:
    """The count for `@settings(max_examples=...)` or a loop, from the count of a usual run."""
    return usual * GROWTH if LONG else usual
