"""Random manifests as people write them: any order, any style, comments in every place where YAML has room for them."""

import json
import re
from collections import Counter
from collections.abc import Callable
from typing import Any

from hypothesis import strategies as st

_KNOWN = ["schema", "hosts", "components", "application", "policy", "memory", "apt", "run", "cpu", "reserve", "onboard"]
_ODD_KEYS = ["7", "'7'", '"no"', "no", "null", "a b", "'a: b'", '"#k"', "'- x'", "~", "x:y", "k#v", "'<<'", "1e3", "Ä"]
_PLAIN_VALUES = ["1", "no", "88ms", "512 MiB", "0640", "~", "null", "", "a b  c", "1.50", "-5", ".5", "x#y", "a:b"]
_PLAIN_VALUES += ["2027-01-31", "true", "Yes", "70 %", "24/s", "0x1F", "--flag", "-x", "http://x/y?z", "ä\u00a0b", "<<"]
_QUOTED_VALUES = ["'no'", '"7"', "'it''s'", '"a\\nb"', '"tab\\t"', "''", "' lead'", '"x: y"', "'# x'", '"88ms"', "'-'"]
_QUOTED_VALUES += ["'a, b'", "'{x}'", '"\\u2028"', "'^a(?P<x>[01])$'", "'~'", "'---'", '"a\\\\b"', "'x y'", "'1:30'"]
_LOOSE = Callable[[st.SearchStrategy[Any]], Any]


def _quoted(text: str) -> str:
    """JSON is YAML, but for what its writer leaves unescaped."""
    return "".join(f"\\u{ord(char):04x}" if char in "\x7f\x85\u2028\u2029\ufeff" else char for char in _json(text))


def _json(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


_TEXTS = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\ufffe\uffff"), max_size=12).map(_quoted)
_SCALARS = st.one_of(st.sampled_from(_PLAIN_VALUES), st.sampled_from(_QUOTED_VALUES), _TEXTS)


class _Author:
    """Writes a random manifest, badly: any order, any style, comments in every place where YAML has room for them."""

    def __init__(self, draw: _LOOSE) -> None:
        self.draw = draw
        self.comments = 0

    def chance(self, one_in: int) -> bool:
        return bool(self.draw(st.integers(1, one_in)) == one_in)

    def comment(self) -> str:
        self.comments += 1
        return f"#{self.draw(st.sampled_from(['', ' ', '!', ' # ']))}«{self.comments}»"

    def trailing(self) -> str:
        return f" {self.comment()}" if self.chance(4) else ""

    def loose_lines(self, indent: int) -> list[str]:
        lines = []
        while self.chance(4):
            column = max(0, indent + self.draw(st.sampled_from([0, 0, 0, -2, 2])))
            lines.append("" if self.chance(2) else " " * column + self.comment())
        return lines

    def keys(self) -> list[str]:
        keys: list[str] = self.draw(st.lists(st.sampled_from(_KNOWN + _ODD_KEYS), min_size=1, max_size=4, unique=True))
        seen: set[str] = set()
        kept = []
        for key in keys:
            if (name := key.strip("'\"")) not in seen and name:
                seen.add(name)
                kept.append(key)
        return [key for key in kept if key != "<<"]

    def mapping(self, depth: int, indent: int) -> list[str]:
        lines = []
        for key in self.keys():
            lines += self.loose_lines(indent)
            lines += self.behind(f"{' ' * indent}{key}:", depth, indent, same_column=True)
        return lines + self.loose_lines(indent)

    def sequence(self, depth: int, indent: int) -> list[str]:
        lines = []
        for _ in range(self.draw(st.integers(1, 3))):
            lines += self.loose_lines(indent)
            lines += self.behind(" " * indent + "-", depth, indent, same_column=False)
        return lines

    def behind(self, head: str, depth: int, indent: int, *, same_column: bool) -> list[str]:
        step = self.draw(st.sampled_from([1, 2, 4]))
        kind = self.draw(st.sampled_from(["scalar", "scalar", "flow", "block", "map", "list", "many lines"]))
        if kind == "flow":
            return [f"{head} {self.flow(depth, indent + 1)}{self.trailing()}"]
        if kind == "block":
            return self.block_scalar(head, indent + step)
        if kind == "many lines":
            pad = " " * (indent + step)
            return [f"{head} some words", *([""] if self.chance(3) else []), f"{pad}and more{self.trailing()}"]
        if depth > 0 and kind == "map":
            return [head + self.trailing(), *self.mapping(depth - 1, indent + step)]
        if depth > 0 and kind == "list":
            return [head + self.trailing(), *self.sequence(depth - 1, indent if same_column else indent + step)]
        return [f"{head} {self.draw(_SCALARS)}{self.trailing()}"]

    def block_scalar(self, head: str, indent: int) -> list[str]:
        header = self.draw(st.sampled_from(["|", ">", "|-", ">-", "|+", ">+"]))
        lines = self.draw(st.lists(st.sampled_from(["text", "  more", "", "# no", "a: b ", "é\tx", "   "]), max_size=4))
        return [f"{head} {header}{self.trailing()}", *(" " * indent + line for line in ["first", *lines])]

    def flow(self, depth: int, indent: int) -> str:
        if depth <= 0 or self.chance(3):
            text: str = self.draw(_SCALARS.filter(lambda scalar: not re.search(r"[:?]", scalar) or scalar[:1] in "'\""))
            return text or "''"
        gap = f"{self.trailing()}\n{' ' * indent}" if self.chance(4) else " "
        if self.chance(2):
            items = [self.flow(depth - 1, indent) for _ in range(self.draw(st.integers(0, 3)))]
            return f"[{gap}{f',{gap}'.join(items)}{gap}]"
        pairs = [f"{key}: {self.flow(depth - 1, indent)}" for key in self.keys() if self.chance(2)]
        return f"{{{gap}{f',{gap}'.join(pairs)}{gap}}}"


@st.composite
def manifests(draw: _LOOSE) -> str:
    """Texts of which most can be read."""
    author = _Author(draw)
    lines = author.mapping(3, 0)
    text: str = draw(st.sampled_from(["\n", "\n", "\r\n"])).join([*lines, ""])
    return str(draw(st.sampled_from(["", "\ufeff"]))) + text


def comments(text: str) -> Counter[str]:
    """The comments of such a text, each known by its number."""
    return Counter(re.findall(r"«[0-9]+»", text))
