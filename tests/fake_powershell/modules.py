"""Modules of PowerShell: a scope of their own, whose functions and preferences no caller's names reach."""

from __future__ import annotations

import re
from collections.abc import Mapping
from fnmatch import fnmatch

from tests.fake_powershell.compiling import compiled
from tests.fake_powershell.dotnet import content
from tests.fake_powershell.scopes import Block, Function, FunctionInfo, Scope
from tests.fake_powershell.signing import why_unsigned
from tests.fake_powershell.values import EMPTY, Enumerated, Record, ScriptError, Table, Thing, Unsupported, Value, text

Given = Mapping[str, Value]


class Module(Thing):
    """What `Import-Module -PassThru` and `New-Module` give."""

    type_name = "System.Management.Automation.PSModuleInfo"

    def __init__(self, scope: Scope, name: str, path: str, version: str) -> None:
        super().__init__(Name=name, Path=path, Version=version, ExportedFunctions=Table())
        self.scope = Scope.of_module(scope.session, global_of(scope), self)
        self.named: list[str] | None = None  # by Export-ModuleMember

    def do_newboundscriptblock(self, block: Value) -> Block:
        assert isinstance(block, Block)
        return Block(block.function, self.scope.state)

    def run(self, function: Function) -> None:
        """Run its definitions, in its own scope; what they give goes nowhere."""
        session = self.scope.session
        before, session.state = session.state, self.scope.state
        try:
            function.body(self.scope, [])
        finally:
            session.state = before

    def export(self, names: list[str] | None) -> None:
        """These functions, as far as they are defined; all of them where no names are given."""
        exported = self.properties["ExportedFunctions"]
        named = list(self.scope.functions) if self.named is None else self.named
        for name in named if names is None else [name for name in names if name in named or self.named is None]:
            if (found := self.scope.functions.get(name.lower())) is not None:
                exported.put(found.function.name, found)


def global_of(scope: Scope) -> Scope:
    """The global scope of the session."""
    return [*scope.above()][-1]


def import_module(scope: Scope, given: Given) -> Value:
    """`Import-Module -Name PATH`: of a `.psd1` with its `.psm1` beside it, or of a `.psm1`."""
    path = _without_escapes(text(given["name"]))
    module = _loaded(scope, path)
    wanted = text(given.get("function", "*")).lower()
    for name, function in module.get("ExportedFunctions").items():
        if not fnmatch(text(name).lower(), wanted):
            continue
        global_of(scope).functions[text(name).lower()] = function
    return module if given.get("passthru") else EMPTY


def _without_escapes(pattern: str) -> str:
    """The one path that the pattern stands for: `-Name` takes patterns."""
    if re.search(r"(?<!`)[*?[\]]", pattern):
        raise ScriptError(f"The specified module '{pattern}' was not loaded.", error_id="Modules_ModuleNotFound")
    return re.sub("`(.)", r"\1", pattern)


def _loaded(scope: Scope, path: str) -> Module:
    if path.lower().endswith(".psm1"):
        module = Module(scope, _stem(path), path, "0.0")
        _define(scope, module, path)
        module.export(None)
        return module
    if not path.lower().endswith(".psd1"):
        raise Unsupported(f"a module without its path: {path}")
    held: list[Value] = []
    compiled(_readable(scope, path)).body(Scope(scope.session, None), held)
    (manifest,) = held
    root = path.rpartition("\\")[0] + "\\" + text(manifest.at("RootModule"))
    module = Module(scope, _stem(path), root, text(manifest.at("ModuleVersion")))
    _define(scope, module, root)
    module.export([text(name) for name in manifest.at("FunctionsToExport")])
    return module


def _stem(path: str) -> str:
    return path.rpartition("\\")[2].rpartition(".")[0]


def _define(scope: Scope, module: Module, path: str) -> None:
    module.scope.variables |= {"pscommandpath": path, "psscriptroot": path.rpartition("\\")[0]}
    module.run(compiled(_readable(scope, path)))


def _readable(scope: Scope, path: str) -> bytes:
    data = content(scope, path)
    if scope.session.host.all_signed and (refusal := why_unsigned(data)):
        raise ScriptError(f"File {path} cannot be loaded. {refusal}", error_id="UnauthorizedAccess")
    return data


def new_module(scope: Scope, given: Given) -> Module:
    """`New-Module -Name NAME -ScriptBlock { }`: exports all its functions."""
    block = given["scriptblock"]
    assert isinstance(block, Block)
    module = Module(scope, text(given["name"]), "", "0.0")
    # The file in which its functions stand is the script.
    module.scope.variables |= {name: scope.read(name) for name in ("pscommandpath", "psscriptroot")}
    module.run(block.function)
    module.export(None)
    return module


def export_module_member(scope: Scope, given: Given) -> Value:
    """`Export-ModuleMember -Function NAMES`, while the module's definitions run."""
    module, names = scope.state.module, given["function"]
    if not isinstance(module, Module):
        raise ScriptError("The Export-ModuleMember cmdlet can only be called from inside a module.")
    module.named = [text(name) for name in (names if isinstance(names, list) else [names])]
    return EMPTY


class Version(Thing):
    """Of a module."""

    type_name = "System.Version"

    def __init__(self, written: str) -> None:
        super().__init__(Major=int(written.partition(".")[0]))
        self.written = written

    def __str__(self) -> str:
        return self.written


def get_command(scope: Scope, given: Given) -> Value:
    """`Get-Command -Name` of Hyper-V's own, or `-CommandType Function -Module NAME`."""
    if "module" not in given:
        kind = "Cmdlet" if scope.session.host.loads_hyperv else "Function"
        return Record(CommandType=Enumerated(kind), Version=Version(scope.session.host.module[-1]))
    if text(given["commandtype"]) != "Function":
        raise Unsupported("Get-Command of a module, but for functions")
    wanted = text(given["module"])
    return [found for found in _seen(scope) if (module := found.get("Module")) and module.get("Name") == wanted]


def _seen(scope: Scope) -> list[FunctionInfo]:
    found: dict[str, FunctionInfo] = {}
    for at in scope.above():
        found = at.functions | found
    return [found[name] for name in sorted(found)]


def get_alias(scope: Scope, given: Given) -> Value:
    """The caller's aliases of these names; without one it is an error, unless that is ignored."""
    names = given["name"] if isinstance(given["name"], list) else [given["name"]]
    aliases = scope.session.host.aliases
    missing = [text(name) for name in names if text(name).lower() not in aliases]
    if missing and text(given.get("erroraction", "Stop")) != "Ignore":
        raise ScriptError(f"This command cannot find a matching alias because {missing[0]} has none.")
    return [
        Record(Name=text(name).lower(), Definition=aliases[text(name).lower()])
        for name in names
        if text(name).lower() in aliases
    ]
