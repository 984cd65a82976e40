"""The interface of hosts, for every provider."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol, runtime_checkable

from rarms_iac.model.changes import Address
from rarms_iac.model.commands import Wording
from rarms_iac.model.facets import Readings
from rarms_iac.model.journal import Journal, JournalRecord, RunStarted, ScriptRun
from rarms_iac.model.operations import Operation
from rarms_iac.model.plan import Scope
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import State
from rarms_iac.storage.codec import Json
from rarms_iac.texts.messages import last_words


class HostError(Exception):
    """Something went wrong at a host; the facts are its attributes."""

    def __init__(self, host: str, message: str, advice: Wording) -> None:
        super().__init__(f"{host}: {message}")
        self.host = host
        self.message = message
        self.advice = advice


class HostRefused(HostError):
    """The host said no and changed nothing."""


class HostFailed(HostError):
    """The call failed; the host may have done some or all of it."""


class HostUnreachable(HostFailed):
    """There was no way to the host: nothing was done there, and nothing is known of it."""


class HostDamaged(HostError):
    """The host's journal or file cannot be read; nothing was changed."""


class HostLocked(HostError):
    """Another run holds the host."""

    def __init__(self, host: str, owner: str) -> None:
        super().__init__(host, f"it is locked by {owner}", "Wait for the end of that run, or set --lock-timeout.")
        self.owner = owner


class ReadableHost(Protocol):
    """A host that can be observed."""

    @property
    def name(self) -> str:
        """The host's name in the manifest."""

    def observe(self) -> State:
        """Observe what is there now. Changes nothing, takes no lock, and never makes anything on the host.

        Returns:
            The whole State, with machines of other owners; one call is one consistent look.

        Raises:
            HostDamaged: what was kept cannot be read.
            HostError: the host cannot be reached or read.
        """

    def examined(self, application: str) -> SeenHost:
        """Observe everything at once: state, condition and findings of one moment.

        Args:
            application: whose partitions there count as own.

        Raises:
            HostError: as of `observe`.
        """

    def look_once(self) -> None:
        """Answer from now on from one look, the first that is asked for: the host is only read.

        A host to which a look is cheap may look each time. A command to a robot ends that.
        """


class HoldableHost(ReadableHost, Protocol):
    """A host that one run at a time holds, with the journal of the last run."""

    def holder(self) -> str:
        """Tell who holds the host now, without taking the lock or waiting for it.

        Returns:
            The `owner` that `lock` was given; empty: no run holds it, or it cannot be seen from here.
        """

    def journal(self) -> Journal | None:
        """Return the last run on this host, None where there was none.

        Returns:
            The run with all records so far.

        Raises:
            HostDamaged: an earlier record is damaged (a torn last one is dropped).
        """

    def unfinished(self) -> Journal | None:
        """Return the run that is under way on this host, None where there is none; that answer is cheap.

        Returns:
            As `journal` returns it.

        Raises:
            HostDamaged: a run may be under way, and its journal is damaged.
        """


@runtime_checkable
class StepwiseHost(HoldableHost, Protocol):
    """A host that is changed one operation at a time, with lock and journal on the host itself."""

    def lock(self, owner: str, timeout_ms: int = 0) -> AbstractContextManager[None]:
        """Hold the host; released when the context ends or the process dies.

        Args:
            owner: who holds it, shown to others that want it.
            timeout_ms: how long to wait for another run; 0: not at all.

        Returns:
            A context to enter before anything is changed.

        Raises:
            HostLocked: another run holds it, after waiting so long.
        """

    def read(self, address: Address, scope: Scope) -> Readings:
        """Read everything that `diff.readings` knows of an address, now. Called twice a step.

        Args:
            address: a partition, a disk, a task class or SystemResponsiveness.
            scope: how names are resolved, as `diff.readings.resolve` does.

        Returns:
            The readings by name; `{"exists": False}` where nothing is.
        """

    def execute(self, operation: Operation, scope: Scope) -> None:
        """Do one operation, wholly or not at all, also when the process is killed meanwhile.

        Args:
            scope: how the partition's name is resolved.

        Raises:
            HostRefused: it is not allowed on this host now; nothing happened.
            HostFailed: something went wrong on the way.
        """

    def start_run(self, started: RunStarted) -> None:
        """Replace the journal by one that begins with this record, in one write.

        Args:
            started: the whole run with its steps, so that it can be finished without plan file or manifest.
        """

    def record(self, record: JournalRecord) -> None:
        """Append a record: on the disk before the next change of a held host, and at once where it closes the run.

        Args:
            record: of the run that `start_run` began.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptBundle:
    """Scripts as they are sent to a host: what runs, and what must lie next to it."""

    runs: str  # file name, one of `files`
    files: Mapping[str, str]  # name -> text, to the byte
    longest_grace_ms: int = 0  # it may wait so long for one guest to shut down, and say nothing


class EventKind(StrEnum):
    """The subject of a script's event (docs/scripts.md)."""

    STEP = "step"
    LOCK = "lock"
    REFUSED = "refused"
    FAILED = "failed"
    RUN = "run"


class EventStatus(StrEnum):
    """The outcome of the event's subject."""

    READING = "reading"
    WAITED = "waited"
    NOTED = "noted"
    BEGUN = "begun"
    CHANGED = "changed"
    UNCHANGED = "unchanged"
    SKIPPED = "skipped"
    PREVIEWED = "previewed"
    REFUSED = "refused"
    FAILED = "failed"
    STOPPED = "stopped"
    ABANDONED = "abandoned"
    DONE = "done"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEvent:
    """One line that a running script says of itself."""

    kind: EventKind
    plan: str
    number: int  # of the script's step, from 0; 0 too where it is about no step
    total: int
    address: str
    status: EventStatus
    detail: str
    changed: int | None = None  # steps that the run changed until then; None: scripts of early versions do not say

    @property
    def reason(self) -> str:
        """Why a script refused or failed; never empty."""
        return last_words(self.detail)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptExited:
    """The script ran to its end, with this exit code; `last_lines`: what it wrote apart from its events."""

    code: int
    last_lines: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptLost:
    """The connection ended before the script did: it may have gone on, or still run."""

    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class WaitLimits:
    """The longest waits of a run: for a host that another run holds, and for a script that says nothing."""

    lock_ms: int = 0
    silence_ms: int = 600_000


NO_WAITING = WaitLimits()
"""The default: a held host is not waited for."""


class EventListener(Protocol):
    """Follows a running script, and is asked whether it should go on; its methods must not raise."""

    def on_event(self, event: RunEvent) -> None:
        """Take an event of the script, in the order in which the script wrote it.

        Args:
            event: checked, with its number counted from 0.
        """

    def on_output(self, line: str) -> None:
        """Take a line of the script's output that is not an event, without its line end."""

    def should_stop(self) -> bool:
        """Return whether the script should end before its next step; asked a few times a second.

        Returns:
            True from the request on.
        """


@runtime_checkable
class ScriptedHost(ReadableHost, Protocol):
    """A host that runs whole scripts, which hold the lock, keep the journal and guard every step themselves."""

    def journal(self) -> ScriptRun | None:
        """Return the last run on this host, None where there was none.

        Returns:
            The run, as the host's own journal has it.

        Raises:
            HostDamaged: it cannot be read, or belongs to an account that must not be believed.
            HostError: the host cannot be reached or read.
        """

    def unfinished(self) -> ScriptRun | None:
        """Return the last run, where it is neither completed nor abandoned; it raises as `journal` does.

        Returns:
            As `journal` returns it.
        """

    def run_script(
        self, script: ScriptBundle, waits: WaitLimits, listener: EventListener, *, abandoning: bool = False
    ) -> ScriptExited | ScriptLost:
        """Have the host run these bytes and no others.

        Args:
            script: the script that runs, and those that must lie next to it.
            waits: how long to wait for a held host, and for a silent script.
            listener: receives each event, and is asked whether to stop.
            abandoning: whether the script only closes its unfinished run.

        Returns:
            The exit code, or why the end was not heard.

        Raises:
            HostError: the host cannot be reached or runs no scripts; nothing happened.
        """


@runtime_checkable
class RecordableHost(Protocol):
    """A host whose observation is stored as it is printed, because it holds more than a State."""

    def recorded(self) -> bytes:
        """Return the output of the observe script, as `--snapshot` reads it.

        Returns:
            UTF-8 text.

        Raises:
            HostError: as of `observe`.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotListener:
    """Follows a command that a robot's rarms does; what is called must not raise, but for arguments that do not fit."""

    # By target: a class of reporters, and the one that hears its calls in the order in which the robot made them.
    reporters: Mapping[str, tuple[type[Any], Any]] = field(default_factory=dict)
    should_stop: Callable[[], bool] = lambda: False  # at the next safe place; asked a few times a second


UNHEARD = RobotListener()
"""The listener of a command that only reads."""


@runtime_checkable
class RobotHost(HoldableHost, Protocol):
    """A host whose own rarms does whole commands: it holds itself, keeps the journal and guards every step."""

    def ask(self, command: str, job: Json, listener: RobotListener = UNHEARD) -> Json:
        """Have the robot's rarms do a command, and return its result.

        Args:
            job: what the command needs, encoded.
            listener: hears its calls, and is asked whether to stop.

        Returns:
            The result, encoded.

        Raises:
            HostError: the host cannot be reached, has another version, or ended without a result.
        """


LiveHost = StepwiseHost | ScriptedHost | RobotHost
