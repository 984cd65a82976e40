"""Definitions of partitions: a file of JSON each, one setting a line, replaced as a whole. Pure."""

import json
import uuid
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

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
from rarms_iac.model.state import NO_GENERATION, Checkpoints, PartitionSettings, StartAction, StopAction
from rarms_iac.providers.cgroups.machine import NAMESPACE
from rarms_iac.providers.marks import erase_mark, write_mark
from rarms_iac.storage.codec import decode, encode
from rarms_iac.storage.json_text import parse_json

Format = Literal["rarms-partition/1"]
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
        name: of the partition; with the host's id it decides the new id.
        host: the machine's id.
        taken: ids of the host's partitions, which the new one does not get.
    """
    known = frozenset(taken)
    number = next(number for number in _ids(f"{host}/{name}") if number not in known)
    return GroupDefinition(id=number, settings=new_settings(name, operation.memory))


def restored_definition(operation: RestorePartition) -> GroupDefinition:
    """Define a partition again that was removed: off, under its id."""
    notes = operation.other_notes
    notes = write_mark(notes, operation.mark) if operation.mark else notes
    return GroupDefinition(id=operation.machine, settings=operation.settings, notes=notes)


def new_settings(name: str, memory: int) -> PartitionSettings:
    """Return the settings of a partition that is off and reserves nothing."""
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


def _ids(seed: str) -> Iterator[str]:
    number = uuid.uuid5(NAMESPACE, seed)
    while True:
        yield str(number)
        number = uuid.uuid5(number, seed)
