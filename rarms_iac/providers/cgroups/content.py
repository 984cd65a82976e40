"""Definitions of partitions, and their settings as the kernel's values show them. Pure.

A definition is one file of JSON, one setting a line, replaced as a whole. A partition runs if its definition has the
id of the machine's latest start (`boot`) and its control group exists; otherwise it is off.
"""

import json
import math
import uuid
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from rarms_iac.model.host import Host
from rarms_iac.model.operation_effects import applied
from rarms_iac.model.operations import (
    CreatePartition,
    EraseMark,
    RenamePartition,
    RestorePartition,
    SetActions,
    SetCpu,
    SetMemory,
    SetProcessors,
    WriteMark,
)
from rarms_iac.model.quantities import in_processors, show_bytes
from rarms_iac.model.state import (
    NO_GENERATION,
    Checkpoints,
    Partition,
    PartitionSettings,
    RunState,
    StartAction,
    State,
    StopAction,
)
from rarms_iac.providers.cgroups.groups import USUAL_PERIOD_US, GroupValues
from rarms_iac.providers.cgroups.machine import NAMESPACE, LinuxMachine
from rarms_iac.providers.marks import MarkReading, erase_mark, read_marks, write_mark
from rarms_iac.storage.codec import decode, encode
from rarms_iac.storage.json_text import parse_json

Format = Literal["rarms-partition/1"]
LONGEST_NAME = 100
SettingOperation = SetProcessors | SetCpu | SetMemory | SetActions | RenamePartition | WriteMark | EraseMark
"""Operations that change a definition."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupDefinition:
    """A partition as its file defines it, running or not."""

    id: str
    settings: PartitionSettings  # `running` is always false: see `is_running`
    notes: str = ""
    group: str = ""  # name of its control group below the slice; empty: it has none
    boot: str = ""  # id of the machine's start in which the group was made; empty: it is being made or removed
    changing: bool = False  # the group is given values that this definition does not have yet
    format: Format = "rarms-partition/1"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunningGroup:
    """A control group in the kernel: its values, and those that the kernel would show if it were as defined."""

    actual: GroupValues
    wanted: GroupValues | None = None  # None: no definition names this group


def write_definition(definition: GroupDefinition) -> bytes:
    """Return the content of a definition's file."""
    return (json.dumps(encode(definition), indent=1, sort_keys=True) + "\n").encode("ascii")


def read_definition(data: bytes) -> GroupDefinition:
    """Return the definition in a file.

    Args:
        data: the file's content.

    Raises:
        NotDecodable: the content is not as `write_definition` writes it.
    """
    return decode(GroupDefinition, parse_json(data.decode("utf-8", "replace")))


def new_definition(operation: CreatePartition, name: str, host: str, taken: Iterable[str]) -> GroupDefinition:
    """Define a new partition, off and without reserve.

    Args:
        operation: says its memory.
        name: of the partition; with the host's id it decides the new id.
        host: the machine's id.
        taken: ids of the host's partitions, which the new one does not get.
    """
    known = frozenset(taken)
    number = next(number for number in _ids(f"{host}/{name}") if number not in known)
    return GroupDefinition(id=number, settings=_new_settings(name, operation.memory))


def restored_definition(operation: RestorePartition) -> GroupDefinition:
    """Define a partition again that was removed: off, under its id."""
    notes = operation.other_notes
    notes = write_mark(notes, operation.mark) if operation.mark else notes
    return GroupDefinition(id=operation.machine, settings=operation.settings, notes=notes)


def foreign_definition(name: str, group: RunningGroup, machine: LinuxMachine) -> GroupDefinition:
    """Return a group that no definition names as a partition, under an id that is always the same.

    Args:
        name: of the group.
        group: its values.
        machine: on which it is.
    """
    number = str(uuid.uuid5(NAMESPACE, f"{machine.id}/group/{name}"))
    settings = observed_settings(_new_settings(name, 0), replace(group, wanted=None), machine.logical_processors)
    return GroupDefinition(id=number, settings=settings, group=name, boot=machine.boot)


def _new_settings(name: str, memory: int) -> PartitionSettings:
    return PartitionSettings(
        name=name,
        generation=NO_GENERATION,
        processors=1,
        reserve=0,
        limit=100,
        weight=100,
        memory=memory,
        dynamic_memory=False,
        start_action=StartAction.NOTHING,
        stop_action=StopAction.SHUT_DOWN,
        checkpoints=Checkpoints.DISABLED,
        running=False,
    )


def changed(definition: GroupDefinition, operation: SettingOperation) -> GroupDefinition:
    """Return the definition after an operation on it."""
    match operation:
        case WriteMark():
            return replace(definition, notes=write_mark(definition.notes, operation.mark(definition.id)))
        case EraseMark():
            return replace(definition, notes=erase_mark(definition.notes))
        case _:
            return replace(definition, settings=applied(definition.settings, operation))


def out_of_range(settings: PartitionSettings) -> str:
    """Describe the first setting that no control group can have; empty where all are possible.

    NOTE: a limit below the reserve is possible. It may have been written by hand, and the undo of its repair does.
    """
    if not 0 < len(settings.name) <= LONGEST_NAME or "/" in settings.name or settings.name in {".", ".."}:
        return f"a partition's name has 1 to {LONGEST_NAME} characters and no slash"
    if settings.processors < 1:
        return f"a partition has at least 1 processor, not {settings.processors}"
    if not 0 <= settings.reserve <= 100 or not 0 <= settings.limit <= 100:
        return f"reserve and limit are 0 to 100 %, not {settings.reserve} % and {settings.limit} %"
    if settings.limit < 1:
        return "with a limit of 0 % nothing would run: the limit is at least 1 %"
    if not 1 <= settings.weight <= 10_000:
        return f"a weight is 1 to 10000, not {settings.weight}"
    if settings.memory < 0:
        return f"memory is at least 0 B, not {settings.memory} B"
    return "a control group has no dynamic memory" if settings.dynamic_memory else ""


def lack_of_memory(wanted: PartitionSettings, machine: str, state: State) -> str:
    """Describe the memory that is missing for a partition beside those that run; empty: there is enough.

    Args:
        wanted: the partition's settings.
        machine: its id.
        state: of the host.
    """
    taken = sum(other.settings.memory for other in _others_running(machine, state))
    if taken + wanted.memory <= state.facts.memory:
        return ""
    free = max(0, state.facts.memory - taken)
    needed, room = show_bytes(wanted.memory, free), show_bytes(free, wanted.memory)
    return f"{wanted.name} needs {needed}, and of {show_bytes(state.facts.memory)} {room} are free"


def lack_of_reserve(wanted: PartitionSettings, machine: str, state: State) -> str:
    """Describe why a reserve does not fit beside those of the partitions that run; empty: it fits.

    Args:
        wanted: the partition's settings.
        machine: its id.
        state: of the host.
    """
    available = state.facts.logical_processors
    if not wanted.reserve:
        return ""
    if wanted.processors > available:
        return f"{wanted.name} has {wanted.processors} processors with a reserve, and the host has {available}"
    taken = sum(other.settings.reserve * other.settings.processors for other in _others_running(machine, state))
    if taken + wanted.reserve * wanted.processors <= 100 * available:
        return ""
    return (
        f"the reserve of {wanted.name}, {wanted.reserve} % of each of {wanted.processors} processors, "
        f"does not fit {available} logical processors beside what runs"
    )


def _others_running(machine: str, state: State) -> list[Partition]:
    return [other for other in state.partitions if other.id != machine and other.settings.running]


def slice_limit(host: Host, processors: int) -> int | None:
    """Return what all partitions together get at most: all but `keep_for_host`, in whole per cent of one processor.

    Args:
        host: as the manifest describes it.
        processors: logical processors of the machine.

    Returns:
        At least 1; None: nothing is kept, so nothing limits them.
    """
    withheld = in_processors(host.keep_for_host.processor, processors)
    return max(1, math.floor(100 * (processors - withheld))) if withheld else None


def values_of(settings: PartitionSettings, processors: int, limit: int | None = None) -> GroupValues:
    """Return the values of a partition's control group.

    Args:
        settings: as defined.
        processors: logical processors of the machine.
        limit: as `slice_limit` gives it: no quota is larger.
    """
    is_limited = settings.limit < 100 or settings.processors < processors
    quota = min(settings.limit * settings.processors, limit or 100 * processors)
    return GroupValues(
        shares_percent=settings.reserve * settings.processors,
        quota_percent=quota if is_limited else None,
        period_us=settings.quota_period_us or USUAL_PERIOD_US,
        memory=settings.memory or None,
    )


def to_partitions(
    definitions: Iterable[GroupDefinition], running: Mapping[str, RunningGroup], boot: str, processors: int
) -> tuple[Partition, ...]:
    """Return the partitions, sorted by name and then id, with their valid marks.

    Args:
        definitions: of all partitions, those of unmanaged groups included.
        running: by name of the group: those that are in the kernel.
        boot: the machine's latest start.
        processors: logical processors of the machine.
    """
    known = sorted(definitions, key=lambda definition: (definition.settings.name, definition.id))
    judged = read_marks({definition.id: definition.notes for definition in known})
    return tuple(_partition(definition, judged[definition.id], running, boot, processors) for definition in known)


def is_running(definition: GroupDefinition, groups: Iterable[str], boot: str) -> bool:
    """Return whether the partition's control group exists and was made completely since the machine's start."""
    return bool(definition.boot) and definition.boot == boot and definition.group in groups


def _partition(
    definition: GroupDefinition, judged: MarkReading, running: Mapping[str, RunningGroup], boot: str, processors: int
) -> Partition:
    settings, runs = definition.settings, is_running(definition, running, boot)
    if runs:
        group = running[definition.group]
        # NOTE: while values are being written, the old settings count; the next run that holds the host restores them.
        observed = settings if definition.changing else observed_settings(settings, group, processors)
        settings = replace(observed, running=True)
    return Partition(
        settings=settings,
        id=definition.id,
        state=RunState.RUNNING if runs else RunState.OFF,
        mark=judged.mark,
        other_notes=judged.other_notes,
        foreign_mark=judged.foreign,
    )


def observed_settings(settings: PartitionSettings, group: RunningGroup, processors: int) -> PartitionSettings:
    """Return the settings that the kernel's values show; where a value is as defined, so is its setting.

    Args:
        settings: as defined; of an unmanaged group anything.
        group: its values.
        processors: logical processors of the machine.
    """
    actual, wanted = group.actual, group.wanted
    if actual == wanted:
        return settings
    count = _processors(settings, group, processors)
    reserve, limit = settings.reserve, settings.limit
    if wanted is None or count != settings.processors or actual.shares_percent != wanted.shares_percent:
        reserve = _percent(actual.shares_percent / count, reserve)
    if wanted is None or count != settings.processors or actual.quota_percent != wanted.quota_percent:
        least = min(1, limit - 1)  # what a partition may be given, too; 0 only to be no less than a change from 1
        limit = 100 if actual.quota_percent is None else max(least, _percent(actual.quota_percent / count, limit))
    return replace(
        settings,
        processors=count,
        reserve=reserve,
        limit=limit,
        quota_period_us=_period(settings, group),
        memory=settings.memory if wanted is not None and actual.memory == wanted.memory else actual.memory or 0,
    )


def _processors(settings: PartitionSettings, group: RunningGroup, processors: int) -> int:
    """Return how many of the machine's processors a group can use at the same time, by its cpuset and its quota."""
    actual, wanted = group.actual, group.wanted
    of_set = processors if actual.processors is None else len(actual.processors)
    is_limited = actual.quota_percent is not None
    if wanted is not None and is_limited == (wanted.quota_percent is not None):
        return min(settings.processors, of_set)
    if wanted is None and actual.quota_percent is not None:
        return min(of_set, max(1, math.ceil(actual.quota_percent / 100)))
    return of_set


def _period(settings: PartitionSettings, group: RunningGroup) -> int | None:
    actual, wanted = group.actual, group.wanted
    if actual.quota_percent is None:
        return None
    as_wanted = wanted is not None and wanted.quota_percent is not None and wanted.period_us == actual.period_us
    return settings.quota_period_us if as_wanted else actual.period_us


def _percent(actual: float, defined: int) -> int:
    """Return whole per cent, rounded away from the defined ones, so that rounding hides no change."""
    whole = math.floor(actual) if actual < defined else math.ceil(actual)
    return min(max(whole, 0), 100)


def _ids(seed: str) -> Iterator[str]:
    number = uuid.uuid5(NAMESPACE, seed)
    while True:
        yield str(number)
        number = uuid.uuid5(number, seed)
