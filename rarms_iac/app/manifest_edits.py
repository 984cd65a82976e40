"""What use cases write into the manifest, comments kept: a level of performance, and partitions of compounds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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
class FileEdit:
    """What a file of a manifest holds, and what it is to hold."""

    file: str
    before: str
    after: str


def write_edits(edits: Sequence[FileEdit]) -> None:
    """Write the files that are changed: all, or none where another hand changed one of them.

    Raises:
        UseCaseError: One cannot be written (failed).
        RequestError: One was changed since it was read; that change stays.
    """
    changed = [edit for edit in edits if edit.after != edit.before]
    for edit in changed:
        if text_of(edit.file) != edit.before:
            raise RequestError(f"{edit.file} was changed meanwhile: nothing was written. Do it again.")
    for edit in changed:
        write_file(edit.file, edit.after.encode("utf-8"))


def edit_levels(manifest: Manifest, levels: Sequence[tuple[Component, PerformanceIndex, str]]) -> tuple[FileEdit, ...]:
    """Make levels of performance the APTs of components, each in the file that says it, or is to say it.

    Args:
        manifest: Its files are read; nothing is written yet.
        levels: Of a component, as the manifest has it, the index, and the level as it was given: `100 ms`.

    Returns:
        The edits, one a file, sorted; comments stay.

    Raises:
        CannotFormat: A text is no manifest.
    """
    before: dict[str, str] = {}
    texts: dict[str, str] = {}
    for component, index, level in levels:
        exists = index.name in component.apt
        path = ("components", component.name, "apt", index.name, index.direction)
        file = manifest.places.value(*path).file if exists else manifest.places.key(*path[:3]).file
        text = _text(texts, before, file)
        texts[file] = set_value(text, path, level) if exists else set_value(text, path[:4], {index.direction: level})
    return tuple(FileEdit(file=file, before=before[file], after=text) for file, text in sorted(texts.items()))


def edit_partitions(manifest: Manifest, compounds: Sequence[Coi]) -> tuple[FileEdit, ...]:
    """Make each compound a partition of its name; entries of partitions that are left without members go.

    What comments said of these stands above the entry of the compound that has their members.

    Args:
        manifest: Its files are read; nothing is written yet.

    Returns:
        What each file is to hold, by its name.

    Raises:
        CannotFormat: The text is no manifest.
    """
    texts: dict[str, str] = {}
    before: dict[str, str] = {}
    system = manifest.system
    for compound in compounds:
        file = _file(manifest, compound.name)
        members = [each.name for each in most_critical_first(system.components[name] for name in compound.members)]
        texts[file] = set_value(_text(texts, before, file), ("partitions", compound.name, "components"), members)
    for name, heir in emptied_partitions(system, compounds).items():
        file = manifest.places.key("partitions", name).file
        texts[file] = remove_value(_text(texts, before, file), ("partitions", name), ("partitions", heir))
    return tuple(FileEdit(file=file, before=before[file], after=text) for file, text in sorted(texts.items()))


def emptied_partitions(system: System, compounds: Sequence[Coi]) -> Mapping[str, str]:
    """List the entries of partitions that lose their members to a compound of another name.

    Args:
        system: Before that.

    Returns:
        The name of that compound, by the name of the entry, sorted.
    """
    home = {member: compound.name for compound in compounds for member in compound.members}
    heirs_of = {}
    for name, request in sorted(system.partitions.items()):
        heirs = sorted({home[member] for member in request.components if home.get(member, name) != name})
        if heirs:
            heirs_of[name] = heirs[0]
    return heirs_of


def _file(manifest: Manifest, name: str) -> str:
    """Return the file that says what is to be changed, or that has the components."""
    system, places = manifest.system, manifest.places
    if name in system.partitions:
        return places.key("partitions", name).file
    return places.key("partitions").file if system.partitions else places.key("components").file


def _text(texts: dict[str, str], before: dict[str, str], file: str) -> str:
    if file not in texts:
        before[file] = texts[file] = text_of(file)
    return texts[file]


def text_of(file: str) -> str:
    """Return the text of a manifest's file with its own line ends."""
    return read_file(file, MAX_BYTES).decode("utf-8")
