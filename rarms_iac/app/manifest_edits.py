"""What use cases write into the manifest, comments kept: a level of performance, and partitions of compounds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rarms_iac.app.files import write_file
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.manifest.edit.values import remove_value, set_value
from rarms_iac.manifest.text.reading import MAX_BYTES
from rarms_iac.model.indexes import PerformanceIndex
from rarms_iac.model.system import Component, System
from rarms_iac.planner.combining.oracle import Coi
from rarms_iac.planner.groups import most_critical_first
from rarms_iac.storage.reading import read_file


@dataclass(frozen=True, slots=True, kw_only=True)
class PartitionEdits:
    """What is to be changed in the files of a manifest."""

    texts: Mapping[str, str] = field(default_factory=dict)  # the new text of each file that changes, by its path
    removed: tuple[str, ...] = ()  # entries of partitions whose members are elsewhere now

    def write(self) -> None:
        """Write the files.

        Raises:
            UseCaseError: One cannot be written (failed).
        """
        for file, text in self.texts.items():
            write_file(file, text.encode("utf-8"))


@dataclass(frozen=True, slots=True, kw_only=True)
class FileEdit:
    """What a file of a manifest holds, and what it is to hold."""

    file: str
    before: str
    after: str

    def write(self) -> None:
        """Write the file where that changes something.

        Raises:
            UseCaseError: It cannot be written (failed).
            RequestError: It was changed since it was read; that change stays.
        """
        if self.after != self.before:
            if _read(self.file) != self.before:
                raise RequestError(f"{self.file} was changed meanwhile: nothing was written. Do it again.")
            write_file(self.file, self.after.encode("utf-8"))


def edit_level(manifest: Manifest, component: Component, index: PerformanceIndex, level: str) -> FileEdit:
    """Make a level of performance the APT of a component, in the file that says it, or is to say it.

    Args:
        manifest: Its file is read; nothing is written yet.
        component: As the manifest has it.
        index: Of which the level is.
        level: As it was given: `100 ms`.

    Returns:
        The edit; comments stay.

    Raises:
        CannotFormat: Its text is no manifest.
    """
    exists = index.name in component.apt
    path = ("components", component.name, "apt", index.name, index.direction)
    file = manifest.places.value(*path).file if exists else manifest.places.key(*path[:3]).file
    before = _read(file)
    after = set_value(before, path, level) if exists else set_value(before, path[:4], {index.direction: level})
    return FileEdit(file=file, before=before, after=after)


def edit_partitions(manifest: Manifest, compounds: Sequence[Coi]) -> PartitionEdits:
    """Make each compound a partition of its name; entries of partitions that are left without members go.

    What comments said of these stands above the entry of the compound that has their members.

    Args:
        manifest: Its files are read; nothing is written yet.
        compounds: Those that are new.

    Returns:
        The files that were changed, sorted, and the entries that went.

    Raises:
        CannotFormat: The text is no manifest.
    """
    texts: dict[str, str] = {}
    before: dict[str, str] = {}
    system = manifest.system
    removed = _emptied_partitions(system, compounds)
    for compound in compounds:
        file = _file(manifest, compound.name)
        members = [each.name for each in most_critical_first(system.components[name] for name in compound.members)]
        texts[file] = set_value(_text(texts, before, file), ("partitions", compound.name, "components"), members)
    for name, heir in removed.items():
        file = manifest.places.key("partitions", name).file
        texts[file] = remove_value(_text(texts, before, file), ("partitions", name), ("partitions", heir))
    changed = {file: text for file, text in sorted(texts.items()) if text != before[file]}
    return PartitionEdits(texts=changed, removed=tuple(removed))


def _emptied_partitions(system: System, compounds: Sequence[Coi]) -> Mapping[str, str]:
    """Entries of partitions that lose their members to a compound of another name, by name; with that name."""
    home = {member: compound.name for compound in compounds for member in compound.members}
    heirs_of = {}
    for name, request in sorted(system.partitions.items()):
        heirs = sorted({home[member] for member in request.components if home.get(member, name) != name})
        if heirs:
            heirs_of[name] = heirs[0]
    return heirs_of


def _file(manifest: Manifest, name: str) -> str:
    """The file that says what is to be changed, or that has the components."""
    system, places = manifest.system, manifest.places
    if name in system.partitions:
        return places.key("partitions", name).file
    return places.key("partitions").file if system.partitions else places.key("components").file


def _text(texts: dict[str, str], before: dict[str, str], file: str) -> str:
    if file not in texts:
        before[file] = texts[file] = _read(file)
    return texts[file]


def _read(file: str) -> str:
    """The text with its own line ends; that it is a manifest was found when it was loaded."""
    return read_file(file, MAX_BYTES).decode("utf-8")
