"""The values of PowerShell as the fake knows them, and how they become text, truth and numbers.

`None` is `$null`, `EMPTY` what a command without output gives (it is `$null` too, but no element of anything), a list
an array, `bytes` a `byte[]`. Whole numbers keep their width, because a hashtable tells `[int] 1` from `[long] 1`.
"""

import re
from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime, timedelta
from functools import cache
from typing import Any

Value = Any
"""Anything that a script can hold: see above."""


class Unsupported(BaseException):
    """The script uses something that the fake does not know: the test fails, no script catches it."""


class ScriptError(Exception):
    """A terminating error as a script sees it in `$_`."""

    def __init__(
        self, says: str, *, error_id: str = "RuntimeException", category: str = "OperationStopped", kind: str = ""
    ) -> None:
        super().__init__(says)
        self.says = says
        self.error_id = error_id
        self.category = category
        self.kind = kind  # the .NET type of its exception
        self.command = ""  # the cmdlet that failed
        self.line = 0  # where it was called


class _Empty:
    def __repr__(self) -> str:
        return "nothing"

    def __deepcopy__(self, memo: object) -> "_Empty":
        return self


EMPTY = _Empty()


class Long(int):
    """A 64-bit whole number."""


class Char(str):
    """One UTF-16 unit."""

    __slots__ = ()


class Enumerated:
    """A value of an enumeration: its name counts, never its number."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __str__(self) -> str:
        return self.name


class Thing:
    """An object with properties and methods; asking for another one is an error, as strict mode wants it."""

    type_name = "System.Object"

    def __init__(self, **properties: Value) -> None:
        self.properties: dict[str, Value] = properties

    def __str__(self) -> str:
        return self.type_name

    def get(self, name: str) -> Value:
        for key, value in self.properties.items():
            if key.lower() == name.lower():
                return value
        raise no_property(name)

    def call(self, name: str, arguments: list[Value]) -> Value:
        method: Callable[..., Value] | None = getattr(self, f"do_{name.lower()}", None)
        if method is None:
            raise Unsupported(f"the method {name} of {self.type_name}")
        return method(*arguments)


class Record(Thing):
    """What ConvertFrom-Json gives."""

    type_name = "System.Management.Automation.PSCustomObject"


class Guid(Thing):
    """An id; as text it is lower case."""

    type_name = "System.Guid"

    def __init__(self, text: str) -> None:
        super().__init__()
        self.text = text.lower()

    def __str__(self) -> str:
        return self.text


class Match(Thing):
    """One match of a regular expression."""

    type_name = "System.Text.RegularExpressions.Match"


BEGINNING = datetime(2026, 1, 31, 12, tzinfo=UTC)
"""The time at which a host's clock begins."""


class Moment(Thing):
    """A time by the host's clock."""

    type_name = "System.DateTime"

    def __init__(self, clock: int) -> None:
        super().__init__()
        self.clock = clock

    def __str__(self) -> str:
        """As a cast to text writes it, in every culture."""
        return (BEGINNING + timedelta(milliseconds=self.clock)).strftime("%m/%d/%Y %H:%M:%S")

    def do_addmilliseconds(self, span: Value) -> Value:
        return Moment(self.clock + number(span))


class Table:
    """A hashtable, or an ordered one. 5.1 compares keys that are text by the culture of the user who runs it.

    So two texts that are one key in some cultures and two in others are an error here, unless the table is ordinal.
    """

    def __init__(
        self, entries: Iterable[tuple[Value, Value]] = (), *, ordered: bool = False, ordinal: bool = False
    ) -> None:
        self.ordered = ordered
        self.ordinal = ordinal
        self._held: dict[tuple[str, object], tuple[Value, Value]] = {}
        self._texts: dict[str, str] = {}  # by what any culture may make of it: the text that is a key
        for key, value in entries:
            if self.has(key):
                raise Unsupported(f"the key {key!r} stands twice")
            self.put(key, value)

    def put(self, key: Value, value: Value) -> None:
        place = self._key(key)
        if isinstance(key, str) and not self.ordinal:
            self._texts[_in_some_culture(key)] = key
        old = self._held.get(place)
        self._held[place] = (old[0] if old else key, None if value is EMPTY else value)

    def clear(self) -> None:
        self._held.clear()
        self._texts.clear()

    def remove(self, key: Value) -> None:
        self._held.pop(self._key(key), None)

    def has(self, key: Value) -> bool:
        return self._key(key) in self._held

    def at(self, key: Value) -> Value:
        found = self._held.get(self._key(key))
        return found[1] if found else None

    def keys(self) -> list[Value]:
        return [key for key, _ in self._held.values()]

    def items(self) -> Iterator[tuple[Value, Value]]:
        return iter(list(self._held.values()))

    def __len__(self) -> int:
        return len(self._held)

    def _key(self, key: Value) -> tuple[str, object]:
        if isinstance(key, str) and (held := self._texts.get(_in_some_culture(key), key)) != key:
            raise Unsupported(f"the keys {held!r} and {key!r}: whether they are one depends on the culture")
        return ("text", key) if type(key) is str else _key(key)  # most are


@cache
def _in_some_culture(key: str) -> str:
    return key.lower().replace("\N{SOFT HYPHEN}", "")


def _key(key: Value) -> tuple[str, object]:
    match key:
        case bool() | None:
            return type(key).__name__, key
        case Long():
            return "long", int(key)
        case int():
            return "int", key
        case Char():
            return "char", str(key)
        case str():
            return "text", key
        case _:
            raise Unsupported(f"{key!r} as a key")


def no_property(name: str) -> ScriptError:
    return ScriptError(
        f"The property '{name}' cannot be found on this object. Verify that the property exists.",
        error_id="PropertyNotFoundStrict",
        kind="System.Management.Automation.PropertyNotFoundException",
    )


_GUID = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")


def guid(value: Value) -> Guid:
    if isinstance(value, Guid):
        return value
    if isinstance(value, str) and _GUID.fullmatch(value.lower()):
        return Guid(value)
    raise cannot_convert(value, "System.Guid")


def type_name(value: Value) -> str:
    """Return what messages call its type, where this differs from Python's name."""
    return value.type_name if isinstance(value, Thing) else type(value).__name__


def is_null(value: Value) -> bool:
    return value is None or value is EMPTY


def elements(value: Value) -> list[Value]:
    """What the value is as a sequence: of one where it is not a collection, of none where a command gave nothing."""
    if value is EMPTY:
        return []
    if isinstance(value, list):
        return value
    if isinstance(value, bytes):
        return list(value)
    return [value]


def unwrapped(outputs: list[Value]) -> Value:
    """What an assignment or an argument gets of a pipeline's outputs."""
    if not outputs:
        return EMPTY
    return outputs[0] if len(outputs) == 1 else outputs


def text(value: Value) -> str:
    match value:
        case None | _Empty():
            return ""
        case bool():
            return "True" if value else "False"
        case list() | bytes():
            return " ".join(text(item) for item in value)
        case Table():
            return type_name(value)
        case int():
            return str(int(value))
        case _:
            return str(value)


def truth(value: Value) -> bool:
    match value:
        case None | _Empty():
            return False
        case bool() | int() | str():
            return bool(value)
        case list():
            return truth(value[0]) if len(value) == 1 else bool(value)
        case _:
            return True


def number(value: Value) -> int:
    """As a whole number.

    Raises:
        ScriptError: it is none.
    """
    match value:
        case None | _Empty():
            return 0
        case bool():
            return int(value)
        case Char():
            return ord(value)
        case int():
            return value
        case float() if value == int(value):
            return int(value)
        case str() if re.fullmatch(r"\s*[+-]?[0-9]+\s*", value):
            return int(value)
        case str() if not value.strip():
            return 0
        case _:
            raise cannot_convert(value, "System.Int64")


def cannot_convert(value: Value, to: str) -> ScriptError:
    says = f'Cannot convert value "{text(value)[:80]}" of type "{type_name(value)}" to type "{to}".'
    return ScriptError(
        says,
        error_id="InvalidCast",
        category="InvalidArgument",
        kind="System.Management.Automation.PSInvalidCastException",
    )


def narrow(value: int) -> int:
    """As `[int]`."""
    if not -(2**31) <= value < 2**31:
        raise cannot_convert(value, "System.Int32")
    return int(value)


def wide(value: int) -> Long:
    """As `[long]`."""
    if not -(2**63) <= value < 2**63:
        raise cannot_convert(value, "System.Int64")
    return Long(value)


def same(left: Value, right: Value, *, case: bool) -> bool:
    """`-ceq` and `-eq` of a left side that is not an array: the right one is taken for the left one's type."""
    match left:
        case None | _Empty():
            return is_null(right)
        case bool():
            return left == truth(right)
        case int() | float():
            if is_null(right) or isinstance(right, list | Table):
                return False
            try:
                return bool(left == number(right))
            except ScriptError:
                return False
        case str():
            return not is_null(right) and _same_text(str(left), text(right), case)
        case Enumerated() | Guid():
            return not is_null(right) and str(left).lower() == text(right).lower()
        case _:
            return left is right


WIDTHLESS = dict.fromkeys(map(ord, "\0\u00ad\u200b\u200c\u200d\u2060\ufeff"))
"""Characters that comparing by culture, as PowerShell does, takes no notice of."""


def _same_text(left: str, right: str, case: bool) -> bool:
    if not case:
        left, right = left.lower(), right.lower()
    if left != right and left.translate(WIDTHLESS) == right.translate(WIDTHLESS):
        raise Unsupported(f"{left!r} and {right!r}: only an ordinal comparison tells them apart")
    return left == right
