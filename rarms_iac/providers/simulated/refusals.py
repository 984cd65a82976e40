"""What a simulated host refuses as Hyper-V does (windows.md 1.2, 3, 5), reserves included. Pure."""

from collections.abc import Mapping
from fractions import Fraction

from rarms_iac.diff.readings import disk_readings
from rarms_iac.model.capacity import Capacity, core_sharing, decide_packing
from rarms_iac.model.commands import Wording
from rarms_iac.model.facets import LABELS, Facet, settings_of
from rarms_iac.model.host import SchedulerType
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.operation_effects import applied
from rarms_iac.model.operations import (
    CreatePartition,
    EraseTaskRecord,
    Operation,
    RemoveDisk,
    RemovePartition,
    RemoveTaskClass,
    RenamePartition,
    Set,
    StartPartition,
    StopPartition,
    TaskOperation,
    WriteTaskClass,
    WriteTaskRecord,
)
from rarms_iac.model.quantities import LEAST_MEMORY, MEMORY_GRAIN, Bytes, LogicalProcessors
from rarms_iac.model.state import HostFacts, PartitionSettings, RegistryValue, Rights, RunState, TaskRecord, ValueKind
from rarms_iac.providers.journaled import PLAN_AGAIN
from rarms_iac.providers.machines import cpu_out_of_range, lack_of_memory, lack_of_processors
from rarms_iac.providers.simulated.content import Content, Registry, SimulatedMachine
from rarms_iac.texts.quantities import write_bytes

LONGEST_NAME = 100
"""Characters of a machine's name (windows.md 10)."""
LONGEST_KEY = 255
"""Characters of a registry key's name (windows.md 6.1)."""
MOST_PROCESSORS = {1: 64, 2: 240}
"""Virtual processors by generation (windows.md 2)."""
SERVER_2016, WINDOWS_10 = 14393, 10240
"""Builds from which static memory changes while the machine runs: of a server and of a client (windows.md 3)."""


class Refusal(Exception):
    """An operation is refused: why, and what would help."""

    def __init__(self, message: str, advice: Wording) -> None:
        super().__init__(message)
        self.message = message
        self.advice = advice


def refuse_without_rights(facts: HostFacts) -> None:
    """Refuse everything where the rights are missing."""
    if facts.rights is not Rights.PROVEN:
        raise Refusal(
            f"access to {facts.computer_name} is denied",
            "Run as an administrator of the host (simulated.administrator: true).",
        )


def refuse_creation(operation: CreatePartition, settings: PartitionSettings) -> None:
    """Refuse a machine that cannot be made."""
    if problem := out_of_range(settings):
        raise Refusal(f"{operation.partition} cannot be made: {problem}", "Correct it.")


def refuse_change(
    operation: Operation, machine: SimulatedMachine, content: Content, facts: HostFacts, guest_build: int
) -> None:
    """Refuse what cannot be done to this machine now."""
    match operation:
        case Set():
            _refuse_setting(operation, machine, content, facts, guest_build)
        case RenamePartition():
            _refuse_settings(applied(machine.settings, operation))
        case StartPartition():
            _refuse_start(machine, content, facts)
        case StopPartition() if machine.state is RunState.BUSY:
            raise Refusal(f"{machine.settings.name} is changing its state", "Try again in a moment.")
        case RemovePartition() if machine.state not in {RunState.OFF, RunState.SAVED}:
            state = f"{machine.settings.name} is {machine.state.value}"
            raise Refusal(f"{state}; only a machine that is off can be removed", "Stop it first.")
        case _:
            pass


def _refuse_setting(
    operation: Set, machine: SimulatedMachine, content: Content, facts: HostFacts, guest_build: int
) -> None:
    settings = machine.settings
    for setting in sorted(operation.after.keys() - {*settings_of(settings.generation)}):
        raise Refusal(
            f"{settings.name} has generation {settings.generation}, which does not have {LABELS[setting]}",
            "Create it again.",
        )
    if operation.facet is Facet.MEMORY:
        _refuse_memory(operation, machine, content, facts, guest_build)
        return
    for setting in sorted(operation.row.while_off & operation.after.keys()):
        _refuse_running(machine, f"its {LABELS[setting]}")
    if operation.row.capacity and machine.state is RunState.SAVED:
        _refuse_running(machine, f"its {LABELS[operation.row.capacity]}")
    _refuse_settings(applied(settings, operation))


def refuse_task_change(registry: Registry, operation: TaskOperation) -> None:
    """Refuse what cannot be done to the registry."""
    task = operation.task
    values, record = registry.entry(task)
    described = task if task == SYSTEM_RESPONSIVENESS else f"task class {task}"
    match operation:
        case WriteTaskClass(values=wanted):
            if problem := _impossible_key(task) or _impossible_values(wanted):
                raise Refusal(f"{described}: {problem}", "Correct it.")
        case RemoveTaskClass() if values is None:
            raise Refusal(f"{described} does not exist", PLAN_AGAIN)
        case WriteTaskRecord(record=TaskRecord(application=application)) | EraseTaskRecord(application=application):
            if record is not None and record.application != application:
                raise Refusal(
                    f"{described} belongs to the application {record.application}",
                    "Remove it from one of the two manifests.",
                )
        case _:
            pass


def _impossible_key(task: str) -> str:
    if not task or len(task) > LONGEST_KEY or not task.isprintable() or "\\" in task or "/" in task:
        return f"a key's name has 1 to {LONGEST_KEY} printable characters and no slash"
    return ""


def _impossible_values(values: Mapping[str, RegistryValue]) -> str:
    if len({name.lower() for name in values}) != len(values):
        return "two values differ only by case"
    for name, value in values.items():
        if value.kind is ValueKind.DWORD and not (isinstance(value.data, int) and 0 <= value.data < 2**32):
            return f"{name} is not a 32-bit number"
        if value.kind is ValueKind.SZ and not isinstance(value.data, str):
            return f"{name} is not text"
    return ""


def refuse_disk_removal(content: Content, operation: RemoveDisk) -> None:
    """Refuse to delete a disk that is not there or in use."""
    live = disk_readings(content.disks, operation.path)
    if not live["exists"]:
        raise Refusal(f"the disk {operation.path} does not exist", PLAN_AGAIN)
    if live["used"]:
        raise Refusal(f"{operation.path} is in use", "First remove the machine that uses the disk.")


def _refuse_running(machine: SimulatedMachine, setting: str) -> None:
    if machine.state is RunState.OFF:
        return
    raise Refusal(
        f"{machine.settings.name} is {machine.state.value}; {setting} can only change while it is off",
        "Stop it first.",
    )


def _refuse_settings(settings: PartitionSettings) -> None:
    if problem := out_of_range(settings):
        raise Refusal(f"{settings.name}: {problem}", "Correct it.")


def _refuse_memory(
    operation: Set, machine: SimulatedMachine, content: Content, facts: HostFacts, guest_build: int
) -> None:
    settings = machine.settings
    wanted = applied(settings, operation)
    if wanted == settings:
        return
    _refuse_settings(wanted)
    if wanted.dynamic_memory != settings.dynamic_memory:
        _refuse_running(machine, "switching between static and dynamic memory")
    elif settings.dynamic_memory:
        _refuse_running(machine, "the startup memory of a dynamic machine")
    elif machine.state is not RunState.RUNNING or not _resizes_while_running(facts, guest_build):
        _refuse_running(machine, "its memory")
    elif wanted.memory > settings.memory:
        _refuse_lack_of_memory(wanted, machine, content, facts)


def _resizes_while_running(facts: HostFacts, guest_build: int) -> bool:
    host_needs = WINDOWS_10 if facts.client else SERVER_2016
    return facts.os_build >= host_needs and guest_build >= WINDOWS_10


def _refuse_start(machine: SimulatedMachine, content: Content, facts: HostFacts) -> None:
    if machine.state is RunState.RUNNING:
        return
    if machine.state in {RunState.BUSY, RunState.CRITICAL}:
        raise Refusal(f"{machine.settings.name} is {machine.state.value}", "Check the host.")
    _refuse_lack_of_memory(machine.settings, machine, content, facts)
    _refuse_lack_of_reserve(machine, content, facts)


def _refuse_lack_of_memory(
    wanted: PartitionSettings, machine: SimulatedMachine, content: Content, facts: HostFacts
) -> None:
    others = (other.settings for other in _others_with_resources(machine, content))
    if problem := lack_of_memory(wanted, others, facts.memory):
        raise Refusal(problem, "Stop another machine, or give it less memory.")


def _refuse_lack_of_reserve(machine: SimulatedMachine, content: Content, facts: HostFacts) -> None:
    """Check room at the start and not before; under the root scheduler reserves mean nothing (windows.md 1.2, 2)."""
    settings = machine.settings
    if settings.reserve == 0 or facts.scheduler in {SchedulerType.ROOT, SchedulerType.NONE}:
        return
    sharing, processors = core_sharing(facts), facts.logical_processors
    capacity = Capacity(
        logical_processors=processors,
        processors=LogicalProcessors(Fraction(processors)),
        memory=Bytes(facts.memory),
        sharing=sharing,
    )
    running = (each.settings for each in (machine, *_others_with_resources(machine, content)))
    claims = [sharing.claim(each.processors, each.reserve, each.memory) for each in running]
    # Where it is not known, the documented limit is only the sum.
    fits = settings.processors > processors or decide_packing(claims, capacity) is not False
    if problem := lack_of_processors(settings, processors, fits=fits):
        raise Refusal(problem, "Lower a reserve, or stop another machine.")


def _others_with_resources(machine: SimulatedMachine, content: Content) -> list[SimulatedMachine]:
    """Return the other machines that hold memory and processor time now: paused ones keep theirs."""
    without = {RunState.OFF, RunState.SAVED}
    others = (other for other in content.machines.values() if other.id != machine.id)
    return [other for other in others if other.state not in without]


def out_of_range(settings: PartitionSettings) -> str:
    """Describe what of the settings no machine can have; empty where all is possible (windows.md 1.1, 1.3, 2)."""
    if settings.generation not in MOST_PROCESSORS:
        return f"generation {settings.generation} does not exist, only 1 and 2"
    if not 0 < len(settings.name) <= LONGEST_NAME:
        return f"a machine's name has 1 to {LONGEST_NAME} characters, not {len(settings.name)}"
    most = MOST_PROCESSORS[settings.generation]
    if not 1 <= settings.processors <= most:
        return f"generation {settings.generation} has 1 to {most} virtual processors, not {settings.processors}"
    if settings.memory < LEAST_MEMORY or settings.memory % MEMORY_GRAIN:
        least = write_bytes(LEAST_MEMORY)
        return f"a machine has an even number of MiB, at least {least}, not {write_bytes(settings.memory)}"
    if settings.reserve > settings.limit:
        return f"the reserve of {settings.reserve} % is above the limit of {settings.limit} %"
    return cpu_out_of_range(settings)
