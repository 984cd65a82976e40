"""How much a test run may try: the usual counts, or the large ones of `make test-long`."""

import os

LONG = os.environ.get("RARMS_LONG") == "1"
GROWTH = 50  # the long run tries this many times as much


def examples(usual: int) -> int:
    """The count for `@settings(max_examples=...)` or a loop, from the count of a usual run."""
    return usual * GROWTH if LONG else usual


def every_few(count: int, usual: int, first: int = 0) -> range:
    """The places below `count` to try, about `examples(usual)` of them; `first` shifts them, so that tests differ."""
    step = max(1, count // examples(usual))
    return range(first % step, count, step)
