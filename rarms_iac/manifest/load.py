"""The whole route: files that a user names -> `System`, with every finding about them."""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from pathlib import Path

from rarms_iac.manifest.acceptance import with_acceptances_in_force
from rarms_iac.manifest.overlays import combine, fits
from rarms_iac.manifest.text.events import ParsedText
from rarms_iac.manifest.text.reading import read_text, read_yaml
from rarms_iac.manifest.text.tree import Node, Scalar, first_line
from rarms_iac.model.diagnostics import Diagnostic, Places, has_errors, in_order
from rarms_iac.model.names import is_name, robot_of
from rarms_iac.model.plan import InputText
from rarms_iac.model.system import System
from rarms_iac.storage.json_text import digest_of_texts
from rarms_iac.storage.reading import STANDARD_INPUT

DEFAULT_NAME = "rarms.yaml"
_GIT = ".git"


@dataclass(frozen=True, slots=True, kw_only=True)
class Loaded:
    """A manifest with its overlays; `system` is None where an error prevents one."""

    system: System | None
    places: Places
    diagnostics: tuple[Diagnostic, ...]  # ordered; an error may come with a system
    sources: Mapping[str, Sequence[str]]  # file as messages name it -> its lines
    folder: str  # what the manifest's paths are relative to
    digest: str  # of the texts, in the order in which they were read
    parsed: tuple[ParsedText, ...] = field(repr=False)  # the manifest, then its overlays
    is_missing: bool = False  # one of the files is not there

    @property
    def has_errors(self) -> bool:
        """Whether anything but `validate` must stop here."""
        return has_errors(self.diagnostics)

    def texts_without_secrets(self) -> tuple[InputText, ...]:
        """Return the texts with `x` for each letter and digit of variables' values, and of the way into guests.

        Lines and columns stay, so that findings point to the same places.
        """
        return tuple(map(_without_secrets, self.parsed))


def manifest_path(path: str) -> str:
    """Return the file that `-f PATH` means: in a folder, its `rarms.yaml`."""
    return str(Path(path) / DEFAULT_NAME) if path != STANDARD_INPUT and Path(path).is_dir() else path


def find_manifest_above() -> str | None:
    """Find the manifest of the git repository that the current folder is in, from the folder above it to the root.

    Another user's files must not become what a command acts on: the search ends at a folder, or a file, of another
    owner than the current folder's.

    Returns:
        Its path from here; None where there is none, outside of git, and on Windows, where a folder's owner is unknown.
    """
    here = Path.cwd()
    if os.name == "nt" or (here / _GIT).exists():
        return None
    owner = here.stat().st_uid
    found = None
    for folder in here.parents:
        if folder.stat().st_uid != owner:
            return None
        file = folder / DEFAULT_NAME
        if found is None and file.is_file() and file.stat().st_uid == owner == file.lstat().st_uid:
            found = os.path.relpath(file)
        if (folder / _GIT).exists():
            return found
    return None


def run_checks(system: System, places: Places, today: date) -> Sequence[Diagnostic]:
    """Run each check that needs the manifest only."""
    from rarms_iac.manifest import checks

    return checks.run_checks(system, places, today)


def load_system(
    path: str,
    overlays: Sequence[str] = (),
    *,
    today: date,
    checks: Callable[[System, Places, date], Iterable[Diagnostic]] = run_checks,
) -> Loaded:
    """Read a manifest and its overlays (later wins), and check what they mean.

    Args:
        path: a regular file, or `-` for standard input; `manifest_path` finds the manifest in a folder.
        overlays: files with the keys that differ.
        today: the day in UTC that acceptances expire against.
        checks: judges the `System`; called only where the structure is right.

    Returns:
        The `System`, with the acceptances that are in force alone, or None; with ordered diagnostics. What a user
            wrote never raises.
    """
    texts = [read_yaml(path), *(read_yaml(overlay, overlay=True) for overlay in overlays)]
    return _load(texts, today, checks)


def load_texts(texts: Sequence[InputText], *, today: date) -> Loaded:
    """Read a manifest and its overlays whose texts are here already; as `load_system`."""
    read = [read_text("\n".join(text.lines).encode(), text.file, str(Path(text.file).parent)) for text in texts]
    return _load(read, today, run_checks)


def _load(
    texts: list[ParsedText], today: date, checks: Callable[[System, Places, date], Iterable[Diagnostic]]
) -> Loaded:
    if any(not text.readable for text in texts):
        return _loaded(texts, None, first_line(texts[0].source.file), [])
    value, places, about_overlays = combine(texts)
    if has_errors(about_overlays):
        return _loaded(texts, None, places, about_overlays)
    # Imported here: pydantic takes 150 ms, and what cannot be read does not need it.
    from rarms_iac.manifest.document.messages import findings_of_structure, not_a_robot
    from rarms_iac.manifest.document.validate_document import NotAManifest, validate_document

    try:
        system = validate_document(value, places)
    except NotAManifest as problem:
        return _loaded(texts, None, places, [*about_overlays, *findings_of_structure(problem)])
    robot = robot_of([text.source.file for text in texts[1:]])
    if texts[1:] and not is_name(robot):
        return _loaded(texts, None, places, [not_a_robot(texts[-1].source.file, robot)])
    system = replace(system, application=replace(system.application, robot=robot))
    found = [*about_overlays, *checks(system, places, today)]
    return _loaded(texts, with_acceptances_in_force(system, today), places, found)


def manifest_digest(path: str, overlays: Sequence[str] = ()) -> str | None:
    """Return the digest of a manifest's texts as they are now, as `load` has it; None where one cannot be read.

    Args:
        path: the manifest, or the folder of one.
        overlays: files that are laid over it, in their order.
    """
    texts = [read_yaml(manifest_path(path)), *(read_yaml(overlay, overlay=True) for overlay in overlays)]
    return _digest(texts) if all(text.readable for text in texts) else None


def _digest(texts: list[ParsedText]) -> str:
    return digest_of_texts([text.source.text for text in texts])


def _loaded(
    texts: list[ParsedText],
    system: System | None,
    places: Places,
    findings: list[Diagnostic],
) -> Loaded:
    about_texts = [diagnostic for text in texts for diagnostic in text.diagnostics]
    return Loaded(
        system=None if has_errors(about_texts) else system,
        places=places,
        diagnostics=in_order([*about_texts, *findings]),
        sources={text.source.file: text.source.lines for text in texts},
        folder=texts[0].source.folder or os.curdir,
        digest=_digest(texts),
        parsed=tuple(texts),
        is_missing=any(text.is_missing for text in texts),
    )


_SECRETS = (
    ("components", "*", "run", "environment", "*"),
    ("partitions", "*", "guest", "connect", "ssh"),
    ("partitions", "*", "guest", "credential"),
)


def _without_secrets(parsed: ParsedText) -> InputText:
    whole = parsed.source.text
    for scalar in _secrets(parsed.tree().root, ()):
        head, body = "", whole[scalar.start : scalar.end]
        if scalar.style in {"|", ">"}:  # behind its first line, which says how it is written
            head, newline, rest = body.partition("\n")
            head, body = head + newline, rest
        elif scalar.style:
            head, body = body[0], body[1:]
        tail = scalar.style if scalar.style in {"'", '"'} else ""
        hidden = "".join(_hide(sign) for sign in body.removesuffix(tail))
        whole = whole[: scalar.start] + head + hidden + tail + whole[scalar.end :]
    return InputText(file=parsed.source.file, lines=tuple(whole.split("\n")))


def _hide(sign: str) -> str:
    return sign if sign.isspace() or (sign.isascii() and not sign.isalnum() and sign not in "\\'\"") else "x"


def _secrets(node: Node, path: tuple[str, ...]) -> Iterator[Scalar]:
    if isinstance(node, Scalar):
        if isinstance(node.value, str) and fits(path, _SECRETS):
            yield node
    elif node.is_mapping:
        for entry in node.entries:
            if entry.key is not None:
                yield from _secrets(entry.value, (*path, entry.key.text))
