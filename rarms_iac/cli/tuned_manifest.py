"""Compounds as `partitions` of the manifest: what its text becomes, comments kept."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rarms_iac.app.files import write_file
from rarms_iac.app.manifests import Manifest
from rarms_iac.manifest.edit.values import remove_value, set_value
from rarms_iac.model.system import System
from rarms_iac.planner.combining.oracle import Coi
from rarms_iac.planner.groups import most_critical_first


@dataclass(frozen=True, slots=True, kw_only=True)
class Written:
    """What was changed."""

    files: tuple[str, ...]
    removed: tuple[str, ...]  # entries of partitions whose members are elsewhere now


def write_partitions(manifest: Manifest, compounds: Sequence[Coi]) -> Written:
    """Each compound as a partition of its name; entries of partitions that are left without members go.

    What comments said of these stands above the entry of the compound that has their members.

    Raises:
        CannotFormat: the text is no manifest.
        OSError: a file cannot be written.
    """
    texts: dict[str, str] = {}
    before: dict[str, str] = {}
    system = manifest.system
    gone = _emptied(system, compounds)
    for compound in compounds:
        file = _file(manifest, compound.name)
        members = [each.name for each in most_critical_first(system.components[name] for name in compound.members)]
        texts[file] = set_value(_text(texts, before, file), ("partitions", compound.name, "components"), members)
    for name, heir in gone.items():
        file = manifest.places.key("partitions", name).file
        texts[file] = remove_value(_text(texts, before, file), ("partitions", name), ("partitions", heir))
    changed = [file for file in sorted(texts) if texts[file] != before[file]]
    for file in changed:
        write_file(file, texts[file].encode("utf-8"))
    return Written(files=tuple(changed), removed=tuple(gone))


def _emptied(system: System, compounds: Sequence[Coi]) -> Mapping[str, str]:
    """Entries of partitions that lose their members to a compound of another name, by name; with that name."""
    home = {member: compound.name for compound in compounds for member in compound.members}
    found = {}
    for name, wish in sorted(system.partitions.items()):
        heirs = sorted({home[member] for member in wish.components if home.get(member, name) != name})
        if heirs:
            found[name] = heirs[0]
    return found


def _file(manifest: Manifest, name: str) -> str:
    """The file that says what is to be changed, or that has the components."""
    system, places = manifest.system, manifest.places
    if name in system.partitions:
        return places.key("partitions", name).file
    return places.key("partitions").file if system.partitions else places.key("components").file


def _text(texts: dict[str, str], before: dict[str, str], file: str) -> str:
    if file not in texts:
        with Path(file).open(encoding="utf-8", newline="") as source:
            before[file] = texts[file] = source.read()
    return texts[file]
