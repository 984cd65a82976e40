"""Members, elements and casts of values, as strict mode 3 has them: what is not there is an error."""

from collections.abc import Callable

from tests.fake_powershell.scopes import Block, Cmdlet, Reference, Scope
from tests.fake_powershell.values import (
    EMPTY,
    Char,
    Enumerated,
    Record,
    ScriptError,
    Table,
    Thing,
    Unsupported,
    Value,
    cannot_convert,
    elements,
    guid,
    is_null,
    narrow,
    no_property,
    number,
    text,
    truth,
    wide,
)


def get(owner: Value, name: str) -> Value:
    """`owner.name`."""
    low = name.lower()
    match owner:
        case Table():
            return _of_table(owner, name)
        case list() | bytes():
            if low in ("count", "length"):
                return len(owner)
            return _of_each(elements(owner), name)
        case str() if low == "length":
            return len(owner.encode("utf-16-le")) // 2
        case Thing() if low == "psobject":
            return Record(Properties=PropertyList(owner))
        case Thing():
            return owner.get(name)
        case _:
            raise no_property(name)


class PropertyList(list[Value]):
    """`$x.PSObject.Properties`: asked by name it has nothing where there is none."""

    def __init__(self, owner: Thing) -> None:
        super().__init__(Record(Name=key, Value=value) for key, value in owner.properties.items())

    def named(self, name: str) -> Value:
        return next((item for item in self if item.get("Name").lower() == name.lower()), None)


def _of_table(owner: Table, name: str) -> Value:
    if owner.has(name):
        return owner.at(name)
    match name.lower():
        case "count":
            return len(owner)
        case "keys":
            return owner.keys()
        case "values":
            return [value for _, value in owner.items()]
        case _:
            raise no_property(name)


def _of_each(owners: list[Value], name: str) -> Value:
    if not owners:
        raise no_property(name)
    return [get(owner, name) for owner in owners]


def set_property(owner: Value, name: str, value: Value) -> None:
    """`owner.name = value`."""
    match owner:
        case Table():
            owner.put(name, value)
        case Thing():
            setter: Callable[[Value], None] | None = getattr(owner, f"set_{name.lower()}", None)
            if setter is None:
                raise no_property(name)
            setter(value)
        case _:
            raise no_property(name)


def element(owner: Value, index: Value) -> Value:
    """`owner[index]`."""
    match owner:
        case Table():
            return owner.at(index)
        case PropertyList() if isinstance(index, str):
            return owner.named(text(index))
        case list() | bytes() | str() if isinstance(index, int):
            at = number(index)
            if not -len(owner) <= at < len(owner):
                raise ScriptError("Index was outside the bounds of the array.", error_id="IndexOutOfRangeException")
            return Char(owner[at]) if isinstance(owner, str) else owner[at]
        case _ if is_null(owner):
            raise ScriptError("Cannot index into a null array.", error_id="NullArray")
        case _:
            raise Unsupported(f"an element of {owner!r}")


def put(owner: Value, index: Value, value: Value) -> None:
    """`owner[index] = value`."""
    match owner:
        case Table():
            owner.put(index, value)
        case list():
            element(owner, index)
            owner[number(index)] = value
        case _:
            raise Unsupported(f"an assignment to an element of {owner!r}")


_TEXT: dict[str, Callable[..., Value]] = {
    "tolowerinvariant": str.lower,
    "toupperinvariant": str.upper,
    "substring": lambda of, begin, length=None: _substring(of, begin, length),
    "contains": lambda of, part: text(part) in of,
    "trim": str.strip,
    "trimend": lambda of, characters: of.rstrip(text(characters)),
    "replace": lambda of, old, new: of.replace(text(old), text(new)),
}


def _substring(of: str, begin: int, length: int | None) -> str:
    end = len(of) if length is None else begin + length
    if not 0 <= begin <= end <= len(of):
        raise ScriptError("Index and length must refer to a location within the string.", error_id="ArgumentOutOfRange")
    return of[begin:end]


def call(owner: Value, name: str, arguments: list[Value]) -> Value:
    """`owner.name(arguments)`."""
    match owner:
        case str() if name.lower() in _TEXT:
            return _TEXT[name.lower()](owner, *arguments)
        case Table() if name.lower() == "clear":
            owner.clear()
            return EMPTY
        case Table() if name.lower() == "remove":
            owner.remove(arguments[0])
            return EMPTY
        case Table() if name.lower() in ("contains", "containskey"):
            return owner.has(arguments[0])
        case Thing():
            return owner.call(name, arguments)
        case _ if is_null(owner):
            raise ScriptError("You cannot call a method on a null-valued expression.", error_id="InvokeMethodOnNull")
        case _:
            raise Unsupported(f"the method {name} of {type(owner).__name__}")


def cast(to: str, value: Value, scope: Scope) -> Value:
    """`[to] value`; also what a typed parameter makes of its argument. An empty type keeps the value."""
    match to:
        case "":
            return None if value is EMPTY else value
        case "void":
            return EMPTY
        case "string":
            return text(value)
        case "bool" | "switch":
            return truth(value)
        case "int":
            return narrow(round(value) if isinstance(value, float) else number(value))  # half goes to even
        case "long":
            return wide(number(value))
        case "char":
            return _character(value)
        case "byte[]":
            return value if isinstance(value, bytes) else bytes(number(element) for element in elements(value))
        case "string[]":
            return [text(element) for element in elements(value)]
        case "guid":
            return guid(value)
        case "scriptblock":
            return _held(value, Block, to)
        case "system.collections.idictionary":
            return _held(value, Table, to)
        case "pscustomobject" if isinstance(value, Record):
            return value
        case "pscustomobject":
            return Record(**{text(name): held for name, held in _held(value, Table, to).items()})
        case "ref":
            return _held(value, Reference, to)
        case "system.management.automation.pscmdlet":
            return _held(value, Cmdlet, to)
        case "system.management.automation.confirmimpact":
            return Enumerated(text(value))
        case _:
            raise Unsupported(f"a cast to {to}")


def _character(value: Value) -> Char:
    if isinstance(value, int) and not isinstance(value, bool):
        return Char(chr(value))
    if isinstance(value, str) and len(value) == 1:
        return Char(value)
    raise cannot_convert(value, "System.Char")


def _held(value: Value, kind: type, to: str) -> Value:
    if is_null(value) or isinstance(value, kind):
        return None if value is EMPTY else value
    raise cannot_convert(value, to)
