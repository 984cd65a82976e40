"""Definitions of partitions: a file of JSON each, one setting a line, replaced as a whole, in a folder of root.

What a Linux host refuses is here, too: settings that no control group can have, and what it has no room for.
"""

import json
import uuid
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rarms_iac.model.operations import CreatePartition, EraseMark, RenamePartition, RestorePartition, Set, WriteMark
from rarms_iac.model.state import NO_GENERATION, Checkpoints, PartitionSettings, StartAction, State, StopAction
from rarms_iac.providers.cgroups.effects import LinuxEffects, open_folder
from rarms_iac.providers.cgroups.machine import NAMESPACE
from rarms_iac.providers.journaled import report_damage, report_failure
from rarms_iac.providers.machines import KeptMachine, cpu_out_of_range, lack_of_memory, lack_of_processors, notes_of
from rarms_iac.running.kernel_files import MOST_PROCESSORS
from rarms_iac.storage.codec import NotDecodable, decode, encode
from rarms_iac.storage.json_text import parse_json

LONGEST_NAME = 100
_SHORTEST_PERIOD_US, _LONGEST_PERIOD_US = 1_000, 1_000_000
"""The kernel refuses other periods (Documentation/scheduler/sched-bwc.rst)."""


def out_of_range(settings: PartitionSettings) -> str:
    """Describe the first setting that no control group can have; empty where all are possible.

    NOTE: a limit below the reserve is possible. It may have been written by hand, and the undo of its repair does.
    """
    if not 0 < len(settings.name) <= LONGEST_NAME or "/" in settings.name or settings.name in {".", ".."}:
        return f"a partition's name has 1 to {LONGEST_NAME} characters and no slash"
    if not 1 <= settings.processors <= MOST_PROCESSORS:
        return f"a partition has 1 to {MOST_PROCESSORS} processors, not {settings.processors}"
    if problem := cpu_out_of_range(settings):
        return problem
    if settings.limit < 1:
        return "with a limit of 0 % nothing would run: the limit is at least 1 %"
    if not 0 <= settings.memory < 2**63:
        return f"memory is at least 0 B and less than 8 EiB, not {settings.memory} B"
    if not _SHORTEST_PERIOD_US <= (settings.quota_period_us or _SHORTEST_PERIOD_US) <= _LONGEST_PERIOD_US:
        return f"a quota has a period of 1 ms to 1 s, not {settings.quota_period_us} us"
    return "a control group has no dynamic memory" if settings.dynamic_memory else ""


def lack_of_room(wanted: PartitionSettings, machine: str, state: State) -> str:
    """Describe why the partition of this id has no room beside those that run; empty: it has."""
    facts, others = state.facts, others_running(machine, state)
    taken = sum(other.reserve * other.processors for other in others)
    fits = taken + wanted.reserve * wanted.processors <= 100 * facts.logical_processors
    lack = lack_of_processors(wanted, facts.logical_processors, fits=fits) if wanted.reserve else ""
    return lack_of_memory(wanted, others, facts.memory) or lack


def others_running(machine: str, state: State) -> list[PartitionSettings]:
    """Return the settings of the partitions that run, except the one of this id."""
    return [other.settings for other in state.partitions if other.id != machine and other.settings.running]


Format = Literal["rarms-partition/1"]
SettingOperation = Set | RenamePartition | WriteMark | EraseMark
"""Operations that change a definition."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupDefinition(KeptMachine):
    """A partition as its file defines it, running or not."""

    # `running` in its settings is always false: see `is_running`.
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
    return GroupDefinition(id=operation.machine, settings=operation.settings, notes=notes_of(operation))


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


def _ids(seed: str) -> Iterator[str]:
    number = uuid.uuid5(NAMESPACE, seed)
    while True:
        yield str(number)
        number = uuid.uuid5(number, seed)


class DefinitionFiles:
    """The definitions of one slice; what is saved or deleted is done when the effects are committed."""

    def __init__(self, host: str, folder: Path, effects: LinuxEffects) -> None:
        self._host = host
        self._folder = folder
        self._effects = effects

    def all(self) -> list[GroupDefinition]:
        """Read all definitions, sorted by id.

        Raises:
            HostDamaged: one cannot be read, or others than this user may write them.
        """
        self.refuse_writable_folder()
        names = self._effects.files(self._folder)
        return [self._load(self._folder / name) for name in names if name.endswith(".json")]

    def refuse_writable_folder(self) -> None:
        """Refuse a folder that others may write to, or that another user owns, as well as the one above it.

        Root must not finish what another user put there.

        Raises:
            HostDamaged: they may.
        """
        for folder in (self._folder.parent, self._folder):
            if self._effects.has_folder(folder) and not self._effects.is_private(folder):
                raise open_folder(self._host, folder)

    def save(self, definition: GroupDefinition) -> None:
        """Replace the file of a partition.

        Raises:
            HostFailed: it cannot be written.
        """
        with report_failure(self._host, path := self._file(definition)):
            self._effects.replace(path, write_definition(definition))

    def delete(self, definition: GroupDefinition) -> None:
        """Forget a partition.

        Raises:
            HostFailed: its file cannot be removed.
        """
        with report_failure(self._host, path := self._file(definition)):
            self._effects.delete(path)

    def _load(self, path: Path) -> GroupDefinition:
        with report_damage(self._host, path):
            definition = read_definition(self._effects.content(path) or b"")
            if f"{definition.id}.json" != path.name:
                raise NotDecodable("id", "the file has another name")
            if problem := out_of_range(definition.settings):
                raise NotDecodable("settings", problem)
            return definition

    def _file(self, definition: GroupDefinition) -> Path:
        return self._folder / f"{definition.id}.json"
