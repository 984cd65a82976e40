"""One error of the structure, before it is put into words."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rarms_iac.manifest.places import dotted
from rarms_iac.model.diagnostics import Place, Places

Path = tuple[str | int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One error, and what the manifest says at its place."""

    kind: str
    path: Path
    facts: Mapping[str, Any]
    value: Any
    is_key: bool
    places: Places

    @property
    def name(self) -> str:
        """The path as people write it."""
        return dotted(self.path) or "the manifest"

    @property
    def place(self) -> Place:
        """Where it stands: the key for what is wrong with a key, else the value."""
        return self.places.key(*self.path) if self.is_key else self.places.value(*self.path)
