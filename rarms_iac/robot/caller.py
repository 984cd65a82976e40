"""The other side of a request: what is sent to it, and what it says meanwhile."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

from rarms_iac.cli.ending import Interrupts
from rarms_iac.providers.robot import ReporterCall, calls_sent_by
from rarms_iac.storage.codec import Json, encode


@dataclass(frozen=True, slots=True)
class Caller:
    """Who asked, and may ask for an end."""

    send: Callable[[Mapping[str, Json]], None]
    interrupts: Interrupts
    listens: bool  # it hears calls as they are made, and answers questions
    answers: SimpleQueue[bool]  # to questions; False once the other side is gone

    def sends(self, interface: type[Any], target: str) -> Any:
        """Return a reporter of this class, which the other side knows by this name."""

        def send(call: ReporterCall, arguments: Json) -> None:
            self.send({"call": encode(call), "arguments": arguments})

        return calls_sent_by(interface, target, send, self.answers.get)
