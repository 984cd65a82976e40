"""The few classes of .NET that rarms' scripts use."""

from __future__ import annotations

import hashlib
import re
from base64 import b64decode
from collections.abc import Callable

from tests.fake_powershell import guests
from tests.fake_powershell.host import DELETE, READ, READ_WRITE, WRITE, File, WindowsHost
from tests.fake_powershell.hyperv import refused
from tests.fake_powershell.operators import match_thing
from tests.fake_powershell.scopes import Scope
from tests.fake_powershell.text import regex
from tests.fake_powershell.values import (
    EMPTY,
    Enumerated,
    Moment,
    Record,
    ScriptError,
    Table,
    Thing,
    Unsupported,
    Value,
    number,
    text,
)

REPARSE_POINT = 0x400


def static_property(kind: str, name: str, scope: Scope) -> Value:
    """`[kind]::name`."""
    host = scope.session.host
    match _short(kind), name.lower():
        case "environment", "machinename":
            return host.computer
        case "environment", "username":
            return host.user
        case "datetime", "utcnow":
            return Moment(host.clock)
        case "intptr", "size":
            return host.bits // 8
        case "text.encoding", "ascii":
            return Encoding("ascii")
        case "text.encoding", "utf8":
            return Encoding("utf-8")
        case "stringcomparer", "ordinal":
            return Thing()
        case "stringcomparison", ("ordinal" | "ordinalignorecase"):
            return Enumerated(name)
        case "io.fileattributes", "reparsepoint":
            return REPARSE_POINT
        case "security.principal.windowsbuiltinrole", _:
            return Enumerated(name)
        case _:
            raise Unsupported(f"[{kind}]::{name}")


def static_call(kind: str, name: str, arguments: list[Value], scope: Scope) -> Value:
    """`[kind]::name(arguments)`."""
    made = _CALLS.get((_short(kind), name.lower()))
    if made is None:
        raise Unsupported(f"[{kind}]::{name}()")
    return made(scope, *arguments)


def _folder(scope: Scope, which: Value) -> Value:
    if text(which) != "CommonApplicationData":
        raise Unsupported(f"the folder {text(which)}")
    return "C:\\ProgramData"


def _short(kind: str) -> str:
    return kind.removeprefix("system.")


class Encoding(Thing):
    """A text encoding, which puts `?` for what it does not have."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.name = name

    def do_getbytes(self, value: Value) -> bytes:
        return text(value).encode(self.name, "replace")

    def do_getstring(self, data: Value, offset: Value = 0, count: Value = None) -> str:
        end = len(data) if count is None else number(offset) + number(count)
        return bytes(data)[number(offset) : end].decode(self.name, "replace").replace("\N{REPLACEMENT CHARACTER}", "?")


def _encoding(scope: Scope, page: Value) -> Encoding:
    if page != LATIN_1:
        raise Unsupported(f"the code page {page}")
    return Encoding("latin-1")


LATIN_1 = 28591


class Sha256(Thing):
    """A hash."""

    def do_computehash(self, data: Value, offset: Value, count: Value) -> bytes:
        return hashlib.sha256(bytes(data)[number(offset) : number(offset) + number(count)]).digest()


class Stream(Thing):
    """A file that is written to."""

    type_name = "System.IO.FileStream"

    def __init__(self, host: WindowsHost, path: str, access: frozenset[str], share: frozenset[str]) -> None:
        super().__init__()
        self.host = host
        self.path = path
        self.position = 0
        self.handle = host.open(path, access, share)
        try:
            if host.file(path) is None:
                host.effect(f"open {path}", lambda: host.write_file(path, b""))
        except ScriptError:
            host.close(self.handle)
            raise

    @property
    def data(self) -> bytes:
        found = self.host.file(self.path)
        assert found is not None
        assert found.data is not None
        return found.data

    def get(self, name: str) -> Value:
        return len(self.data) if name.lower() == "length" else super().get(name)

    def do_setlength(self, length: Value) -> Value:
        if number(length) == len(self.data):
            return EMPTY
        fresh = self.data[: number(length)].ljust(number(length), b"\0")
        self.host.effect(f"cut {self.path}", lambda: self.host.write_file(self.path, fresh))
        return EMPTY

    def set_position(self, value: Value) -> None:
        self.position = number(value)

    def do_write(self, data: Value, offset: Value, count: Value) -> Value:
        new = bytes(data)[number(offset) : number(offset) + number(count)]
        if self.host.tear and len(self.host.effects) in (self.host.kill_before, self.host.kill_after):
            new = new[: len(new) // 2]
        at = self.position
        self.position += len(new)
        fresh = self.data[:at] + new + self.data[self.position :]
        self.host.unflushed.add(self.path)
        self.host.effect(f"write {self.path}", lambda: self.host.write_file(self.path, fresh))
        return EMPTY

    def do_flush(self, to_disk: Value) -> Value:
        if to_disk is not True:
            raise Unsupported("a flush that does not reach the disk")
        self.host.unflushed.discard(self.path)
        return EMPTY

    def do_dispose(self) -> Value:
        self.host.close(self.handle)
        return EMPTY


class AccessList(Thing):
    """What Get-Acl gives."""

    type_name = "System.Security.AccessControl.DirectorySecurity"

    def __init__(self, file: File) -> None:
        super().__init__()
        self.file = file
        self.sddl = ""

    def do_getowner(self, kind: Value) -> Value:
        return Record(Value=self.file.owner)

    def do_setsecuritydescriptorsddlform(self, sddl: Value, sections: Value = "All") -> Value:
        self.sddl = text(sddl)
        return EMPTY


HYPERV_ADMINISTRATORS = "S-1-5-32-578"


class Principal(Thing):
    """The caller."""

    def __init__(self, scope: Scope) -> None:
        super().__init__()
        self.host = scope.session.host

    def do_isinrole(self, role: Value) -> bool:
        if str(role) == HYPERV_ADMINISTRATORS:
            return self.host.hyperv_administrator
        assert str(role) == "Administrator"
        return self.host.elevated


def missing(path: str) -> ScriptError:
    says = f"Could not find file '{path}'."
    return ScriptError(says, error_id="FileNotFoundException", kind="System.IO.FileNotFoundException")


def _is_file(host: WindowsHost, path: str) -> bool:
    found = host.file(path)
    return path in host.guest_files or (found is not None and found.data is not None)


def content(scope: Scope, path: Value) -> bytes:
    """What a reader gets that opens the file, shares it for reading alone, and closes it."""
    host = scope.session.host
    found = host.file(text(path))
    if found is None or found.data is None:
        raise missing(text(path))
    host.close(host.open(text(path), READ, READ))
    return found.data


def _attributes(scope: Scope, path: Value) -> int:
    found = scope.session.host.file(text(path))
    if found is None:
        raise missing(text(path))
    return REPARSE_POINT if found.link else 0


def _make_folder(scope: Scope, path: Value) -> Value:
    host, where = scope.session.host, text(path)
    if host.file(where) is None:
        host.effect(f"make folder {where}", lambda: host.write_file(where, None))
    return Record(FullName=where)


def _move(scope: Scope, old: Value, new: Value) -> Value:
    host, source, target = scope.session.host, text(old), text(new)
    data = content(scope, source)
    host.require_unheld(source)
    if host.file(target):
        raise ScriptError("Cannot create a file when that file already exists.", error_id="IOException")

    def do() -> None:
        host.write_file(target, data)
        del host.files[source.lower()]

    host.effect(f"move {source}", do)
    return EMPTY


def _delete(scope: Scope, path: Value) -> Value:
    host, where = scope.session.host, text(path)
    if where.lower() not in host.files:
        return EMPTY  # what is not there is deleted without an error
    host.require_unheld(where)
    host.effect(f"delete {where}", lambda: host.files.pop(where.lower(), None))
    return EMPTY


def _delete_folder(scope: Scope, path: Value, recursive: Value = False) -> Value:
    host, where = scope.session.host, text(path).lower()
    inside = sorted((at for at in host.files if at.startswith(where + "\\")), reverse=True)
    for at in inside if recursive else ():
        _delete(scope, host.files[at].path)
    if (inside and not recursive) or any(vm.folder.lower() == where for vm in host.vms.values()):
        raise ScriptError("The directory is not empty.", error_id="IOException", kind="System.IO.IOException")
    return _delete(scope, path)


def _replace(scope: Scope, old: Value, new: Value, backup: Value) -> Value:
    host, source, target, kept = scope.session.host, text(old), text(new), text(backup)
    data, before = content(scope, source), content(scope, target)
    for path in (source, target):
        host.require_unheld(path)

    def do() -> None:
        host.write_file(kept, before)
        host.write_file(target, data)
        del host.files[source.lower()]

    host.effect(f"replace {target}", do)
    return EMPTY


def _regex_replace(scope: Scope, value: Value, pattern: Value, new: Value) -> str:
    from tests.fake_powershell.expressions import run_block

    def fill(found: object) -> str:
        return text(run_block(new, scope, arguments=[match_thing(found)]))  # type: ignore[arg-type]  # re.Match[str]

    return regex(text(pattern), case=True).sub(fill, text(value))


def _sort(scope: Scope, values: Value, comparer: Value) -> Value:
    if not isinstance(values, list) or not all(isinstance(item, str) for item in values):
        raise Unsupported("Array.Sort of anything but text")
    values.sort(key=lambda item: item.encode("utf-16-be"))
    return EMPTY


def _new_stream(scope: Scope, path: Value, mode: Value, access: Value, share: Value = "read") -> Stream:
    host, where = scope.session.host, text(path)
    refused(host, f"open {where}")
    how, wanted, shared = str(mode).lower(), _RIGHTS[str(access).lower()], _rights(str(share))
    if how == "createnew" and host.file(where):
        raise ScriptError(f"The file '{where}' already exists.", error_id="IOException", kind="System.IO.IOException")
    if how == "open" and host.file(where) is None:
        raise missing(where)
    if how not in ("open", "openorcreate", "createnew"):
        raise Unsupported(f"a file opened with {how}")
    return Stream(host, where, wanted, shared)


_RIGHTS = {"read": READ, "write": WRITE, "readwrite": READ_WRITE, "delete": DELETE, "none": frozenset[str]()}


def _rights(words: str) -> frozenset[str]:
    """The flags of a list with commas."""
    return frozenset[str]().union(*(_RIGHTS[word.strip().lower()] for word in words.split(",")))


class ByteReader(Thing):
    """What reads a stream byte by byte."""

    def __init__(self, stream: Stream) -> None:
        super().__init__()
        self.stream = stream

    def do_readbytes(self, count: Value) -> bytes:
        begin = self.stream.position
        self.stream.position += number(count)
        return self.stream.data[begin : self.stream.position]


def _identity(scope: Scope) -> Thing:
    return Thing()


def _equals(scope: Scope, left: Value, right: Value, how: Value) -> bool:
    if str(how) == "OrdinalIgnoreCase":
        return text(left).upper() == text(right).upper()
    return bool(text(left) == text(right))


def _write_entry(scope: Scope, source: Value, says: Value, kind: Value, number_: Value) -> Value:
    """An entry of a source that is not known yet makes it known, where the caller may."""
    host = scope.session.host
    assert text(source) == "rarms"
    assert text(kind) in ("Information", "Warning", "Error")
    if host.event_log is None or not host.elevated:
        raise ScriptError("The source was not found, but some or all event logs could not be searched.")
    if not 0 < len(text(says)) <= LONGEST_ENTRY:
        raise ScriptError("Log entry string is too long.")
    host.event_log.append((text(kind), number(number_), text(says)))
    return EMPTY


LONGEST_ENTRY = 31_839

_CALLS: dict[tuple[str, str], Callable[..., Value]] = {
    ("diagnostics.eventlog", "writeentry"): _write_entry,
    ("regex", "replace"): _regex_replace,
    ("io.file", "getattributes"): _attributes,
    ("io.file", "readallbytes"): content,
    ("wildcardpattern", "escape"): lambda scope, value: re.sub(r"([*?[\]`])", r"`\1", text(value)),
    ("io.file", "exists"): lambda scope, path: _is_file(scope.session.host, text(path)),
    ("environment", "getfolderpath"): _folder,
    ("io.file", "replace"): _replace,
    ("io.file", "move"): _move,
    ("io.file", "delete"): _delete,
    ("io.directory", "createdirectory"): _make_folder,
    ("io.directory", "delete"): _delete_folder,
    ("io.filestream", "new"): _new_stream,
    ("io.binaryreader", "new"): lambda scope, stream: ByteReader(stream),
    ("text.encoding", "getencoding"): _encoding,
    ("byte[]", "new"): lambda scope, size: [0] * number(size),
    ("security.cryptography.sha256", "create"): lambda scope: Sha256(),
    ("bitconverter", "tostring"): lambda scope, data: "-".join(f"{byte:02X}" for byte in bytes(data)),
    ("array", "sort"): _sort,
    ("hashtable", "new"): lambda scope, *given: Table(*(table.items() for table in given[:-1]), ordinal=True),
    ("string", "equals"): _equals,
    ("management.automation.pscredential", "new"): lambda scope, user, password: Record(
        UserName=text(user), Secret=password.get("Secret")
    ),
    ("convert", "frombase64string"): lambda scope, value: b64decode(text(value)),
    **guests.CALLS,
    ("security.principal.windowsidentity", "getcurrent"): _identity,
    ("security.principal.securityidentifier", "new"): lambda scope, sid: text(sid),
    ("security.principal.windowsprincipal", "new"): lambda scope, identity: Principal(scope),
}
