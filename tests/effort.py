"""How much a test run may try: the usual counts, or the large ones of `make test-long`."""

import os
from collections import Counter
from enum import StrEnum

LONG = os.environ.get("RARMS_LONG") == "1"
GROWTH = 50  # the long run tries this many times as much


def examples(usual: int) -> int:
    """The count for `@settings(max_examples=...)` or a loop, from the count of a usual run."""
    return usual * GROWTH if LONG else usual


def every_few(count: int, usual: int, first: int = 0) -> range:
    """The places below `count` to try, about `examples(usual)` of them; `first` shifts them, so that tests differ."""
    step = max(1, count // examples(usual))
    return range(first % step, count, step)


class Attempt(StrEnum):
    """What is done to rarms to harm it; a run says at its end how often it did each."""

    KILL = "kills"
    FAILED_CALL = "full disks and failing calls"
    PAIR = "pairs of faults"
    DOCUMENT = "damaged, planted and hostile documents"
    RACE = "races"
    TERMINAL = "terminals"
    CLOCK = "clocks that jump back"
    CUT = "cut connections"
    SIGNED = "kills of signed scripts"


TRIED: Counter[str] = Counter()
"""The attempts of the running test."""


def tried(attempt: Attempt, number: int = 1) -> None:
    """Count attempts of the running test."""
    TRIED[attempt.value] += number
