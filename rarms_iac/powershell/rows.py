"""Neighbouring blocks of a plan that differ in literals alone, as one table and one block of steps. Pure.

A row holds the literals that differ, each whole; what differs in the same way is one column. The steps of a row are
those of its block, in the same order, so that a table is its blocks one after another. In blocks, which run later, a
column is `$script:Row.Name`: the module sets it before it calls them.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

from rarms_iac.powershell.literals import Literal
from rarms_iac.powershell.templates import LATER_ROW, ROW, StepText, TargetText, statement_lines, table_lines
from rarms_iac.texts.messages import remark

_STRING = r"'(?:[^']|'')*'"
_VALUE = re.compile(
    rf"(?<= -)(\w+) ({_STRING}|[0-9]+|\$(?:true|false)|\(''(?: \+ (?:{_STRING}|\[char\]0x[0-9A-F]{{4}}))*\))(?= |$)"
)
"""A literal behind its parameter, in calls as rarms writes them; not the names ahead of a call in a step of several."""

_RESERVED = ("count", "item", "keys", "values")
"""What a table has apart from its entries."""

LiteralText = Callable[[str, Literal, str], str]
"""What to write for a literal: of its name, the literal, and the variable by which a row is read at that place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanBlock:
    """Statements of a plan about one partition or task class, which stand together."""

    owner: str
    reason: str  # of its banner; empty: it has none
    action: str  # of its first step
    place: str  # in the manifest
    is_first: bool  # of its owner's
    statements: tuple[TargetText | StepText, ...]


def plan_lines(blocks: Iterable[PlanBlock]) -> Iterator[str]:
    """Write the statements of a plan: alike neighbours as a table and one block of steps, where that is shorter.

    Args:
        blocks: in the order of their steps.

    Yields:
        Lines, an empty one before the first block of an owner but for the plan's first line.
    """
    for at, (_, group) in enumerate(groupby(blocks, key=_form)):
        alike = tuple(group)
        lines = [line for block in alike for line in _lines(block)]
        if len(alike) > 1:
            lines = min(lines, [*_table(alike)], key=len)
        yield from lines[1:] if not at and lines[:1] == [""] else lines


def _form(block: PlanBlock) -> tuple[str, tuple[TargetText | StepText, ...]]:
    return block.reason, tuple(_with_literals(statement, lambda *_: "") for statement in block.statements)


def _lines(block: PlanBlock) -> Iterator[str]:
    if block.reason:
        yield from _banner(block, f"{block.owner}: {block.reason}" + (f" ({block.place})" if block.place else ""))
    for statement in block.statements:
        yield from statement_lines(statement)


def _banner(block: PlanBlock, about: str) -> Iterator[str]:
    yield from [""] if block.is_first else []
    yield "    " + f"# === {remark(about)} ".ljust(96, "=").rstrip()


def _table(alike: Sequence[PlanBlock]) -> Iterator[str]:
    """Yield the rows of these blocks, and their steps with columns."""
    columns: dict[tuple[Literal, ...], str] = {}
    names: list[str | None] = []  # of each literal its column; None: it is the same in all rows
    for same in zip(*map(_literals, alike), strict=True):
        values = tuple(value for _, value in same)
        if len(set(values)) > 1 and values not in columns:
            columns[values] = _column(same[0][0], columns.values())
        names.append(columns.get(values))
    first = alike[0]
    abouts = {block.reason or block.action for block in alike}
    about = abouts.pop() if len(abouts) == 1 else "with the values of each row"
    yield from _banner(first, f"{first.owner} and {len(alike) - 1} more: {about}")
    rows = [{name: values[at] for values, name in columns.items()} for at in range(len(alike))]
    yield from table_lines(rows, [remark(block.place) for block in alike])
    remaining = iter(names)

    def text_for(_: str, value: Literal, variable: str) -> str:
        name = next(remaining)
        return f"{variable}.{name}" if name else value

    for statement in first.statements:
        mapped = _with_literals(statement, text_for)
        if isinstance(mapped, TargetText):
            mapped = replace(mapped, in_rows=True)
        yield from (f"    {line}" for line in statement_lines(mapped))
    yield "    }"


def _literals(block: PlanBlock) -> list[tuple[str, Literal]]:
    found: list[tuple[str, Literal]] = []

    def text_for(name: str, value: Literal, _: str) -> str:
        found.append((name, value))
        return ""

    for statement in block.statements:
        _with_literals(statement, text_for)
    return found


def _column(name: str, taken: Iterable[str]) -> str:
    """Return a column's name: that of its parameter or reading, with a number if another column has it."""
    words = re.findall("[A-Za-z0-9]+", name)
    plain = "".join(word[:1].upper() + word[1:] for word in words).lstrip("0123456789") or "Value"
    used = {*_RESERVED, *(other.lower() for other in taken)}
    names = (f"{plain}{number or ''}" for number in (0, *range(2, len(used) + 3)))
    return next(free for free in names if free.lower() not in used)


def _with_literals(statement: TargetText | StepText, text_for: LiteralText) -> TargetText | StepText:
    """Return the statement with another text for each of its literals."""
    if isinstance(statement, TargetText):
        return replace(
            statement, address=text_for("Address", statement.address, ROW), reading=_call(statement.reading, text_for)
        )
    return replace(
        statement,
        action=text_for("Action", statement.action, ROW),
        options=tuple(
            (name, _call(text, text_for) if text.startswith("{") else text_for(name, text, ROW))
            for name, text in statement.options
        ),
        same={name: text_for(name, value, ROW) for name, value in statement.same.items()},
        before={name: text_for(name, value, ROW) for name, value in statement.before.items()},
        after={name: text_for(f"new {name}", value, ROW) for name, value in statement.after.items()},
        calls=tuple(_call(call, text_for) for call in statement.calls),
    )


def _call(text: str, text_for: LiteralText) -> str:
    return _VALUE.sub(lambda match: f"{match[1]} {text_for(match[1], match[2], LATER_ROW)}", text)
