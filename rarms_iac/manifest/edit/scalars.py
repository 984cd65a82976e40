"""How a scalar is written: plain where that is safe, in single quotes where it is not, in double ones at need."""

import re

from rarms_iac.manifest.text.tree import Scalar

# What some YAML, 1.1 or 1.2, would not read as text; quotes that a user put around these stay.
_NOT_TEXT = re.compile(
    r"(?i:~|null|true|false|yes|no|on|off|y|n|<<|=)|[-+]?\.(?i:inf|nan)|[-+.]?[0-9][-+0-9a-fA-FxoXO_.:eETZ ]*|"
)
# Text that needs no quotes to be read as what it is, by people too: a pattern or a formula keeps its own.
_PLAIN = re.compile(r"(?:[\w./]|--?\w)(?:[\w ./+=@~%,-]|:(?=\w))*")
_BREAKS_FLOW = re.compile(r"[,\[\]{}:?]")
_QUANTITY = re.compile(r"([0-9]+(?:\.[0-9]+)?) ?([A-Za-z%/]+)")
_SHORT_ESCAPES = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\0": "\\0"}


def one_line(scalar: Scalar, *, flow: bool = False, quantity: bool = False) -> str:
    """The scalar on one line; inside a flow collection (`flow`) more needs quotes."""
    value = scalar.value
    if quantity and (found := _QUANTITY.fullmatch(value)):
        return f"{found[1]} {found[2]}"
    if scalar.style == "" and not _breaks_lines(value):
        return value or ("null" if flow else "")
    if not value.isprintable():
        return _double(value)
    if _may_be_plain(value, flow=flow):
        return value
    if "'" in value and '"' not in value and "\\" not in value:
        return f'"{value}"'
    return "'" + value.replace("'", "''") + "'"


def block_lines(scalar: Scalar, source: str, room: int) -> list[str] | None:
    """The scalar as a block: its header and its lines without indentation; None where one line is better.

    Literal and folded ones stay what they are. Text that was spread over lines in another way and does not fit
    into `room` characters is folded.
    """
    match scalar.style:
        case "|":
            return _literal(scalar.value)
        case ">":
            return _folded(scalar, source)
        case _:
            return _newly_folded(scalar, room)


def _breaks_lines(value: str) -> bool:
    return any(character in value for character in "\n\x85\u2028\u2029")


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
    """Whether a block says it exactly: it has text, nothing hidden, and ends in at most one line end."""
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


def _folded(scalar: Scalar, source: str) -> list[str] | None:
    header, *body = source[scalar.start : scalar.end].rstrip().split("\n")
    if not _fits_block(scalar.value) or re.match(r">[-+]?[0-9]", header):
        return None
    if not all(part.isprintable() for line in body for part in line.split("\t")):
        return None
    indent = next(len(line) - len(line.lstrip(" ")) for line in body if line.strip())
    return [">" if scalar.value.endswith("\n") else ">-", *(line[indent:] for line in body)]


def _newly_folded(scalar: Scalar, room: int) -> list[str] | None:
    words = scalar.value.split(" ")
    if not scalar.many_lines or not all(words) or not scalar.value.isprintable():
        return None
    if len(one_line(scalar)) <= room:
        return None
    lines = [""]
    for word in words:
        if lines[-1] and len(lines[-1]) + 1 + len(word) > room:
            lines.append(word)
        else:
            lines[-1] = f"{lines[-1]} {word}".lstrip(" ")
    return [">-", *lines]
