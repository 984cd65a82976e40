"""Definitions of partitions, and the values of their control groups that they stand for, and back.

A definition is a file of JSON, one setting a line, replaced as a whole, in a folder of root. What runs is what the
kernel shows: a partition runs if its definition has the id of the machine's latest start (`boot`) and its control group
exists; otherwise it is off. What a Linux host refuses or finds odd is here, too.
"""

import json
import math
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from rarms_iac.model.capacity import shared_processors
from rarms_iac.model.commands import APPLY, START_AT_BOOT, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import Host
from rarms_iac.model.operations import CreatePartition, RestorePartition
from rarms_iac.model.state import HostFacts, Partition, PartitionSettings, RunState, State
from rarms_iac.providers.cgroups.effects import LinuxEffects, open_folder
from rarms_iac.providers.cgroups.groups import USUAL_PERIOD_US, GroupValues
from rarms_iac.providers.cgroups.machine import NAMESPACE
from rarms_iac.providers.journaled import report_damage, report_failure
from rarms_iac.providers.machines import (
    KeptMachine,
    cpu_out_of_range,
    lack_of_memory,
    lack_of_processors,
    new_settings,
    notes_of,
    with_marks,
)
from rarms_iac.running.kernel_files import MOST_PROCESSORS
from rarms_iac.running.thread_priorities import rules_of
from rarms_iac.storage.codec import NotDecodable, decode, encode
from rarms_iac.storage.json_text import parse_json
from rarms_iac.texts.findings import Finding
from rarms_iac.texts.messages import counted

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
        return "a limit is at least 1 %, because with 0 % nothing would run"
    if not 0 <= settings.memory < 2**63:
        return f"memory is at least 0 B and less than 8 EiB, not {settings.memory} B"
    if not _SHORTEST_PERIOD_US <= (settings.quota_period_us or _SHORTEST_PERIOD_US) <= _LONGEST_PERIOD_US:
        return f"a quota has a period of 1 ms to 1 s, not {settings.quota_period_us} us"
    try:
        rules_of(settings.threads)
    except ValueError:
        return f"priorities of threads are written as `controller* at 21`, not `{settings.threads}`"
    return "control groups do not have dynamic memory" if settings.dynamic_memory else ""


def lack_of_room(wanted: PartitionSettings, machine: str, state: State) -> str:
    """Describe why the partition of this id has no room with those that run; empty: it has."""
    facts, others = state.facts, others_running(machine, state)
    taken = sum(other.reserve * other.processors for other in others)
    fits = taken + wanted.reserve * wanted.processors <= 100 * facts.logical_processors
    lack = lack_of_processors(wanted, facts.logical_processors, fits=fits) if wanted.reserve else ""
    return lack_of_memory(wanted, others, facts.memory) or lack


def others_running(machine: str, state: State) -> list[PartitionSettings]:
    """Return the settings of the partitions that run, except the one of this id."""
    return [other.settings for other in state.partitions if other.id != machine and other.settings.running]


Format = Literal["rarms-partition/1"]


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

    Raises:
        NotDecodable: the content is not as `write_definition` writes it.
    """
    return decode(GroupDefinition, parse_json(data.decode("utf-8", "replace")))


def new_definition(operation: CreatePartition, name: str, host: str, taken: Iterable[str]) -> GroupDefinition:
    """Define a new partition, off and without reserve.

    Args:
        name: of the partition; with the host's id it decides the new id.
        taken: ids of the host's partitions, which the new one does not get.
    """
    known = frozenset(taken)
    number = next(number for number in _ids(f"{host}/{name}") if number not in known)
    return GroupDefinition(id=number, settings=new_settings(name, operation.memory))


def restored_definition(operation: RestorePartition) -> GroupDefinition:
    """Define a partition again that was removed: off, under its id."""
    return GroupDefinition(id=operation.machine, settings=operation.settings, notes=notes_of(operation))


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


@dataclass(frozen=True, slots=True, kw_only=True)
class RunningGroup:
    """A control group in the kernel: its values, and those that the kernel would show if it were as defined."""

    actual: GroupValues
    wanted: GroupValues | None = None  # None: no definition names this group


def foreign_definition(name: str, group: RunningGroup, facts: HostFacts, boot: str) -> GroupDefinition:
    """Return a group that no definition names as a partition, under an id that is always the same."""
    number = str(uuid.uuid5(NAMESPACE, f"{facts.id}/group/{name}"))
    settings = observed_settings(new_settings(name, 0), replace(group, wanted=None), facts.logical_processors)
    return GroupDefinition(id=number, settings=settings, group=name, boot=boot)


def slice_limit(host: Host, processors: int) -> int | None:
    """Return the limit of all partitions together: all but `keep_for_host`, in whole per cent of one processor.

    Returns:
        At least 1; None: nothing is kept, so nothing limits them.
    """
    shared = shared_processors(host, processors)
    return None if shared == processors else int(100 * shared)


def values_of(settings: PartitionSettings, processors: int, limit: int | None = None) -> GroupValues:
    """Return the values of a partition's control group.

    Args:
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
    """
    return with_marks(
        (_partition(definition, running, boot, processors), definition.notes) for definition in definitions
    )


def is_running(definition: GroupDefinition, groups: Iterable[str], boot: str) -> bool:
    """Return whether the partition's control group exists and was made completely since the machine's start."""
    return bool(definition.boot) and definition.boot == boot and definition.group in groups


def _partition(
    definition: GroupDefinition, running: Mapping[str, RunningGroup], boot: str, processors: int
) -> Partition:
    settings = definition.settings
    if not is_running(definition, running, boot):
        return Partition(settings=settings, id=definition.id)
    # NOTE: while values are being written, the old settings count; the next run that holds the host restores them.
    if not definition.changing:
        settings = observed_settings(settings, running[definition.group], processors)
    return Partition(settings=replace(settings, running=True), id=definition.id, state=RunState.RUNNING)


def observed_settings(settings: PartitionSettings, group: RunningGroup, processors: int) -> PartitionSettings:
    """Return the settings that the kernel's values show; where a value is as defined, so is its setting.

    Args:
        settings: as defined; of an unmanaged group anything.
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
    """Return the number of processors that a group can use at the same time, by its cpuset and its quota."""
    actual, wanted = group.actual, group.wanted
    of_set = processors if actual.processors is None else len(actual.processors)
    is_limited = actual.quota_percent is not None
    if wanted is not None and is_limited == (wanted.quota_percent is not None):
        return min(settings.processors, of_set)
    if wanted is None and actual.quota_percent is not None:
        return min(of_set, max(1, math.ceil(actual.quota_percent / 100)))
    return of_set


def _period(settings: PartitionSettings, group: RunningGroup) -> int:
    actual, wanted = group.actual, group.wanted
    if actual.quota_percent is None:
        return 0
    as_wanted = wanted is not None and wanted.quota_percent is not None and wanted.period_us == actual.period_us
    return settings.quota_period_us if as_wanted else actual.period_us


def _percent(actual: float, defined: int) -> int:
    """Return whole per cent, rounded away from the defined ones, so that rounding hides no change."""
    whole = math.floor(actual) if actual < defined else math.ceil(actual)
    return min(max(whole, 0), 100)


ORPHANS = Finding.note("RARMS168", "A partition has processes that rarms did not start")
OFF_WITHOUT_STOP = Finding.warning("RARMS316", "Partitions are off although rarms did not stop them")
NOTHING_WITHHELD = Finding.note("RARMS317", "A Linux host keeps no processor time for itself")


def orphan_findings(partition: str, processes: Sequence[tuple[int, str]]) -> Iterator[Diagnostic]:
    """Find processes, by id and name, that run in a partition and end with no component."""
    if processes:
        names = ", ".join(f"{process} ({name})" for process, name in processes)
        yield ORPHANS.at(
            None,
            "Processes run in {partition} that rarms did not start: {_names}.",
            "They use the partition's processor time. If a component left them, end them with `kill`.",
            address=f"partition/{partition}",
            partition=partition,
            processes=tuple(str(process) for process, _ in processes),
            _names=names,
        )


def off_without_stop(host: Host, partitions: Sequence[str]) -> Iterator[Diagnostic]:
    """Find partitions that are off, and that no run stopped."""
    if partitions:
        line = ' starts them at each boot: see docs/linux.md, "After the machine starts".'
        yield OFF_WITHOUT_STOP.of_host(
            host.name,
            "{_counted} of {host} ran until the machine stopped or the control group was removed: {partitions:all}.",
            prose(APPLY, " starts them. ", START_AT_BOOT, line),
            partitions=tuple(partitions),
            _counted=counted(len(partitions), "partition"),
        )


def nothing_withheld(host: Host, processors: int) -> Iterator[Diagnostic]:
    """Find that partitions may use all of the machine's logical processors (`processors`)."""
    if slice_limit(host, processors) is None:
        yield NOTHING_WITHHELD.of_host(
            host.name,
            (
                "{host} does not keep processor time for processes outside its partitions. When the partitions "
                "use all processor time, ssh, rarms and kernel threads get about 1 % of a processor each."
            ),
            "Set `keep_for_host: { processor: 5 % }`. Partitions never get this share.",
        )
