"""The manifest line that asks for a partition or a task class, also where neither has an entry of its own."""

from dataclasses import dataclass

from rarms_iac.model.diagnostics import Place, Places
from rarms_iac.model.system import System


@dataclass(frozen=True, slots=True, kw_only=True)
class WhereAsked:
    """`Places` that lead from a partition without an entry to its component, and from a task class to who names it."""

    system: System
    places: Places

    def value(self, *path: str | int) -> Place:
        """The place of the value, or of what asks for it."""
        return self.places.value(*self._asking(path))

    def key(self, *path: str | int) -> Place:
        """The place of the key, or of what asks for it."""
        return self.places.key(*self._asking(path))

    def _asking(self, path: tuple[str | int, ...]) -> tuple[str | int, ...]:
        match path:
            case ("partitions", str(name), *_) if name not in self.system.partitions and name in self.system.components:
                return "components", name
            case ("tasks", str(name), *_) if name not in self.system.tasks:
                return self._naming(name) or path
            case _:
                return path

    def _naming(self, task: str) -> tuple[str | int, ...] | None:
        """The most critical component that names the class, whatever its case."""
        naming = [one for one in self.system.components.values() if one.task and one.task.lower() == task.lower()]
        first = min(naming, key=lambda one: (-one.criticality, one.name), default=None)
        return ("components", first.name, "task") if first else None
