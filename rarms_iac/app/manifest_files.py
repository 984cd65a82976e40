"""Writing manifests: a first one to start from, any in its canonical form, and edits that keep comments."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rarms_iac.app.files import make_folder, write_file
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError, conflict_finding
from rarms_iac.manifest.edit.formatting import CannotFormat, format_tree
from rarms_iac.manifest.edit.values import remove_value, set_value
from rarms_iac.manifest.load import DEFAULT_NAME, manifest_path
from rarms_iac.manifest.text.reading import MAX_BYTES, read_yaml
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.indexes import PerformanceIndex
from rarms_iac.model.names import WINDOWS_DEVICES, is_name, nearest_name
from rarms_iac.model.output import Internal, output
from rarms_iac.model.system import Component, System
from rarms_iac.planner.combining.oracle import Coi
from rarms_iac.planner.groups import most_critical_first
from rarms_iac.storage.reading import MEBIBYTE, read_file
from rarms_iac.storage.shipped import shipped_text
from rarms_iac.texts.messages import quoted

_WITHOUT_A_NAME = "my-application"


def initial_manifest(name: str) -> str:
    """Make a commented manifest, which validates and plans on a simulated host as it is.

    Returns:
        Its text.
    """
    template = shipped_text("templates/init/rarms.yaml")
    return set_value(template, ("application", "name"), name)


def tutorial_manifest() -> str:
    """Return the manifest of docs/tutorial.md: three components that need more than there is until two share."""
    return shipped_text("templates/init/tutorial.yaml")


def name_from(folder: str) -> str:
    """Make a name that an application may have: `My Robot (2)` -> `my-robot-2`.

    Returns:
        At most 63 small letters, digits and hyphens.
    """
    name = nearest_name(folder)
    return _WITHOUT_A_NAME if name == "" or name in WINDOWS_DEVICES else name


_BLANK_BYTES = 4096
"""A larger file is not looked into."""
_ATTRIBUTES_BYTES = MEBIBYTE


@dataclass(frozen=True, slots=True, kw_only=True)
class FormattedManifest:
    """A manifest's or an overlay's text, before and in its canonical form."""

    path: Internal[str]
    file: str  # as messages name it
    before: Internal[bytes]
    after: Internal[str]

    @output
    def changed(self) -> bool:
        """Whether it was not in the canonical form; a byte order mark or CRLF counts too."""
        return self.before != self.after.encode()


@dataclass(frozen=True, slots=True, kw_only=True)
class FormattedManifests:
    """Files that were looked at for their form."""

    kind: Literal["fmt"] = "fmt"
    files: tuple[FormattedManifest, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenFiles:
    """The manifest that was written first, its schema, and the attributes that git merges data logs by."""

    kind: Literal["written"] = "written"
    files: tuple[str, ...]  # the manifest first


SCHEMA_NAME = "rarms.schema.json"
"""The file next to a manifest that its first line names: what an editor checks it against, also without a network."""


GIT_ATTRIBUTES = ".gitattributes"
MERGE_LOGS = "/measurements/**/*.jsonl merge=union"
"""The line by which git keeps the records of both branches."""


def write_first_manifest(folder: str, name: str | None = None, *, tutorial: bool = False) -> WrittenFiles:
    """Write a commented manifest that validates and plans as it is, with its schema and .gitattributes.

    A blank file gives way to the manifest, and an earlier schema to this version's. To .gitattributes a line is added,
    unless it has it.

    Args:
        folder: where; it is made where it does not exist.
        name: the application's; None: as the folder is called.
        tutorial: whether it is the manifest of the tutorial, which has a name of its own.

    Returns:
        The paths of the manifest, its schema and .gitattributes.

    Raises:
        RequestError: the name cannot be an application's.
        UseCaseError: there is a manifest already, or it cannot be written (failed).
    """
    if name is not None and not is_name(name):
        raise RequestError(
            f"{quoted(name)} is not a valid application name. Use small letters, digits and hyphens, at most 63."
        )
    path = Path(folder) / DEFAULT_NAME
    if (path.exists() or path.is_symlink()) and not _is_blank(path):
        raise UseCaseError(Outcome.FAILED, [conflict_finding(path.as_posix())])
    text = tutorial_manifest() if tutorial else initial_manifest(name or name_from(path.resolve().parent.name))
    make_folder(path.parent.as_posix())
    schema, attributes = path.with_name(SCHEMA_NAME), path.with_name(GIT_ATTRIBUTES)
    # The manifest last: after a kill in between, the same command begins again.
    write_file(str(schema), shipped_text("schemas/manifest.json").encode())
    _add_line(attributes, MERGE_LOGS)
    write_file(str(path), f"# yaml-language-server: $schema={SCHEMA_NAME}\n{text}".encode())
    return WrittenFiles(files=(path.as_posix(), schema.as_posix(), attributes.as_posix()))


def _add_line(path: Path, line: str) -> None:
    before = read_file(path, _ATTRIBUTES_BYTES) if path.exists() else b""
    if line.encode() not in before.splitlines():
        end = b"\n" if before and not before.endswith(b"\n") else b""
        write_file(str(path), before + end + line.encode() + b"\n")


def _is_blank(path: Path) -> bool:
    """Return whether the path is a regular file with only blanks, so that overwriting it loses nothing."""
    if path.is_symlink() or not path.is_file() or path.stat().st_size > _BLANK_BYTES:
        return False
    return not read_file(path, _BLANK_BYTES).strip()


def format_manifests(paths: Sequence[str]) -> FormattedManifests:
    """Return the canonical form of manifests and overlays, comments kept. Writes nothing.

    Args:
        paths: files, folders of a manifest, or `-` for standard input.

    Returns:
        A value for each path, in order, whether its text differs or not.

    Raises:
        UseCaseError: one of them is not there (missing) or no manifest (negative); with all problems of all files.
    """
    formatted: list[FormattedManifest] = []
    problems: list[Diagnostic] = []
    sources = {}
    is_missing = False
    for path in map(manifest_path, paths):
        tree = read_yaml(path)
        is_missing |= tree.is_missing
        sources[tree.source.file] = tree.source.lines
        try:
            after = format_tree(tree)
        except CannotFormat as problem:
            problems += problem.diagnostics
            continue
        formatted.append(FormattedManifest(path=path, file=tree.source.file, before=tree.source.stored, after=after))
    if problems:
        raise UseCaseError(Outcome.MISSING if is_missing else Outcome.NEGATIVE, problems, sources)
    return FormattedManifests(files=tuple(formatted))


@dataclass(frozen=True, slots=True, kw_only=True)
class FileEdit:
    """The old and the new text of a manifest's file."""

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
            raise RequestError(f"{edit.file} was changed in the meantime, so nothing was written. Try again.")
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
        CannotFormat: A text is not a manifest.
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
        CannotFormat: The text is not a manifest.
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
