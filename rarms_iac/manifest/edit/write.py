"""Tree -> canonical text: the order of keys, lines and comments, and which quotes a scalar needs."""

import re
import sys
from dataclasses import dataclass

from rarms_iac.manifest.document.schema import ValueShape, manifest_shape
from rarms_iac.manifest.text.tree import Collection, Entry, Node, Scalar, Tree

WIDTH = 100
"""Characters that a flow collection may fill, its key included; text is never broken for it."""

_ALIGNED = 64  # trailing comments of neighbouring lines line up while the lines are no longer than this


_LONGEST_KEY = 1000  # YAML allows 1024 characters up to the colon

# What some YAML, 1.1 or 1.2, would not read as text; quotes that a user put around these stay.
_NOT_TEXT = re.compile(
    r"(?i:~|null|true|false|yes|no|on|off|y|n|<<|=)|[-+]?\.(?i:inf|nan)|[-+.]?[0-9][-+0-9a-fA-FxoXO_.:eETZ ]*|"
)
# Text that needs no quotes to be read as what it is, by people too: a pattern or a formula keeps its own.
_PLAIN = re.compile(r"(?:[\w./]|--?\w)(?:[\w ./+=@~%,-]|:(?=\w))*")
_BREAKS_FLOW = re.compile(r"[,\[\]{}:?]")
_QUANTITY = re.compile(r"([0-9]+(?:\.[0-9]+)?) ?([A-Za-z%/]+)")
_SHORT_ESCAPES = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\0": "\\0"}


class KeyTooLong(ValueError):
    """A key that only the form `? key` can hold, which no manifest needs."""

    def __init__(self, key: Scalar) -> None:
        super().__init__(f"a key has at most {_LONGEST_KEY} characters")
        self.key = key


@dataclass(frozen=True, slots=True)
class WrittenLine:
    """One line, and the comment that trails it."""

    text: str
    comment: str = ""


def write_tree(tree: Tree) -> str:
    """Return the canonical text of a document that is one mapping; comments move within the tree."""
    root = tree.root
    assert isinstance(root, Collection), "the text was checked: it holds one mapping"
    if not root.entries:
        return _text([WrittenLine("{}"), *_comment_lines(root.tail, 0)])
    shape = manifest_shape()
    _keep_header(root, shape)
    return _text(_collection(root, shape, 0, sections=True))


def write_entry(entry: Entry, shape: ValueShape, indent: int) -> list[str]:
    """Return the lines of one new entry of a block whose shape is `shape`."""
    part = _entry(entry, shape, indent, sections=False)
    return _text([*_comment_lines(part.above, indent), *part.lines]).splitlines()


def write_flow(node: Node, shape: ValueShape) -> str:
    """Return the value on one line, however long, as it stands inside a flow collection."""
    written = _inline(_all_flow(node), shape, sys.maxsize)
    assert written is not None, "a new value has no comments and is all flow"
    return written


def _all_flow(node: Node) -> Node:
    if isinstance(node, Scalar):
        return node
    entries = [Entry(entry.key, _all_flow(entry.value)) for entry in node.entries]
    return Collection(node.is_mapping, True, entries)


def write_key(key: str, *, flow: bool) -> str:
    """Return a key with its colon."""
    return _key(Scalar(key), flow=flow)


@dataclass(frozen=True, slots=True)
class _WrittenEntry:
    """An entry as it will be written: the comments above it ("" is a blank line), and its lines."""

    above: list[str]
    lines: list[WrittenLine]


def _collection(node: Collection, shape: ValueShape, indent: int, *, sections: bool = False) -> list[WrittenLine]:
    """Return the lines of a collection in block form; between `sections` that are blocks stands a blank line."""
    return _joined(_parts(node, shape, indent, sections=sections), node.tail, indent, sections=sections)


def _parts(node: Collection, shape: ValueShape, indent: int, *, sections: bool = False) -> list[_WrittenEntry]:
    return [_entry(entry, shape, indent, sections=sections) for entry in _ordered(node, shape)]


def _entry(entry: Entry, shape: ValueShape, indent: int, *, sections: bool) -> _WrittenEntry:
    """Return a key with its value, or an item with its dash."""
    inner = _inner(entry, shape)
    head = " " * indent + (_key(entry.key) if entry.key else "-")
    value = entry.value
    if isinstance(value, Scalar):
        return _WrittenEntry(entry.before, _scalar(entry, value, head, inner, indent))
    short = _inline(value, inner, WIDTH - len(head) - 1)
    if short is not None:
        return _WrittenEntry(entry.before, [WrittenLine(f"{head} {short}", entry.trailing)])
    if entry.key:
        named = sections and value.is_mapping and inner.has_names
        below = _collection(value, inner, indent + 2, sections=named)
        return _WrittenEntry(entry.before, [WrittenLine(head, entry.trailing), *below])
    return _item(entry, value, inner, indent)


def _scalar(entry: Entry, value: Scalar, head: str, shape: ValueShape, indent: int) -> list[WrittenLine]:
    """Return a scalar behind its key or dash, on one line or as a block."""
    block = _block_lines(value, WIDTH - indent - 2)
    if block is None:
        text = _one_line(value, quantity=shape.is_quantity)
        return [WrittenLine(f"{head} {text}" if text else head, entry.trailing)]
    below = [WrittenLine(" " * (indent + 2) + line if line else "") for line in block[1:]]
    return [WrittenLine(f"{head} {block[0]}", entry.trailing), *below]


def _item(entry: Entry, value: Collection, shape: ValueShape, indent: int) -> _WrittenEntry:
    """Return an item that is a block.

    Its first line begins behind the dash, and what was above that line moves up.
    """
    first, *rest = _parts(value, shape, indent + 2)
    moved = [comment for comment in (entry.trailing, *first.above) if comment]
    lines = _joined([_WrittenEntry([], first.lines), *rest], value.tail, indent + 2)
    begin = WrittenLine(" " * indent + "- " + lines[0].text[indent + 2 :], lines[0].comment)
    return _WrittenEntry([*entry.before, *moved], [begin, *lines[1:]])


def _joined(parts: list[_WrittenEntry], tail: list[str], indent: int, *, sections: bool = False) -> list[WrittenLine]:
    lines: list[WrittenLine] = []
    after_block = False
    for number, part in enumerate(parts):
        is_block = len(part.lines) > 1
        above = part.above
        if number == 0:
            above = _without_leading_blank(above)
        elif sections and (is_block or after_block) and above[:1] != [""]:
            above = ["", *above]
        lines += [*_comment_lines(above, indent), *part.lines]
        after_block = is_block
    return [*lines, *_comment_lines(tail, indent)]


def _inner(entry: Entry, shape: ValueShape) -> ValueShape:
    return shape.of(entry.key.text if entry.key else 0)


def _ordered(node: Collection, shape: ValueShape) -> list[Entry]:
    """Return the entries in canonical order; unknown keys keep theirs, after the known ones."""
    if not node.is_mapping or shape.has_names:
        return node.entries
    return sorted(node.entries, key=lambda entry: shape.rank(entry.key.text if entry.key else ""))


def _keep_header(root: Collection, shape: ValueShape) -> None:
    """Keep the file's own comment, ended by a blank line, at its top when another key comes first."""
    ordered = _ordered(root, shape)
    if not ordered or ordered[0] is root.entries[0]:
        return
    was_first, is_first = root.entries[0], ordered[0]
    blanks = [number for number, line in enumerate(was_first.before) if line == ""]
    if blanks and any(was_first.before[: blanks[-1]]):
        header, was_first.before = was_first.before[: blanks[-1]], was_first.before[blanks[-1] :]
        is_first.before = [*header, "", *_without_leading_blank(is_first.before)]


def _inline(node: Node, shape: ValueShape, room: int) -> str | None:
    """Return a collection on one line, where the user wrote it so and it is short enough; empty ones always."""
    if isinstance(node, Scalar):
        return _one_line(node, flow=True, quantity=shape.is_quantity)
    if not node.entries:
        return "{}" if node.is_mapping else "[]"
    if not node.flow or node.has_comments:
        return None
    parts = []
    columns = room - 2  # given up as soon as nothing is left: the bottom of a deep nest is not written once a level
    for entry in _ordered(node, shape):
        part = _inline(entry.value, _inner(entry, shape), columns)
        if part is None:
            return None
        parts.append(f"{_key(entry.key, flow=True)} {part}" if entry.key else part)
        columns -= len(parts[-1]) + 2
        if columns < -4:
            return None
    text = ", ".join(parts)
    text = f"{{ {text} }}" if node.is_mapping else f"[{text}]"
    return text if len(text) <= room else None


def _key(key: Scalar, *, flow: bool = False) -> str:
    text = _one_line(key, flow=flow) if key.text else "''"
    if len(text) > _LONGEST_KEY:
        raise KeyTooLong(key)
    return f"{text}:"


def _without_leading_blank(lines: list[str]) -> list[str]:
    return lines[1:] if lines[:1] == [""] else lines


def _comment_lines(comments: list[str], indent: int) -> list[WrittenLine]:
    return [WrittenLine(" " * indent + comment if comment else "") for comment in comments]


def _text(lines: list[WrittenLine]) -> str:
    """Return the lines as text, trailing comments of neighbouring lines in one column."""
    written: list[str] = []
    run: list[WrittenLine] = []
    for line in lines:
        if line.comment:
            run.append(line)
            continue
        written += _aligned(run)
        run = []
        written.append(line.text)
    return "\n".join([*written, *_aligned(run), ""])


def _aligned(run: list[WrittenLine]) -> list[str]:
    column = max((len(line.text) for line in run if len(line.text) <= _ALIGNED), default=0)
    return [f"{line.text.ljust(column)}  {line.comment}" for line in run]


def _one_line(scalar: Scalar, *, flow: bool = False, quantity: bool = False) -> str:
    """Return the scalar on one line; inside a flow collection (`flow`) more needs quotes."""
    value = scalar.text
    if quantity and (found := _QUANTITY.fullmatch(value)):
        return f"{found[1]} {found[2]}"
    if scalar.style == "" and not any(character in value for character in "\n\x85\u2028\u2029"):
        return value or ("null" if flow else "")
    if not value.isprintable():
        return _double(value)
    if _may_be_plain(value, flow=flow):
        return value
    if "'" in value and '"' not in value and "\\" not in value:
        return f'"{value}"'
    return "'" + value.replace("'", "''") + "'"


def _block_lines(scalar: Scalar, room: int) -> list[str] | None:
    """Return the scalar as a block: its header and its lines without indentation; None where one line is better.

    Literal and folded ones stay what they are. Text that was spread over lines in another way and does not fit
    into `room` characters is folded.
    """
    match scalar.style:
        case "|":
            return _literal(scalar.text)
        case ">":
            return _folded(scalar)
        case _:
            return _newly_folded(scalar, room)


def _may_be_plain(value: str, *, flow: bool) -> bool:
    if _NOT_TEXT.fullmatch(value) or value.endswith((" ", ":")) or not _PLAIN.fullmatch(value):
        return False
    return not (flow and _BREAKS_FLOW.search(value))


def _double(value: str) -> str:
    return '"' + "".join(_SHORT_ESCAPES.get(character) or _escaped(character) for character in value) + '"'


def _escaped(character: str) -> str:
    if character.isprintable():
        return character
    code = ord(character)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def _fits_block(value: str) -> bool:
    """Return whether a block can hold the value: text without hidden characters, at most one line end last."""
    body = value.removesuffix("\n")
    return (
        body.strip() != ""
        and not body.endswith(("\n", " ", "\t"))
        and all(part.isprintable() for part in re.split(r"[\n\t]", body))
    )


def _literal(value: str) -> list[str] | None:
    if not _fits_block(value):
        return None
    lines = value.removesuffix("\n").split("\n")
    upto_text = next(number for number, line in enumerate(lines) if line.strip())
    indicator = "2" if any(line.startswith((" ", "\t")) for line in lines[: upto_text + 1]) else ""
    chomping = "" if value.endswith("\n") else "-"
    return [f"|{indicator}{chomping}", *lines]


def _folded(scalar: Scalar) -> list[str] | None:
    header, *body = scalar.source.text[scalar.start : scalar.end].rstrip().split("\n")
    if not _fits_block(scalar.text) or re.match(r">[-+]?[0-9]", header):
        return None
    if not all(part.isprintable() for line in body for part in line.split("\t")):
        return None
    indent = next(len(line) - len(line.lstrip(" ")) for line in body if line.strip())
    return [">" if scalar.text.endswith("\n") else ">-", *(line[indent:] for line in body)]


def _newly_folded(scalar: Scalar, room: int) -> list[str] | None:
    words = scalar.text.split(" ")
    if not scalar.has_many_lines or not all(words) or not scalar.text.isprintable():
        return None
    if len(_one_line(scalar)) <= room:
        return None
    lines = [""]
    for word in words:
        if lines[-1] and len(lines[-1]) + 1 + len(word) > room:
            lines.append(word)
        else:
            lines[-1] = f"{lines[-1]} {word}".lstrip(" ")
    return [">-", *lines]
