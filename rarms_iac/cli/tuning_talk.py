"""What tuning says to a person, and asks of one."""

import sys
from fractions import Fraction

from rarms_iac.cli.session import Session
from rarms_iac.cli.terminal import Terminal
from rarms_iac.model.quantities import show_processors
from rarms_iac.model.wording import in_a_row
from rarms_iac.planner.combining.oracle import Asked, Coi, Members, Silent
from rarms_iac.views.diagnostics.layout import wrap


class Telling(Silent):
    """A `PlannerReporter` that writes beside the data; measuring itself shows every setting."""

    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal

    def setting_asked(self, members: Members, reserve: int, why: str) -> None:
        """What is asked, and why."""
        self._say(f"{in_a_row(members)} in one partition at {reserve} %: {why}.")

    def setting_answered(self, answer: Asked) -> None:
        """The answer."""
        missed = f"not enough: {', '.join(answer.worse)} would not meet every threshold for sure"
        self._say("enough: all thresholds met" if answer.passed else missed, "  ")

    def declined(self, members: Members) -> None:
        """That it is left out."""
        self._terminal.talk(f"Not combined: {in_a_row(members)}.")

    def combined(self, compound: Coi, before: int) -> None:
        """What it brought."""
        apart, now = (show_processors(Fraction(one, 100)) for one in (before, compound.cost))
        self._say(f"Combined: {in_a_row(compound.members)}, {apart} apart and {now} together.")

    def _say(self, text: str, indent: str = "") -> None:
        self._terminal.talk("\n".join(wrap(text, self._terminal.width, indent)))


class AskingConsent:
    """Asks at the terminal, once for each combination."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._said: dict[Members, bool] = {}

    def allows(self, members: Members, *, settings: int, gain: int) -> bool:
        """As `Consent` says; an empty answer, or the input's end, is no, and what is neither is asked anew."""
        if members not in self._said:
            terminal = self._session.terminal
            terminal.flush()
            saves = show_processors(Fraction(gain, 100))
            takes = "one setting" if settings == 1 else f"{settings} settings"
            says = f"Try {in_a_row(members)}? About {takes}, or fewer; saves at most {saves}. [y/N] "
            question = "\n".join(wrap(says, terminal.width, "")) + " "
            terminal.status(question)
            while (said := sys.stdin.readline().strip().lower()) not in {"", "y", "yes", "n", "no"}:
                terminal.status(f"Say y or n: {question}")
            self._said[members] = said in {"y", "yes"}
        return self._said[members]
