"""The stand-in's state: a Windows with Hyper-V that can be killed, and whose calls can fail, anywhere."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from tests.fake_powershell.values import ScriptError

ADMINISTRATORS, SYSTEM = "S-1-5-32-544", "S-1-5-18"


class Killed(BaseException):
    """The process is gone: no `finally` runs, its open files are closed."""


class Interrupted(BaseException):
    """The user pressed Ctrl-C: every `finally` runs, no `catch` does, and the process ends with 0."""


@dataclass(slots=True, kw_only=True)
class Vm:
    """A machine, in the words of the observation; states and actions by their PowerShell names."""

    id: str
    name: str
    state: str = "Off"
    generation: int = 2
    version: str = "11.0"
    notes: str = ""
    processors: int = 1
    reserve: int = 0
    limit: int = 100
    weight: int = 100
    threads_per_core: str = "0"
    memory: int = 512 * 2**20
    assigned: int = 0  # what it has while it runs; 0: what it starts with
    memory_minimum: int = 512 * 2**20
    memory_maximum: int = 2**40
    dynamic_memory: bool = False
    start_action: str = "StartIfRunning"
    start_delay: int = 0
    stop_action: str = "Save"
    checkpoints: str = "Production"
    checkpoint_count: int = 0
    clustered: str = "False"
    replication_mode: str = "None"
    shielded: bool = False
    cluster_knows: bool = True  # what its cluster keeps of it is how it is
    folder: str = ""  # its own, in which its configuration lies; empty: the host's
    disks: list[str] = field(default_factory=list)
    checkpoint_disks: list[str] = field(default_factory=list)  # what its checkpoints need
    adapters: list[tuple[str, str]] = field(default_factory=list)  # name, switch
    obeys: bool = True  # its guest shuts down when asked
    unsaved: bool = False  # a program holds the shutdown up, until it is forced
    locked: bool = False  # its session refuses a plain request
    was_forced: bool = False
    stopping: int | None = None  # ms of the clock at which it will be off
    asked_at: int | None = None  # ms of the clock
    secure_boot: str = "On"
    template: str = "MicrosoftWindows"
    boots_from: str = "Network"  # what its firmware tries first, but for the guest's own entry
    wrote_entry: bool = False  # its guest put an entry of its own ahead of all others
    needs_ms: int = 2000  # that its guest takes to shut down
    was_cut: bool = False  # it was off before its guest was ready
    guest_build: int = 26100  # of the Windows in it
    tells_build: bool = False  # its host, while it runs
    shutdown_service: bool = True  # it answers while the machine runs
    services_at: int | None = None  # ms of the clock at which it begins to answer
    stop_fails: bool = False  # the job of Stop-VM does
    started_at: int | None = None  # ms of the clock; None: long ago
    counted_at: int = 0  # ms of the clock: until then the hypervisor's counters say what it did
    ran: int = 0  # 100 ns, each of its virtual processors
    waited: int = 0  # ns
    dispatches: int = 0

    @property
    def active(self) -> bool:
        """Whether it holds memory and processor time."""
        return self.state not in ("Off", "Saved")


@dataclass(slots=True, kw_only=True)
class Program:
    """What a program in a guest does: it takes so much processor time, then ends; or writes a line each time."""

    work_ms: float = 0.0  # 0: it goes on for ever, and says nothing
    line: str = ""  # with `{ms}` for how long it took
    stays: bool = False  # it closes its output after its work, and does not end
    code: int = 0


@dataclass(slots=True)
class Process:
    """A process inside a guest."""

    program: str
    arguments: str
    parent: int
    vm: str  # id
    alive: bool = True
    reserve: str = ""  # what RARMS_RESERVE tells it
    began: float = 0.0  # ms of the host's clock


@dataclass(slots=True, kw_only=True)
class Entry:
    """A value of a registry key; numbers without sign."""

    name: str
    kind: str  # DWord, QWord, String, ExpandString, Binary
    data: int | str


@dataclass(slots=True, kw_only=True)
class Key:
    """A registry key; its values by their lower-case names."""

    path: str
    values: dict[str, Entry] = field(default_factory=dict)


@dataclass(slots=True, kw_only=True)
class File:
    """A file or a folder (without data), and whose it is."""

    path: str
    data: bytes | None
    owner: str = ADMINISTRATORS
    link: bool = False  # a junction or symbolic link: what is said of its owner is said of where it leads
    protected: bool = False  # only Administrators and SYSTEM may write it


OWNER = "C:\\ProgramData\\rarms\\owner.txt"
"""The file that a run has open, shared for reading, while it holds its computer."""


@dataclass(frozen=True, slots=True)
class Opened:
    """A file that a process has open: what it does with it, and what it lets others do meanwhile."""

    path: str  # lower case
    access: frozenset[str]
    share: frozenset[str]
    here: bool  # by the script that runs


READ, WRITE, DELETE = frozenset({"read"}), frozenset({"write"}), frozenset({"delete"})
READ_WRITE = READ | WRITE


@dataclass(slots=True)
class WindowsHost:
    """Everything that observe.ps1 looks at, and what else a run leaves."""

    computer: str = "ONBOARD"
    user: str = "operator"
    logical_processors: int = 2
    memory: int = 4 * 2**30
    numa_spanning: bool = True
    machine_folder: str = "C:\\ProgramData\\Microsoft\\Windows\\Hyper-V"
    disk_folder: str = "C:\\Users\\Public\\Documents\\Hyper-V\\Virtual Hard Disks"
    scheduler: int | None = 2  # data of event 2; None: it has left the log
    elevated: bool = True
    hyperv_administrator: bool = False
    host_visible: bool = True
    hypervisor_running: bool = True
    counters: bool = True
    module: list[str] = field(default_factory=lambda: ["2.0.0.0"])
    powershell: dict[str, str] = field(default_factory=lambda: {"version": "5.1.26100.1", "edition": "Desktop"})
    bits: int = 64
    loads_hyperv: bool = True  # itself: 7 on Server 2016 does it through 5.1, whose objects come without their kind
    language: str = "FullLanguage"  # what PowerShell lets a script say; AppLocker and App Control take most of it away
    processors: list[dict[str, object]] = field(default_factory=list)
    numa: list[dict[str, int]] = field(default_factory=list)
    switches: list[str] = field(default_factory=list)
    cpu_groups: list[dict[str, object]] = field(default_factory=list)
    execution_policy: list[tuple[str, str]] = field(default_factory=lambda: [("LocalMachine", "RemoteSigned")])
    refusals: dict[str, tuple[str, str, str]] = field(default_factory=dict)  # cmdlet -> error id, category, message
    vms: dict[str, Vm] = field(default_factory=dict)
    registry: dict[str, Key] = field(default_factory=dict)
    files: dict[str, File] = field(default_factory=dict)
    environment: dict[str, str] = field(default_factory=lambda: {"programdata": "C:\\ProgramData", "os": "Windows_NT"})
    defaults: dict[str, object] = field(default_factory=dict)  # a profile's $PSDefaultParameterValues
    profile: str = ""  # functions that were defined before a script runs, as PowerShell
    all_signed: bool = False  # a group policy: a script that is not signed does not run
    interrupt: bool = False  # Ctrl-C as soon as a script waits
    opened: list[Opened] = field(default_factory=list)
    event_log: list[tuple[str, int, str]] | None = field(default_factory=list)  # type, id, text; None: it takes none
    progress: list[tuple[str, int]] = field(default_factory=list)  # what a bar said, and its per cent; -1: it is gone
    aliases: dict[str, str] = field(default_factory=dict)  # a caller's: by lower-case name what is called instead
    clock: int = 0  # ms
    made: int = 0  # machines made so far, for their ids
    effects: list[str] = field(default_factory=list)  # what has been changed, in words
    unflushed: set[str] = field(default_factory=set)  # files whose last write may not be on the disk
    kill_before: int | None = None  # number of the effect, from 0
    kill_after: int | None = None
    fail_at: int | None = None
    guest_user: str = "robot"
    guest_secret: str = "0123456789abcdef"  # as ConvertFrom-SecureString writes it
    guest_files: dict[str, bytes] = field(default_factory=dict)
    programs: dict[str, Program] = field(default_factory=dict)  # of guests, by file name
    processes: list[Process] = field(default_factory=list)  # in guests
    tear: bool = False  # a write that is killed leaves half of its bytes
    watch: Callable[[WindowsHost], None] | None = None  # called after every effect
    slept: Callable[[WindowsHost], None] | None = None  # called whenever a script has waited

    def effect(self, says: str, do: Callable[[], object]) -> None:
        """Change something, unless the process is to die or the call to fail here."""
        number = self.begin_effect(says)
        do()
        self.end_effect(number)

    def begin_effect(self, says: str) -> int:
        """The number of what is changed next, which `end_effect` wants to hear.

        Raises:
            Killed: the process is to die before it.
            ScriptError: the call is to fail.
        """
        number = len(self.effects)
        self.effects.append(says)
        if number == self.kill_before:
            raise Killed(says)
        if number == self.fail_at:
            raise ScriptError(f"{says}: the parameter is incorrect. (0x80070057)", error_id="Unspecified")
        return number

    def end_effect(self, number: int) -> None:
        """It is changed."""
        if self.watch:
            self.watch(self)
        if number == self.kill_after:
            raise Killed(self.effects[number])

    def open(self, path: str, access: frozenset[str], share: frozenset[str], *, here: bool = True) -> Opened:
        """Open a file, as long as all who have it open let it be done, and it lets them.

        Raises:
            ScriptError: another process, or this one, has it open otherwise.
        """
        for other in self.opened:
            if other.path == path.lower() and not (access <= other.share and other.access <= share):
                raise used_elsewhere(path)
        made = Opened(path.lower(), access, share, here)
        self.opened.append(made)
        return made

    def close(self, handle: Opened) -> None:
        """Close it; a second time does nothing."""
        self.opened = [other for other in self.opened if other is not handle]

    def close_all(self) -> None:
        """A process that ends closes what it had open."""
        self.opened = [other for other in self.opened if not other.here]

    @property
    def opened_here(self) -> list[Opened]:
        return [other for other in self.opened if other.here]

    def require_unheld(self, path: str) -> None:
        """Raise where a process has the file open, and does not share it for being deleted or moved."""
        if any(other.path == path.lower() and not other.share >= DELETE for other in self.opened):
            raise used_elsewhere(path)

    @property
    def lock(self) -> str:
        """Who has the file open that a run holds its computer by: none, `held` by another process, `ours`."""
        found = [other for other in self.opened if other.path == OWNER.lower()]
        return "" if not found else "ours" if found[0].here else "held"

    @lock.setter
    def lock(self, held: str) -> None:
        self.opened = [other for other in self.opened if other.path != OWNER.lower()]
        if held:
            self.open(OWNER, WRITE, READ, here=held == "ours")

    def copy(self, **changed: object) -> WindowsHost:
        """A copy, calm: nothing is to be killed or to fail, unless it is said."""
        return copy.deepcopy(self)._calm(**changed)

    def as_bytes(self) -> bytes:
        """What `pickle` makes of the calm host. Nothing is copied: hosts remember a thousand processes."""
        return pickle.dumps(copy.copy(self)._calm(watch=None))

    def _calm(self, **changed: object) -> WindowsHost:
        self.effects, self.tear, self.interrupt, self.slept = [], False, False, None
        self.kill_before = self.kill_after = self.fail_at = None
        for name, value in changed.items():
            setattr(self, name, value)
        return self

    def key(self, path: str) -> Key | None:
        """The registry key, in any case of its path."""
        return self.registry.get(path.lower())

    def below(self, path: str) -> list[Key]:
        """The keys right below this one, by name."""
        prefix = path.lower() + "\\"
        found = [key for low, key in self.registry.items() if low.startswith(prefix) and "\\" not in low[len(prefix) :]]
        return sorted(found, key=lambda disk: disk.path.lower())

    def add_key(self, path: str) -> Key:
        """The key, with those above it."""
        if "\\" in path:
            self.add_key(path.rpartition("\\")[0])
        return self.registry.setdefault(path.lower(), Key(path=path))

    def file(self, path: str) -> File | None:
        return self.files.get(path.lower())

    def data(self, path: str) -> bytes:
        """What is in a file that must be there."""
        file = self.files[path.lower()]
        assert file.data is not None
        return file.data

    def machine(self, name: str) -> Vm:
        """The only machine of this name."""
        (found,) = (vm for vm in self.vms.values() if vm.name == name)
        return found

    def write_file(self, path: str, data: bytes | None, owner: str = ADMINISTRATORS) -> None:
        kept = self.file(path) or File(path=path, data=None, owner=owner)
        self.files[path.lower()] = replace(kept, data=data)


def used_elsewhere(path: str) -> ScriptError:
    says = f"The process cannot access the file '{path}' because it is being used by another process."
    return ScriptError(says, error_id="IOException", kind="System.IO.IOException")
