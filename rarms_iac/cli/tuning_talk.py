"""What tuning asks of a person."""

import sys
from fractions import Fraction

from rarms_iac.cli.session import Session
from rarms_iac.model.quantities import show_processors
from rarms_iac.model.wording import in_a_row
from rarms_iac.planner.combining.oracle import Members
from rarms_iac.views.console import paragraph, render


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
            question = render(paragraph(says), terminal.width).removesuffix("\n") + " "
            terminal.status(question)
            while (said := sys.stdin.readline().strip().lower()) not in {"", "y", "yes", "n", "no"}:
                terminal.status(f"Say y or n: {question}")
            self._said[members] = said in {"y", "yes"}
        return self._said[members]
