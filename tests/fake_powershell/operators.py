"""PowerShell's operators over values."""

import re
from collections.abc import Callable

from tests.fake_powershell.scopes import Scope
from tests.fake_powershell.text import formatted, joined, like, regex
from tests.fake_powershell.values import (
    EMPTY,
    Char,
    Long,
    Match,
    Moment,
    Table,
    Unsupported,
    Value,
    elements,
    is_null,
    narrow,
    number,
    same,
    text,
    wide,
)


def arithmetic(operator: str, left: Value, right: Value) -> Value:
    """`+`, `-`, `*`, and `/`."""
    if operator == "+":
        return _sum(left, right)
    if operator == "*" and isinstance(left, list):
        return left * number(right)
    a, b = number(left), number(right)
    if operator == "/":
        if a % b:
            return a / b  # a double
        return sized(a // b, left, right)
    return sized(a - b if operator == "-" else a * b, left, right)


def _sum(left: Value, right: Value) -> Value:
    match left:
        case Char():
            raise Unsupported("adding to a single character")
        case str():
            return left + text(right)
        case list():
            return left + (list(right) if isinstance(right, list | bytes) else [] if right is EMPTY else [right])
        case Table():
            raise Unsupported("adding tables")
        case _ if is_null(left):
            return right
        case _:
            return sized(number(left) + number(right), left, right)


def sized(result: int, left: Value, right: Value) -> Value:
    """A sum as wide as its parts; one that does not fit would become a double."""
    if isinstance(left, Long) or isinstance(right, Long):
        return wide(result)
    if not -(2**31) <= result < 2**31:
        return float(result)
    return narrow(result)


def _each(test: Callable[[Value], bool]) -> Callable[[Value], Value]:
    """An array on the left is filtered."""
    return lambda left: [item for item in left if test(item)] if isinstance(left, list) else test(left)


def compare(operator: str, left: Value, right: Value, scope: Scope) -> Value:
    """The comparing operators; those without `c` do not tell case."""
    case = operator.startswith("-c") and operator != "-contains"
    plain = "-" + operator[2:] if case else operator
    match plain:
        case "-eq":
            return _each(lambda item: same(item, right, case=case))(left)
        case "-ne":
            return _each(lambda item: not same(item, right, case=case))(left)
        case "-gt" | "-ge" | "-lt" | "-le":
            return _order(plain, left, right)
        case "-contains":
            return any(same(element, right, case=case) for element in elements(left))
        case "-notcontains":
            return not any(same(element, right, case=case) for element in elements(left))
        case "-like":
            return _each(lambda item: like(text(item), text(right), case=case))(left)
        case "-match":
            return _match(left, text(right), case, scope)
        case "-replace":
            return _replace(left, right, case)
        case "-split":
            return _split(text(left), elements(right), case)
        case "-join":
            return joined(elements(left), right)
        case _:
            raise Unsupported(f"the operator {operator}")


def _split(value: str, how: list[Value], case: bool) -> list[Value]:
    most = number(how[1]) - 1 if len(how) > 1 else 0
    return list(regex(text(how[0]), case=case).split(value, maxsplit=most))


def _order(operator: str, left: Value, right: Value) -> bool:
    if isinstance(left, list | str | Table):
        raise Unsupported(f"{operator} of {left!r}")
    both = isinstance(left, Moment) and isinstance(right, Moment)
    a, b = (left.clock, right.clock) if both else (number(left), number(right))
    return {"-gt": a > b, "-ge": a >= b, "-lt": a < b, "-le": a <= b}[operator]


def _match(left: Value, pattern: str, case: bool, scope: Scope) -> bool:
    if isinstance(left, list):
        raise Unsupported("-match of an array")
    found = regex(pattern, case=case).search(text(left))
    if found is None:
        return False
    groups: list[tuple[Value, Value]] = [(0, found[0])]
    groups += [(key, value) for key, value in found.groupdict().items() if value is not None]
    scope.write("matches", Table(groups))
    return True


_GROUP = re.compile(r"\$([0-9])")


def _replace(left: Value, right: Value, case: bool) -> str:
    pattern, new = [*elements(right), ""][:2]
    if isinstance(left, list) or "$" in _GROUP.sub("", text(new)):
        raise Unsupported("-replace of an array, or with more than groups by number")

    def filled(found: re.Match[str]) -> str:
        return _GROUP.sub(lambda group: found[int(group[1])], text(new))

    return regex(text(pattern), case=case).sub(filled, text(left))


def band(left: Value, right: Value) -> Value:
    return sized(number(left) & number(right), left, right)


def format_with(left: Value, right: Value) -> str:
    return formatted(text(left), elements(right))


def match_thing(found: re.Match[str]) -> Match:
    return Match(Value=found[0], Index=found.start(), Success=True)
