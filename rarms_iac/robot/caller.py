"""The other side of a request: what is sent to it, and what it says meanwhile."""

from collections.abc import Callable
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

from rarms_iac.cli.ending import Interrupts
from rarms_iac.providers.robot import ReporterCall, calls_sent_by


@dataclass(frozen=True, slots=True)
class Caller:
    """The caller of a request, who may ask for an end."""

    send: Callable[[ReporterCall], None]
    interrupts: Interrupts
    listens: bool  # it hears calls as they are made, and answers questions
    answers: SimpleQueue[bool]  # to questions; False once the other side is gone

    def sends(self, interface: type[Any], target: str) -> Any:
        """Return a reporter of this class, which the other side knows by this name."""
        return calls_sent_by(interface, target, self.send, self.answers.get)
