"""What will happen when: a queue of actions in time order, ties in the order in which they were asked for."""

from collections.abc import Callable
from heapq import heappop, heappush

Action = Callable[[], None]

INSTANT = 1e-6
"""Milliseconds below which a duration is none: far above a float's grain after days, far below all we model."""


class Owner:
    """Whose actions they are; raising its turn makes the ones that it asked for before void."""

    __slots__ = ("turn",)

    def __init__(self) -> None:
        self.turn = 0


class Agenda:
    """The clock, and the actions to come."""

    __slots__ = ("_asked", "_coming", "now")

    def __init__(self) -> None:
        self.now = 0.0
        self._asked = 0
        self._coming: list[tuple[float, int, int, Owner, Action]] = []

    def at(self, time: float, owner: Owner, action: Action) -> None:
        """Lets the action happen then, unless the owner's turn has been raised in between."""
        self._asked += 1
        heappush(self._coming, (time, self._asked, owner.turn, owner, action))

    def after(self, delay: float, owner: Owner, action: Action) -> None:
        """Lets the action happen so much later."""
        self.at(self.now + delay, owner, action)

    def due(self, until: float) -> Action | None:
        """The next action that counts, the clock set to its time; None (the clock at `until`) when none comes first."""
        coming = self._coming
        while coming and coming[0][0] <= until:
            time, _, turn, owner, action = heappop(coming)
            if owner.turn == turn:
                self.now = max(self.now, time)
                return action
        self.now = max(self.now, until) if until != float("inf") else self.now
        return None
