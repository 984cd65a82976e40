"""Who answers what a compound does at a reservation, who is told, and who may say no to a combination."""

from typing import Protocol

from rarms_iac.planner.combining.values import Asked, Coi, Members


class Unanswered(Exception):
    """The oracle cannot answer this question, now or at all; the text says why. What was answered stays true."""


class PerformanceOracle(Protocol):
    """An experiment on a host, or the data logs of one."""

    def worse(self, members: Members, reserve: int) -> frozenset[str]:
        """Those of the members that miss any of their APTs when all of them run in one partition.

        That partition reserves `reserve` per cent of each of its processors (CR, 1..100); the rest is reserved by P2
        with the interfering load. On the safe side: whoever is not shown to meet an APT misses it. The same question
        has the same answer.

        Raises:
            Unanswered: there is no verdict, or somebody asked for an end.
        """
        ...


class Consent(Protocol):
    """Asked before a combination is measured for the first time."""

    def allows(self, members: Members, *, settings: int, gain: int) -> bool:
        """Whether it may be tried.

        It takes about so many settings, fewer where it is soon out; at most so much, in per cent of one logical
        processor, is gained.
        """
        ...


class PlannerReporter(Protocol):
    """Told what combining does, as it does it; must not raise."""

    def setting_asked(self, members: Members, reserve: int, why: str) -> None:
        """The question goes to the oracle."""
        ...

    def setting_answered(self, answer: Asked) -> None:
        """The oracle said."""
        ...

    def declined(self, members: Members) -> None:
        """Somebody said no to this combination, or the manifest does; another one is tried."""
        ...

    def combined(self, compound: Coi, before: int) -> None:
        """A compound was found; `before`: what its parts cost, in per cent of one logical processor."""
        ...


class Silent:
    """Tells nobody."""

    def setting_asked(self, members: Members, reserve: int, why: str) -> None:
        """Nothing."""

    def setting_answered(self, answer: Asked) -> None:
        """Nothing."""

    def declined(self, members: Members) -> None:
        """Nothing."""

    def combined(self, compound: Coi, before: int) -> None:
        """Nothing."""


class Always:
    """Consents to everything."""

    def allows(self, members: Members, *, settings: int, gain: int) -> bool:  # noqa: ARG002 - the protocol's
        """Yes."""
        return True
