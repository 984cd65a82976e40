"""The registry of an operating system on a simulated host: the task classes in it, and what operations make of them.

Pure: what is refused was refused before (`refusals.py`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TypeVar, assert_never

from rarms_iac.model import operations
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS, USUAL
from rarms_iac.model.state import RegistryValue, Responsiveness, TaskRecord, ValueKind

T = TypeVar("T")

Values = Mapping[str, RegistryValue]


def _shipped(category: str, priority: int, background_priority: int | None, background_only: str) -> Values:
    def dword(data: int) -> RegistryValue:
        return RegistryValue(kind=ValueKind.DWORD, data=data)

    def text(data: str) -> RegistryValue:
        return RegistryValue(kind=ValueKind.SZ, data=data)

    background = {} if background_priority is None else {"BackgroundPriority": dword(background_priority)}
    return {
        "Affinity": dword(0),
        "Background Only": text(background_only),
        **background,
        "Clock Rate": dword(10_000),
        "GPU Priority": dword(8),
        "Priority": dword(priority),
        "SFIO Priority": text("Normal"),
        "Scheduling Category": text(category),
    }


SHIPPED: Mapping[str, Values] = {
    "Audio": _shipped("Medium", 6, None, "True"),
    "Capture": _shipped("Medium", 5, None, "True"),
    "DisplayPostProcessing": _shipped("High", 8, 8, "True"),
    "Distribution": _shipped("Medium", 4, None, "True"),
    "Games": _shipped("Medium", 2, None, "False"),
    "Playback": _shipped("Medium", 3, 4, "False"),
    "Pro Audio": _shipped("High", 1, None, "False"),
    "Window Manager": _shipped("Medium", 5, None, "True"),
}
"""The task classes that every Windows brings (windows.md 6.5)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Registry:
    """The part of an operating system's registry that concerns rarms. Key names are compared without case."""

    tasks: Mapping[str, Values] = field(default_factory=lambda: SHIPPED)
    records: Mapping[str, TaskRecord] = field(default_factory=dict)  # by the class's name in lower case
    responsiveness: Responsiveness = Responsiveness(value=RegistryValue(kind=ValueKind.DWORD, data=USUAL))

    def entry(self, task: str) -> tuple[Values | None, TaskRecord | None]:
        """Return the values of a task class or SystemResponsiveness (None without a key), and our record of it."""
        if task == SYSTEM_RESPONSIVENESS:
            return self.responsiveness.values or None, self.responsiveness.record
        key = self.key(task)
        return None if key is None else self.tasks[key], self.records.get(task.lower())

    def key(self, task: str) -> str | None:
        """Return the name of a task class's key as it is written there; None: there is none."""
        wanted = task.lower()
        return next((name for name in self.tasks if name.lower() == wanted), None)


FRESH = Registry()
"""As Windows is installed."""


def change_registry(registry: Registry, operation: operations.TaskOperation) -> Registry:
    """Return the registry after the operation. A key that exists keeps the case of its name."""
    values, record = registry.entry(operation.task)
    match operation:
        case operations.WriteTaskClass(values=wanted):
            values = dict(wanted)
        case operations.RemoveTaskClass():
            values = None
        case operations.WriteTaskRecord(record=wanted):
            record = wanted
        case operations.EraseTaskRecord():
            record = None
        case _:
            assert_never(operation)
    if operation.task == SYSTEM_RESPONSIVENESS:
        changed = Responsiveness(value=(values or {}).get(SYSTEM_RESPONSIVENESS), record=record)
        return replace(registry, responsiveness=changed)
    key = registry.key(operation.task) or operation.task
    return replace(
        registry,
        tasks=_with_entry(registry.tasks, key, values),
        records=_with_entry(registry.records, operation.task.lower(), record),
    )


def _with_entry(entries: Mapping[str, T], name: str, entry: T | None) -> Mapping[str, T]:
    others = {known: value for known, value in entries.items() if known != name}
    return others if entry is None else {**others, name: entry}
