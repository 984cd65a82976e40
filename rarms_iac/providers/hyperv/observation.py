"""The document of `observe.ps1` as values: every probe is what was read, or why there is nothing. Pure.

The format is held strictly: what is unknown, missing or of a wrong type is refused with the path to it. Only a probe
that is not there at all counts as absent: an older script did not look.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeVar, get_args, get_type_hints

from rarms_iac.storage.codec import Json, NotDecodable, decode_union
from rarms_iac.storage.json_text import parse_json
from rarms_iac.texts.messages import quoted

FORMAT = "rarms-observation/1"

_BEGINNING = '{"format":"rarms-observation/'
"""How the one line of the document begins; lines around it are a profile's or a host's noise."""
MAX_BYTES = 64 * 2**20

NOT_LOOKED_FOR: Json = {
    "status": "absent",
    "error": "NotLookedFor",
    "message": "the script does not have this probe",
}

T = TypeVar("T")
D = TypeVar("D")


@dataclass(frozen=True, slots=True, kw_only=True)
class Unread:
    """In place of a value: what the probe asks for is absent, or the caller was denied."""

    status: Literal["absent", "denied"]
    error: str  # PowerShell's id of the error, in no language
    message: str  # its message, in the host's language


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerShell:
    """The PowerShell that ran the script."""

    version: str
    edition: str  # Desktop or Core


@dataclass(frozen=True, slots=True, kw_only=True)
class Windows:
    """The version of a Windows."""

    build: int
    installation: str  # Client, Server, Server Core
    bits: int  # of the process that looked


@dataclass(frozen=True, slots=True, kw_only=True)
class HypervisorFacts:
    """Hyper-V's facts of the host; processors as the hypervisor counts them (windows.md 2, minroot)."""

    name: str
    logical_processors: int
    memory: int  # bytes
    numa_spanning: bool
    disk_folder: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Socket:
    """One processor package, as Windows sees it."""

    name: str
    cores: int
    logical: int


@dataclass(frozen=True, slots=True, kw_only=True)
class NumaNode:
    """One node of memory."""

    memory_available: int
    memory: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservedMachine:
    """A virtual machine as its cmdlets show it: enumerations by name, memory in bytes, reserve and limit per cent."""

    id: str
    name: str
    state: str
    generation: int
    notes: str
    processors: int
    reserve: int
    limit: int
    weight: int
    threads_per_core: str  # empty: the host does not know the setting
    memory: int
    dynamic_memory: bool
    start_action: str
    stop_action: str
    checkpoints: str
    checkpoint_count: int
    clustered: str
    replication_mode: str = ""  # None, Primary, Replica, TestReplica, ExtendedReplica; empty: an older script asked
    disks: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnreadMachine:
    """A machine of which only this is known, because reading its settings failed."""

    id: str
    name: str
    error: str  # PowerShell's id of the error
    message: str  # its message, in the host's language


@dataclass(frozen=True, slots=True, kw_only=True)
class VirtualDisk:
    """A disk that a machine has."""

    path: str
    type: str  # Fixed, Dynamic, Differencing; empty: it could not be read
    parent: str  # of a differencing one


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessorSetting:
    """A machine's processors as WMI has them: its group, its reserve in thousandths of a per cent (windows.md 1.3)."""

    instance: str  # Microsoft:<id>\\...
    group: str
    reservation: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Firmware:
    """The firmware of a machine of generation 2."""

    machine: str  # id
    secure_boot: str  # On, Off
    template: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ToldByGuest:
    """The claims of a guest about its system: items of the key-value exchange as XML, none where its service is off."""

    machine: str  # id
    system: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ShutdownService:
    """The service that a machine's guest is asked through to shut down, in the numbers of WMI."""

    machine: str  # id
    enabled: int  # 2: on the host's side
    status: tuple[int, ...]  # 2: the guest answers


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedValue:
    """A registry value; a DWord or QWord has a number without sign, all others text."""

    name: str
    kind: str  # DWord, String, ...
    data: int | str


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskKey:
    """A multimedia task class."""

    name: str
    values: tuple[NamedValue, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordKey:
    """The registry key of rarms' record of a task class."""

    application: str
    task: str
    values: tuple[NamedValue, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalText:
    """The journal as it lies there, and the SID of who owns it; empty without a Windows."""

    owner: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ScopedPolicy:
    """The execution policy of one scope; the first that is not Undefined decides."""

    scope: str  # MachinePolicy, UserPolicy, Process, CurrentUser, LocalMachine, in this order
    policy: str


@dataclass(frozen=True, slots=True, kw_only=True)
class HostObservation:
    """Everything that `observe.ps1` looked at."""

    computer: str  # as its own operating system calls it
    powershell: PowerShell | Unread
    windows: Windows | Unread
    machine_id: str | Unread
    elevated: bool | Unread
    hyperv_administrator: bool | Unread  # member of the group S-1-5-32-578
    host_visible: bool | Unread  # a caller without rights sees no machines, not even the host's own instance
    module: tuple[str, ...] | Unread  # versions of the Hyper-V module
    scheduler: int | Unread  # as its event says: 1 and 2 classic, 3 core, 4 root
    hypervisor_running: bool | Unread  # the role alone does not start it
    counters: bool | Unread  # those that prove contention are registered
    hypervisor: HypervisorFacts | Unread
    processors: tuple[Socket, ...] | Unread
    numa: tuple[NumaNode, ...] | Unread
    switches: tuple[str, ...] | Unread
    machines: tuple[ObservedMachine, ...] | Unread
    unread_machines: tuple[UnreadMachine, ...] | Unread
    virtual_disks: tuple[VirtualDisk, ...] | Unread
    cpu_groups: tuple[ProcessorSetting, ...] | Unread
    firmware: tuple[Firmware, ...] | Unread
    guests: tuple[ToldByGuest, ...] | Unread
    shutdown_services: tuple[ShutdownService, ...] | Unread
    profile: tuple[NamedValue, ...] | Unread  # of the multimedia system profile
    tasks: tuple[TaskKey, ...] | Unread
    records: tuple[RecordKey, ...] | Unread
    journal: JournalText | Unread
    script_running: bool | Unread  # of rarms; only rarms itself asks, on the host
    execution_policy: tuple[ScopedPolicy, ...] | Unread


def or_else(probe: T | Unread, default: D) -> T | D:
    """Return the value that was read, or this default where none was."""
    return default if isinstance(probe, Unread) else probe


def is_unread(probe: object) -> bool:
    """Return whether something may be unread: only where Windows finds no such path is it surely absent."""
    return is_denied(probe) or (isinstance(probe, Unread) and not probe.error.startswith("PathNotFound"))


def is_denied(probe: object) -> bool:
    """Return whether the caller was not allowed to ask."""
    return isinstance(probe, Unread) and probe.status == "denied"


def document_of(data: bytes) -> Json:
    """Return the JSON of a file, from any PowerShell, with anything else that it said: the document is one line.

    Raises:
        NotDecodable: it is not JSON, or it is too large.
    """
    if len(data) > MAX_BYTES:
        raise NotDecodable("", f"it has more than {MAX_BYTES // 2**20} MiB")
    try:
        text = data.decode(_encoding(data))
        lines = [line for line in text.splitlines() if line.startswith(_BEGINNING)]
        return parse_json(lines[-1] if lines else text)
    except UnicodeDecodeError as error:
        raise NotDecodable("", f"it is not text in {error.encoding}") from None


def is_observation(document: Json) -> bool:
    """Return whether the document comes from `observe.ps1`, of any version."""
    return isinstance(document, dict) and str(document.get("format", "")).startswith("rarms-observation/")


def observation_of(document: Json) -> HostObservation:
    """Return the document as values.

    Raises:
        NotDecodable: it is none of this format, or not as the script writes it.
    """
    if not isinstance(document, dict) or "format" not in document:
        raise NotDecodable("", "it has no `format`, so it is not the output of observe.ps1")
    if document["format"] != FORMAT:
        raise NotDecodable("format", f"this rarms reads {FORMAT}, not {quoted(document['format'])}")
    hints = _probes()
    if unknown := document.keys() - hints.keys() - {"format", "computer"}:
        raise NotDecodable(min(unknown), "this rarms does not know its probes")
    computer = decode_union(str, document.get("computer"))
    found = HostObservation(computer=computer, **{name: _probe(document, name, hint) for name, hint in hints.items()})
    _check_machines(found)
    return found


def _encoding(data: bytes) -> str:
    """Return the encoding: `>` of Windows PowerShell writes UTF-16 with a mark, 7 UTF-8 without; editors add marks."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    if data[:2] in (b"{\0", b"\0{"):
        return "utf-16-le" if data[0] else "utf-16-be"
    return "utf-8-sig"


def _probes() -> dict[str, Any]:
    """Return the type of each probe's value."""
    hints = get_type_hints(HostObservation)
    return {name: get_args(hint)[0] for name, hint in hints.items() if name != "computer"}


def _probe(document: Mapping[str, Json], name: str, hint: Any) -> Any:
    match document.get(name, NOT_LOOKED_FOR):
        case {"status": "value", "value": value, **rest} if not rest:
            return _decoded(hint, value, f"{name}.value")
        case probe:
            return _decoded(Unread, probe, name)


def _decoded(hint: Any, data: Json, path: str) -> Any:
    try:
        return decode_union(hint, data)
    except NotDecodable as error:
        between = "" if not error.path or error.path.startswith("[") else "."
        raise NotDecodable(f"{path}{between}{error.path}", error.message) from None


def _check_machines(found: HostObservation) -> None:
    ids = [machine.id for machine in or_else(found.machines, ())]
    for machine_id in ids:
        if ids.count(machine_id) > 1:
            raise NotDecodable("machines.value", f"two machines have the id {machine_id}")
