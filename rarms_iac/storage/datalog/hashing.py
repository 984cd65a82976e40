"""Digests of the files that belong to what is measured: a changed program is another program.

A text is digested as if its lines ended with LF, because git may check it out otherwise.
"""

import hashlib
import shutil
from collections.abc import Iterator, MutableMapping, Sequence
from dataclasses import dataclass, field
from glob import glob
from pathlib import Path

from rarms_iac.model.system import Call, Command, CommandLoad, Run
from rarms_iac.storage.datalog.identity import Subject
from rarms_iac.storage.digest import short
from rarms_iac.storage.reading import open_regular

_LOOKED_AT = 8000  # bytes: git tells a text from other content by them
_CHUNK = 2**20
_DIGITS = 16


@dataclass(slots=True)
class Files:
    """The files below a manifest's folder; each is read once, however many components name it."""

    folder: Path
    _known: MutableMapping[Path, str] = field(default_factory=dict)

    def of(self, subject: Subject) -> dict[str, str]:
        """The digest of every file that belongs to the subject, by path below the manifest's folder.

        Raises:
            OSError: one of them cannot be read.
        """
        return {self._named(path): self._digest(path) for path in sorted(set(self._all(subject)))}

    def interpreters(self, subject: Subject) -> dict[str, str]:
        """The digest of every program outside the folder that the subject's commands begin with, by their word."""
        found = {}
        for word in _first_words(subject):
            where = shutil.which(word)
            if where is not None and not self._is_below(path := Path(where).resolve()):
                found[word] = self._digest(path)
        return found

    def _all(self, subject: Subject) -> Iterator[Path]:
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
            names = glob(pattern, root_dir=base, recursive=True)  # noqa: PTH207 - Path.glob refuses an absolute pattern
            yield from self._that_are(*(base / name for name in names))

    def _of_words(self, base: Path, words: Sequence[str]) -> Iterator[Path]:
        """A word that names nothing is a word; one that no path can be is none."""
        return self._that_are(*(base / word for word in words if word and "\0" not in word))

    def _that_are(self, *paths: Path) -> Iterator[Path]:
        for path in paths:
            try:
                real = path.resolve()
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
    """A digest of the content, the same whatever git did to a text's line ends.

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


def _first_words(subject: Subject) -> Iterator[str]:
    for component in subject.components:
        if component.run is not None and isinstance(component.run.start, Command):
            yield from component.run.start.words[:1]
    if isinstance(subject.load, CommandLoad):
        yield from subject.load.command[:1]
