"""A text that was read, with what is needed to point into it."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import overload

_LINE_END = re.compile("\r\n|\n|\r")
_SPLIT_BELOW = 2**20  # characters; a larger text is searched line by line, so that 4 million empty lines cost nothing


class Lines(Sequence[str]):
    """The lines of a text without their ends, split only when one is shown."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._split: list[str] | None = None

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> list[str]: ...
    def __getitem__(self, index: int | slice) -> str | list[str]:
        """The line at this index, counted from 0; IndexError past the end."""
        if isinstance(index, slice):
            return [self[at] for at in range(*index.indices(len(self)))]
        if self._split is None and len(self._data) < _SPLIT_BELOW:
            self._split = list(self)
        if self._split is not None:
            return self._split[index]
        for number, line in enumerate(self):
            if number == index:
                return line
        raise IndexError(index)

    def __len__(self) -> int:
        """How many lines there are."""
        return sum(1 for _ in self) if self._split is None else len(self._split)

    def __iter__(self) -> Iterator[str]:
        """One line after the other."""
        text = self._data.decode("utf-8", errors="replace")
        start = 0
        for end in _LINE_END.finditer(text):
            yield text[start : end.start()]
            start = end.end()
        yield text[start:]


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """A file as it was read: UTF-8 without a byte order mark."""

    file: str  # as messages name it: with slashes, `<stdin>` for standard input
    folder: str  # what its paths are relative to
    data: bytes
    lines: Lines = field(compare=False)


def source(file: str, folder: str, data: bytes) -> Source:
    """A text under the name that messages use."""
    return Source(file=file, folder=folder, data=data, lines=Lines(data))
