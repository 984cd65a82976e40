"""An observation as a State: what a Hyper-V host, or a Windows inside one of its guests, looks like. Pure."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TypeVar

from rarms_iac.model.capacity import SMT_THREADS, core_sharing
from rarms_iac.model.host import ProviderKind, SchedulerType, host_identity
from rarms_iac.model.journal import ScriptRun, ScriptStarted
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.names import TASK_VALUES
from rarms_iac.model.state import (
    SECURE_BOOT_OFF,
    Checkpoints,
    Disk,
    DiskKind,
    HostFacts,
    Partition,
    PartitionSettings,
    ProcessorKind,
    RegistryValue,
    Responsiveness,
    Rights,
    RunState,
    StartAction,
    State,
    StopAction,
    TaskClass,
    TaskRecord,
    Tie,
    ValueKind,
)
from rarms_iac.providers.hyperv.observation import (
    HostObservation,
    HypervisorFacts,
    NamedValue,
    ObservedMachine,
    ProcessorSetting,
    RecordKey,
    Socket,
    Unread,
    VirtualDisk,
    is_denied,
    or_else,
)
from rarms_iac.providers.journaled import split_run
from rarms_iac.providers.machines import with_marks
from rarms_iac.storage.codec import NotDecodable, decode, decode_union
from rarms_iac.storage.json_text import parse_json
from rarms_iac.storage.records import Damaged, records_in
from rarms_iac.texts.messages import quoted

_NO_GROUP = "00000000-0000-0000-0000-000000000000"
_INSTANCE = re.compile(r"Microsoft:(?P<id>[0-9a-fA-F-]{36})\\")
_REPLICAS = frozenset({"Replica", "TestReplica", "ExtendedReplica"})

REPLICA_MARK = "the machine is a replica of a machine on another host"
"""Why a mark on it does not count."""


def processor_settings(observation: HostObservation) -> Iterator[tuple[str, ProcessorSetting]]:
    """Yield settings by the id of their machine; those of checkpoints carry ids that no machine has."""
    for setting in or_else(observation.cpu_groups, ()):
        if instance := _INSTANCE.match(setting.instance):
            yield instance["id"].lower(), setting


def cpu_groups_of(observation: HostObservation) -> Mapping[str, str]:
    """Return the CPU group of each machine that is in one, by machine id."""
    groups = ((machine, setting.group.strip("{}").lower()) for machine, setting in processor_settings(observation))
    return {machine: group for machine, group in groups if group not in {"", _NO_GROUP}}


def ties_of(machine: ObservedMachine, groups: Mapping[str, str]) -> tuple[Tie, ...]:
    """Return the ties of a machine.

    Args:
        groups: by id of a machine: its CPU group.

    Returns:
        The ties in their order; none of what an older observation did not ask.
    """
    facts = {
        Tie.REPLICA: machine.replication_mode in _REPLICAS,
        Tie.CLUSTER: machine.clustered == "True",
        Tie.CPU_GROUP: machine.id in groups,
    }
    return tuple(tie for tie, holds in facts.items() if holds)


E = TypeVar("E", bound=Enum)

CLIENT = "Client"

JOURNAL = "%ProgramData%\\rarms\\journal.jsonl"
TRUSTED = frozenset({"S-1-5-32-544", "S-1-5-18", ""})
"""Administrators and SYSTEM; empty where the system has no such owners, as off Windows."""
_SCHEDULERS = {
    1: SchedulerType.CLASSIC,
    2: SchedulerType.CLASSIC,
    3: SchedulerType.CORE,
    4: SchedulerType.ROOT,
}
_AT_REST = {"Off": RunState.OFF, "Running": RunState.RUNNING, "Paused": RunState.PAUSED, "Saved": RunState.SAVED}
_RESPONSIVENESS = SYSTEM_RESPONSIVENESS.lower()
_DISKS = {"Fixed": DiskKind.FIXED, "Dynamic": DiskKind.DYNAMIC, "Differencing": DiskKind.DIFFERENCING}
_SPELT = {name.lower(): name for name in TASK_VALUES}
_KINDS = {"dword": ValueKind.DWORD, "string": ValueKind.SZ} | {kind.value: kind for kind in ValueKind}


def to_state(observation: HostObservation, name: str) -> State:
    """Return the host that the manifest calls `name`: without proven rights no machines (windows.md 5).

    Raises:
        NotDecodable: an enumeration has a name that Hyper-V does not give.
    """
    facts = facts_of(observation, name)
    return State(
        facts=facts,
        partitions=partitions_of(observation, facts) if facts.rights is Rights.PROVEN else (),
        tasks=tasks_of(observation),
        serials=serials_of(observation),
        responsiveness=responsiveness_of(observation),
        switches=or_else(observation.switches, None) if facts.rights is Rights.PROVEN else None,
        disks=disks_of(observation) if facts.rights is Rights.PROVEN else (),
        largest_node=_largest_node(observation),
        memory_left=sum(free) if (free := _left_of_nodes(observation)) else None,
        node_left=max(free, default=None),
    )


def _largest_node(observation: HostObservation) -> int | None:
    """Return the most memory of a machine if NUMA spanning is off, in bytes; WMI does not report it."""
    hypervisor, nodes = or_else(observation.hypervisor, None), or_else(observation.numa, ())
    if hypervisor is None or hypervisor.numa_spanning:
        return None
    return max((node.memory for node in nodes), default=0) * 2**20 or None


def _left_of_nodes(observation: HostObservation) -> tuple[int, ...]:
    """Return the memory of each NUMA node that machines can still have, in bytes."""
    return tuple(node.memory_available * 2**20 for node in or_else(observation.numa, ()))


def facts_of(observation: HostObservation, name: str) -> HostFacts:
    """Return the facts of the host that decisions use."""
    sockets = or_else(observation.processors, ())
    hypervisor, windows = or_else(observation.hypervisor, None), or_else(observation.windows, None)
    return HostFacts(
        name=name,
        id=identity_of(or_else(observation.machine_id, "")),
        provider=ProviderKind.HYPERV,
        computer_name=hypervisor.name if hypervisor else observation.computer,
        os_build=windows.build if windows else 0,
        client=is_client(observation),
        scheduler=scheduler_of(observation),
        smt=sum(socket.logical for socket in sockets) > sum(socket.cores for socket in sockets),
        logical_processors=hypervisor.logical_processors if hypervisor else sum(socket.logical for socket in sockets),
        memory=hypervisor.memory if hypervisor else 0,
        rights=rights_of(observation),
        disk_folder=hypervisor.disk_folder if hypervisor else "",
        processor_kinds=_kinds_of(sockets, hypervisor),
    )


def _kinds_of(sockets: Sequence[Socket], hypervisor: HypervisorFacts | None) -> tuple[ProcessorKind, ...]:
    """Return cores with one thread and with two: Windows shows sums, and under minroot not those of the whole host."""
    if hypervisor is None or sum(socket.logical for socket in sockets) != hypervisor.logical_processors:
        return ()
    doubles = sum(max(0, socket.logical - socket.cores) for socket in sockets)
    singles = hypervisor.logical_processors - SMT_THREADS * doubles
    if not doubles or singles <= 0:
        return ()
    kinds = ProcessorKind(processors=singles, threads=1), ProcessorKind(processors=2 * doubles, threads=SMT_THREADS)
    return tuple(sorted(kinds))


_GUID = re.compile(r"\s*[0-9A-Fa-f]{8}(?:-[0-9A-Fa-f]{4}){3}-[0-9A-Fa-f]{12}\s*")


def identity_of(machine_id: str) -> str:
    """Return the host's identity, of which an older observation holds the Windows' own id."""
    return host_identity(machine_id) if _GUID.fullmatch(machine_id) else machine_id


def is_client(observation: HostObservation) -> bool:
    """Return whether it is a client Windows."""
    windows = or_else(observation.windows, None)
    return windows is not None and windows.installation == CLIENT


def scheduler_of(observation: HostObservation) -> SchedulerType:
    """Return the scheduler that its event names.

    Where the log lost the event it is root on a client (windows.md 2), else unknown.
    """
    scheduler = _SCHEDULERS.get(or_else(observation.scheduler, 0))
    return scheduler or (SchedulerType.ROOT if is_client(observation) else SchedulerType.UNKNOWN)


def rights_of(observation: HostObservation) -> Rights:
    """Return whether an empty list of machines would prove that there are none.

    Proven by elevation, or by the host's own instance, which only who may see machines sees. Where neither can be
    asked, Hyper-V's own answer about the host, which it refuses to all others, has to do.
    """
    asked = (observation.elevated, observation.host_visible)
    if isinstance(observation.machines, Unread):
        may_not = is_denied(observation.machines) or not or_else(observation.elevated, True)
        return Rights.MISSING if may_not else Rights.UNKNOWN
    if any(or_else(probe, False) for probe in asked):
        return Rights.PROVEN
    if all(isinstance(probe, Unread) and not is_denied(probe) for probe in asked):
        return Rights.UNKNOWN if isinstance(observation.hypervisor, Unread) else Rights.PROVEN
    return Rights.MISSING


def partitions_of(observation: HostObservation, facts: HostFacts) -> tuple[Partition, ...]:
    """Return the machines of the host with these facts by name, then id, with the marks that count.

    Raises:
        NotDecodable: an enumeration has a name that Hyper-V does not give.
    """
    builds, mute = _guest_builds(observation), _mute_guests(observation)
    groups = cpu_groups_of(observation)
    secure_boot = {
        firmware.machine: SECURE_BOOT_OFF if firmware.secure_boot == "Off" else firmware.template
        for firmware in or_else(observation.firmware, ())
    }
    marked = with_marks(
        (
            replace(
                _partition(machine, facts, secure_boot.get(machine.id, "")),
                guest_build=builds.get(machine.id, 0),
                can_be_asked=machine.id not in mute,
                cpu_group=groups.get(machine.id, ""),
                ties=ties_of(machine, groups),
            ),
            machine.notes,
        )
        for machine in or_else(observation.machines, ())
    )
    return tuple(map(_tied, marked))


def _tied(partition: Partition) -> Partition:
    """Return a replica without its mark, which is its primary's."""
    if Tie.REPLICA not in partition.ties or partition.mark is None:
        return partition
    return replace(partition, mark=None, foreign_mark=REPLICA_MARK)


_ITEM = re.compile(r'<PROPERTY NAME="(?P<property>Name|Data)"[^>]*>\s*<VALUE>(?P<value>[^<]{0,200})</VALUE>')
_ENABLED, _ANSWERS = 2, (2, 3)  # degraded: the guest's version of the service is another one, and it works


def _guest_builds(observation: HostObservation) -> Mapping[str, int]:
    """Return the builds of the Windows that guests say they run, by the ids of their machines (windows.md 3)."""
    builds: dict[str, int] = {}
    for guest in or_else(observation.guests, ()):
        pairs = [{match["property"]: match["value"] for match in _ITEM.finditer(item)} for item in guest.system]
        claims = {pair.get("Name"): pair.get("Data", "") for pair in pairs}
        if "Windows" in claims.get("OSName", "") and (build := claims.get("OSBuildNumber", "")).isdecimal():
            builds[guest.machine] = int(build)
    return builds


def _mute_guests(observation: HostObservation) -> frozenset[str]:
    """Return the machines whose guests cannot be asked to shut down.

    The service is off, or nothing answers in the guest.
    """
    return frozenset(
        service.machine
        for service in or_else(observation.shutdown_services, ())
        if service.enabled != _ENABLED or not set(service.status[:1]) & set(_ANSWERS)
    )


def disks_of(observation: HostObservation) -> tuple[Disk, ...]:
    """Return the virtual disks that machines have, by path; where only the path is known, of unknown kind."""
    known_disks = {disk.path: disk for disk in or_else(observation.virtual_disks, ())}
    attached = sorted(
        (path, machine.id) for machine in or_else(observation.machines, ()) for path in machine.disks if path
    )
    return tuple(_disk(path, machine, known_disks.get(path)) for path, machine in attached)


def _disk(path: str, machine: str, known: VirtualDisk | None) -> Disk:
    kind = _DISKS.get(known.type, DiskKind.UNKNOWN) if known else DiskKind.UNKNOWN
    return Disk(path=path, kind=kind, parent=known.parent if known else "", machine=machine)


def tasks_of(observation: HostObservation) -> tuple[TaskClass, ...]:
    """Return the task classes of that operating system by name, a record without its key included."""
    records = _records(or_else(observation.records, ()))
    records.pop(_RESPONSIVENESS, None)
    keys = {key.name.lower(): key for key in or_else(observation.tasks, ())}
    return tuple(
        TaskClass(
            name=keys[lower].name if lower in keys else records[lower][0],
            values=values_of(keys[lower].values) if lower in keys else {},
            record=records[lower][1] if lower in records else None,
        )
        for lower in sorted({*keys, *records})
    )


def responsiveness_of(observation: HostObservation) -> Responsiveness | None:
    """Return SystemResponsiveness of that system with its record; None if the caller may not read it."""
    if is_denied(observation.profile) or is_denied(observation.records):
        return None
    values = {name.lower(): value for name, value in values_of(or_else(observation.profile, ())).items()}
    _, record = _records(or_else(observation.records, ())).get(_RESPONSIVENESS, ("", None))
    return Responsiveness(value=values.get(_RESPONSIVENESS), record=record)


@dataclass(frozen=True, slots=True, kw_only=True)
class UnusableJournal:
    """Nothing is known of the last run."""

    problem: str  # follows the file's name
    advice: str


def last_run_of(observation: HostObservation) -> ScriptRun | UnusableJournal | None:
    """Return the last run according to the journal of that operating system; None: nothing has run there yet."""
    journal = or_else(observation.journal, None)
    return last_run(journal.owner, journal.text) if journal else None


def last_run(owner: str, text: str) -> ScriptRun | UnusableJournal:
    """Read the last run from the journal (docs/scripts.md has its records).

    One that belongs to neither Administrators nor SYSTEM was planted: it must not tell an administrator what to do.
    """
    if owner not in TRUSTED:
        advice = "Find out who created it, then remove it. Scripts do not run while it exists."
        return UnusableJournal(problem=f"belongs to {owner}, not to Administrators or SYSTEM", advice=advice)
    try:
        started, steps, closed = split_run(records_in(text.encode("utf-8", "surrogatepass"), Path(JOURNAL)))
        touched = started.get("touched")
        texts = [str(number) for number in touched] if isinstance(touched, list) else []
        return ScriptRun(started=decode(ScriptStarted, {**started, "touched": texts}), steps=steps, closed=closed)
    except Damaged as error:
        why = f"line {error.line}: {error.message}"
    except NotDecodable as error:
        why = str(error)
    return UnusableJournal(
        problem=f"is damaged: {why}", advice="Check the result of the last run, then remove the file."
    )


def serials_of(observation: HostObservation) -> Mapping[str, int]:
    """Return the number of applies and undos by application; none if the journal is not to be believed."""
    run = last_run_of(observation)
    return dict(sorted(run.started.serials.items())) if isinstance(run, ScriptRun) else {}


def values_of(values: Iterable[NamedValue]) -> dict[str, RegistryValue]:
    """Return registry values with their types; known names in their usual spelling: the registry ignores case."""
    return {
        _SPELT.get(named_value.name.lower(), named_value.name): RegistryValue(
            kind=_KINDS.get(named_value.kind.lower(), ValueKind.OTHER), data=named_value.data
        )
        for named_value in values
    }


def run_state(state: str) -> RunState:
    """Return the state of a machine by Hyper-V's name for it (windows.md 3).

    What is on its way to another state is busy.
    """
    if state.endswith("Critical"):
        return RunState.CRITICAL
    return _AT_REST.get(state, RunState.BUSY)


def _partition(machine: ObservedMachine, facts: HostFacts, secure_boot: str) -> Partition:
    state = run_state(machine.state)
    settings = PartitionSettings(
        name=machine.name,
        generation=machine.generation,
        processors=machine.processors,
        reserve=machine.reserve,
        limit=machine.limit,
        weight=machine.weight,
        memory=machine.memory,
        dynamic_memory=machine.dynamic_memory,
        start_action=_named(StartAction, machine.start_action, machine, "start_action"),
        stop_action=_named(StopAction, machine.stop_action, machine, "stop_action"),
        checkpoints=_named(Checkpoints, machine.checkpoints, machine, "checkpoints"),
        running=state is RunState.RUNNING,
        secure_boot=secure_boot,
    )
    return Partition(
        settings=settings,
        id=machine.id,
        state=state,
        checkpoints=machine.checkpoint_count,
        sharing=core_sharing(facts, int(machine.threads_per_core) if machine.threads_per_core.isdecimal() else 1),
    )


def _named(kind: type[E], name: str, machine: ObservedMachine, field: str) -> E:
    """Return the member whose name Hyper-V writes as one word, such as StartIfRunning."""
    names = {member.name.title().replace("_", ""): member for member in kind}
    if name not in names:
        raise NotDecodable(f"machines[{machine.id}].{field}", f"{quoted(name)} is not one of {', '.join(names)}")
    return names[name]


def _records(keys: Iterable[RecordKey]) -> dict[str, tuple[str, TaskRecord]]:
    """Return, by class in lower case, its name and the record that counts; one without a digest was never finished."""
    found: dict[str, tuple[str, TaskRecord]] = {}
    for key in keys:
        values = {named_value.name.lower(): str(named_value.data) for named_value in key.values}
        if values.get("set"):
            found[key.task.lower()] = (
                key.task,
                TaskRecord(
                    application=key.application,
                    robot=values.get("robot", ""),
                    set=values["set"],
                    before=_before(key, values),
                ),
            )
    return found


def _before(key: RecordKey, values: Mapping[str, str]) -> Mapping[str, RegistryValue] | None:
    """Return the values from before rarms, as the record holds them.

    Raises:
        NotDecodable: the record is not as rarms wrote it.
    """
    path = f"records.{key.application}.{key.task}.before"
    try:
        before: Mapping[str, RegistryValue] | None = decode_union(
            Mapping[str, RegistryValue] | None, parse_json(values.get("before", ""))
        )
    except NotDecodable as error:
        raise NotDecodable(path, str(error)) from None
    return before
