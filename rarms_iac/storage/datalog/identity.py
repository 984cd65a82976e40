"""The identity of a data log: what can change the PI, in named parts, so that a stale log can say what changed.

In it: `run`, `memory`, `processors`, limit and weight, how P1 was held to CR, `task`, `simulation`, the interference,
and the files that belong to them. Not in it: `apt`, `criticality`, the reserve, placement. What has its default is left
out, so that a field that a later rarms adds makes no log stale.
"""

import hashlib
import os
import shutil
from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from enum import Enum
from fractions import Fraction
from glob import glob
from pathlib import Path
from typing import Any, get_type_hints

from rarms_iac.model.loads import CommandLoad, Interference
from rarms_iac.model.measurement import CONFINEMENT, EnvironmentSetup, PlatformFacts
from rarms_iac.model.quantities import Bytes, Milliseconds, Percent, show_bytes
from rarms_iac.model.run import Call, Command, Run
from rarms_iac.model.system import Component, TaskRequest
from rarms_iac.storage.datalog.log import Header, Identity
from rarms_iac.storage.digest import digest, short
from rarms_iac.storage.json_text import canonical
from rarms_iac.storage.reading import open_regular

FILE = "file "
"""What the part of a file begins with; its path follows, below the manifest's folder."""

IN_THE_FILES = frozenset({"run.files"})
"""Said by the files themselves: which pattern named them changes nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogSubject:
    """The subject of a data log: components in one partition against a load, as the manifest has them."""

    platform: str
    components: tuple[Component, ...]  # by name
    setup: EnvironmentSetup
    load: Interference
    tasks: Mapping[str, TaskRequest]  # what the manifest fixes of task classes
    confinement: str = CONFINEMENT  # how P1 is held to CR there


def identity_of(subject: LogSubject, files: Mapping[str, str], interpreters: Mapping[str, str]) -> Identity:
    """The parts of a subject; `files` and `interpreters` are digests by path, as `hashing` finds them.

    Args:
        subject: what is, or would be, measured.
        files: digests by path below the manifest's folder; one that is missing here cannot be verified.
        interpreters: digests of programs outside of it, by the command's word; they only warn.

    Returns:
        Everything that can change a performance index, flat and by name.
    """
    parts = dict(_setup_parts(subject))
    for component in subject.components:
        parts.update(_component_parts(component, subject.tasks))
    parts.update({f"{FILE}{path}": value for path, value in files.items()})
    return Identity(parts=dict(sorted(parts.items())), interpreters=dict(sorted(interpreters.items())))


def header_of(subject: LogSubject, identity: Identity, platform_facts: PlatformFacts) -> Header:
    """What the log of a subject begins with.

    Args:
        subject: what is measured.
        identity: as `identity_of` makes it.
        platform_facts: the host that it is measured on.

    Returns:
        The header, with the digest of the identity.
    """
    return Header(
        platform=subject.platform,
        digest=identity_digest(identity),
        identity=identity,
        platform_facts=platform_facts,
        setup=subject.setup,
    )


def identity_digest(identity: Identity) -> str:
    """The digest of the parts, which a header shows and a reader compares at a glance.

    Args:
        identity: of a log, or of what would be measured now.

    Returns:
        64 hex digits; interpreters are no part of it.
    """
    return digest(dict(identity.parts))


def _setup_parts(subject: LogSubject) -> Iterator[tuple[str, str]]:
    setup = subject.setup
    yield "processors", str(setup.processors)
    yield "memory", show_bytes(setup.memory)
    yield "limit", f"{setup.limit} %"
    yield "weight", str(setup.weight)
    yield "confinement", subject.confinement
    yield from parts_of(f"interference.{setup.interference}", subject.load)


def _component_parts(component: Component, tasks: Mapping[str, TaskRequest]) -> Iterator[tuple[str, str]]:
    if component.run is not None:
        for name, text in parts_of("run", component.run):
            if name not in IN_THE_FILES:
                yield f"{component.name}.{name}", text
    if component.simulation is not None:
        yield from parts_of(f"{component.name}.simulation", component.simulation)
    if component.task is not None:
        yield f"{component.name}.task", component.task
        fixed = tasks.get(component.task)
        if fixed is not None:
            yield from parts_of(f"tasks.{component.task}", fixed, without=frozenset({"name", "replace_shipped"}))


def parts_of(name: str, value: Any, *, without: frozenset[str] = frozenset()) -> Iterator[tuple[str, str]]:
    """What a value of the model says, flat: a dotted name and a text each; a field at its default is left out.

    Args:
        name: stands before the names of the fields.
        value: a dataclass of the model.
        without: names of fields that are left out.

    Yields:
        Names and texts, by the order of the fields.
    """
    if name not in _WITHOUT_KIND and not isinstance(value, Run):
        yield name, type(value).__name__
    hints = get_type_hints(type(value))
    for part in fields(value):
        inner = getattr(value, part.name)
        if part.name in without or inner == _default(part):
            continue
        yield from _inner(f"{name}.{part.name}", inner, hints[part.name])


_WITHOUT_KIND = frozenset({"run.samples", "run.stop"})


def _inner(name: str, value: Any, hint: Any) -> Iterator[tuple[str, str]]:
    if is_dataclass(value):
        yield from parts_of(name, value)
    elif isinstance(value, Mapping):
        for key in sorted(value):
            yield from _inner(f"{name}.{key}", value[key], None)
    else:
        yield name, _text(value, hint)


def _text(value: Any, hint: Any) -> str:
    if isinstance(value, tuple):
        return canonical(list(value))
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, Fraction):
        unit = " ms" if _is(hint, Milliseconds) else " %" if _is(hint, Percent) else ""
        return f"{_decimal(value)}{unit}"
    if _is(hint, Bytes):
        return show_bytes(value)
    return "none" if value is None else str(value)


def _is(hint: Any, unit: Any) -> bool:
    return hint is unit or unit in getattr(hint, "__args__", ())


def _decimal(value: Fraction) -> str:
    """The exact number: as a decimal where it is one, as manifests write it."""
    scaled = value * 10**18
    if scaled.denominator != 1:
        return str(value)
    whole, rest = divmod(abs(scaled.numerator), 10**18)
    sign = "-" if value < 0 else ""
    return f"{sign}{whole}.{rest:018d}".rstrip("0").rstrip(".")


def _default(part: Any) -> Any:
    if part.default is not MISSING:
        return part.default
    return part.default_factory() if part.default_factory is not MISSING else MISSING


_LOOKED_AT = 8000  # bytes: git tells a text from other content by them
_CHUNK = 2**20
_DIGITS = 16


@dataclass(slots=True)
class Files:
    """The files below a manifest's folder; each is read once, however many components name it."""

    folder: Path
    _known: MutableMapping[Path, str] = field(default_factory=dict)

    def of(self, subject: LogSubject) -> dict[str, str]:
        """The digest of every file that belongs to the subject, by path below the manifest's folder.

        Args:
            subject: what is, or would be, measured.

        Returns:
            Digests by path, sorted; a file that the manifest names and that is not here is missing.

        Raises:
            OSError: one of them cannot be read.
        """
        return {self._named(path): self._digest(path) for path in sorted(set(self._all(subject)))}

    def interpreters(self, subject: LogSubject) -> dict[str, str]:
        """The digest of every program outside the folder that the subject's commands begin with, by their word.

        Args:
            subject: what is, or would be, measured.

        Returns:
            Digests by word; a word that is not on the search path is missing.
        """
        found = {}
        for word in _first_words(subject):
            program = shutil.which(word)
            if program is not None and not self._is_below(path := Path(program).resolve()):
                found[word] = self._digest(path)
        return found

    def _all(self, subject: LogSubject) -> Iterator[Path]:
        for component in subject.components:
            if component.run is not None:
                yield from self._of_run(component.run)
        if isinstance(subject.load, CommandLoad):
            yield from self._of_words(self.folder, subject.load.command)

    def _of_run(self, run: Run) -> Iterator[Path]:
        base = self.folder / run.folder
        match run.start:
            case Command(words=words):
                yield from self._of_words(base, words)
            case Call(module=module):
                parts = base.joinpath(*module.split("."))
                yield from self._that_are(parts.with_name(f"{parts.name}.py"), parts / "__init__.py")
        for pattern in run.files:
            if not self._is_below(Path(os.path.normpath(base.resolve() / pattern))):
                continue  # it finds nothing that counts, and could walk all of the disk
            names = glob(pattern, root_dir=base, recursive=True)  # noqa: PTH207 - Path.glob refuses an absolute pattern
            yield from self._that_are(*(base / name for name in names))

    def _of_words(self, base: Path, words: Sequence[str]) -> Iterator[Path]:
        """A word that names nothing is a word; one that no path can be is none."""
        return self._that_are(*(base / word for word in words if word and "\0" not in word))

    def _that_are(self, *paths: Path) -> Iterator[Path]:
        for path in paths:
            try:
                real = Path(os.path.realpath(path))
                if real.is_file() and self._is_below(real):
                    yield real
            except OSError:  # too long to be a path
                continue

    def _is_below(self, path: Path) -> bool:
        return path.is_relative_to(self.folder.resolve())

    def _named(self, path: Path) -> str:
        return path.relative_to(self.folder.resolve()).as_posix()

    def _digest(self, path: Path) -> str:
        if path not in self._known:
            self._known[path] = file_digest(path)
        return self._known[path]


def file_digest(path: Path) -> str:
    """A digest of the content, the same after all that git does to a text's line ends.

    Args:
        path: of a regular file; it is read in pieces.

    Returns:
        16 hex digits.

    Raises:
        OSError: it cannot be read.
    """
    total = hashlib.sha256()
    with open_regular(path) as file:
        chunk = file.read(_CHUNK)
        is_text = b"\0" not in chunk[:_LOOKED_AT]
        held = b""
        while chunk:
            data = held + chunk
            held = b"\r" if is_text and data.endswith(b"\r") else b""
            data = data[: len(data) - len(held)]
            total.update(data.replace(b"\r\n", b"\n") if is_text else data)
            chunk = file.read(_CHUNK)
        total.update(held)
    return short(total.hexdigest(), _DIGITS)


def _first_words(subject: LogSubject) -> Iterator[str]:
    for component in subject.components:
        if component.run is not None and isinstance(component.run.start, Command):
            yield from component.run.start.words[:1]
    if isinstance(subject.load, CommandLoad):
        yield from subject.load.command[:1]
