"""The one assumption of combining: what a compound needs at least, as a part of it says (docs/decisions/0019).

On one processor company only takes: a compound needs at least what any part of it needs. On several, a thread that is
alone stays on one virtual processor, and what the others reserve is of no use to it; company moves it about. So there a
compound may need a little less than a part of it.
"""

SLACK = 2
"""Points of CR by which a compound on several processors may need less than a part of it."""

ASSUMED = f"a compound needs at least what any part of it needs (on several processors: at most {SLACK} points less)"

SELDOM = 0.1
"""Part of these compounds that do, as one expects before any was asked."""


def slack_on(processors: int) -> int:
    """Points of CR by which a compound on so many virtual processors may need less than a part of it."""
    return SLACK if processors > 1 else 0


def at_least(cost: int, processors: int) -> int:
    """The CR that a compound on so many needs at least of which a part needs `cost` (per cent of one LP)."""
    return max(1, -(-cost // processors) - slack_on(processors))
