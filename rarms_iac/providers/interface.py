"""What a host must offer, whatever enforces its reservations (DESIGN sections 4 and 8)."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol

from rarms_iac.model.changes import Address
from rarms_iac.model.journal import Journal, JournalRecord, RunStarted
from rarms_iac.model.operations import Operation
from rarms_iac.model.plan import Readings, Scope
from rarms_iac.model.state import State


class HostError(Exception):
    """Something went wrong at a host; the facts are its attributes."""

    def __init__(self, host: str, says: str, advice: str) -> None:
        super().__init__(f"{host}: {says}")
        self.host = host
        self.says = says
        self.advice = advice


class Refused(HostError):
    """The host said no and changed nothing."""


class Failed(HostError):
    """The call failed; the host may have done some or all of it."""


class HostDamaged(HostError):
    """What the host keeps for us cannot be read; nothing was changed."""


class HostLocked(HostError):
    """Another run holds the host."""

    def __init__(self, host: str, owner: str) -> None:
        super().__init__(host, f"it is held by {owner}", "wait for it, or give --lock-timeout")
        self.owner = owner


class StepwiseHost(Protocol):
    """A host that is changed one operation at a time, with lock and journal on the host itself."""

    @property
    def name(self) -> str:
        """The host's name in the manifest."""
        ...

    def observe(self) -> State:
        """What is there now. Changes nothing, takes no lock, and never makes anything on the host.

        Raises:
            HostDamaged: what was kept cannot be read.
            HostError: the host cannot be reached or read.
        """
        ...

    def lock(self, owner: str, timeout_ms: int = 0) -> AbstractContextManager[None]:
        """Hold the host; released when the context ends or the process dies.

        Raises:
            HostLocked: another run holds it, after waiting so long.
        """
        ...

    def read(self, address: Address, scope: Scope) -> Readings:
        """Everything that `diff.readings` knows of this address, now; `{"exists": False}` where nothing is.

        Names are resolved as `diff.readings.resolve` says.
        """
        ...

    def execute(self, operation: Operation, scope: Scope) -> None:
        """Do it, wholly or not at all.

        Raises:
            Refused: it is not allowed on this host now; nothing happened.
            Failed: something went wrong on the way.
        """
        ...

    def journal(self) -> Journal | None:
        """The last run on this host, None where there was none.

        Raises:
            HostDamaged: an earlier record is damaged (a torn last one is dropped).
        """
        ...

    def unfinished(self) -> Journal | None:
        """The run that is under way on this host, None where there is none; that answer is cheap.

        Raises:
            HostDamaged: a run may be under way, and its journal is damaged.
        """
        ...

    def start_run(self, started: RunStarted) -> None:
        """Replace the journal by one that begins with this record, in one write."""
        ...

    def record(self, record: JournalRecord) -> None:
        """Append a record, on the disk when this returns."""
        ...


OpenHost = Callable[[], StepwiseHost]
