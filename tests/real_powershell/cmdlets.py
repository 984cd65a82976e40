"""Compiled cmdlets, as text of C#: those of Hyper-V that the model knows, made from the lint's tables."""

from __future__ import annotations

from tests.fake_powershell import hyperv
from tests.powershell_lint.cmdlets import Cmdlet, Parameter, SetMembership, cmdlet

SPACE = "Microsoft.HyperV.PowerShell"
SIMPLE = {
    "String": "string",
    "Boolean": "bool",
    "Int16": "short",
    "Int32": "int",
    "Int64": "long",
    "UInt32": "uint",
    "UInt64": "ulong",
    "Guid": "System.Guid",
    "Version": "System.Version",
    "SwitchParameter": "SwitchParameter",
    "PSObject": "PSObject",
    "PSCredential": "PSCredential",
    "CimSession": "object",
    "CimInstance": "object",
}
BASES = {
    "VirtualMachine": "VirtualMachineBase",
    "VMSnapshot": "VirtualMachineBase",
    **dict.fromkeys(("HardDiskDrive", "VMProcessor", "VMMemory", "VMFirmware"), "VMComponentObject"),
    **dict.fromkeys(("VMIntegrationComponent", "VMNetworkAdapterBase"), "VMComponentObject"),
    "VMNetworkAdapter": "VMNetworkAdapterBase",
}
"""What the tables do not say: which objects a parameter of a type takes, too."""

MANIFEST = """@{{ RootModule = 'RarmsModel.dll'; ModuleVersion = '2.0.0.0'; GUID = '{guid}'
CmdletsToExport = {cmdlets}; FunctionsToExport = @(); AliasesToExport = @(); VariablesToExport = @() }}
"""
GUIDS = {
    "RarmsModel": "6f0d9a51-4f3c-4f6e-9a51-3f6a5f1c0001",
    "Hyper-V": "6f0d9a51-4f3c-4f6e-9a51-3f6a5f1c0002",
    "FailoverClusters": "6f0d9a51-4f3c-4f6e-9a51-3f6a5f1c0003",
}
AROUND = (
    *("Start-Sleep", "Out-Model", "Get-WinEvent", "Get-ExecutionPolicy", "Get-Acl", "Set-Acl", "Get-CimInstance"),
    *("New-PSSession", "Remove-PSSession", "Invoke-Command", "Receive-Job", "Remove-Job"),
    *("New-Item", "New-ItemProperty", "Remove-ItemProperty", "Remove-Item"),
)
"""Cmdlets that are written by hand."""


def modelled() -> list[Cmdlet]:
    """The cmdlets of Hyper-V and of its cluster that the model knows."""
    found = [cmdlet(name) for name in sorted(hyperv.CMDLETS)]
    assert all(found)
    return [one for one in found if one]


def manifests() -> dict[str, str]:
    """The text of each module's manifest, by its name."""
    names = {module: [one.name for one in modelled() if one.module == module] for module in GUIDS}
    names["RarmsModel"] = list(AROUND)
    return {
        module: MANIFEST.format(guid=guid, cmdlets=", ".join(f"'{name}'" for name in names[module]))
        for module, guid in GUIDS.items()
    }


def source() -> str:
    """The text of C#: the cmdlets, and the classes of their parameters."""
    classes = {
        parameter.type.removesuffix("[]")
        for one in modelled()
        for parameter in one.parameters.values()
        if not parameter.accepted and parameter.type.removesuffix("[]") not in SIMPLE
    }
    classes |= {*BASES, *BASES.values()}
    lines = ["using System.Management.Automation;", f"namespace {SPACE} {{"]
    lines += [f"public class {name} : {BASES.get(name, 'RarmsTests.LiveObject')} {{ }}" for name in sorted(classes)]
    lines += ["}", f"namespace {SPACE}.Commands {{"]
    lines += [line for one in modelled() for line in _cmdlet(one)]
    return "\n".join([*lines, "}", ""])


def _cmdlet(one: Cmdlet) -> list[str]:
    verb, noun = one.name.split("-")
    marks = [f'"{verb}"', f'"{noun}"']
    if one.default_set:
        marks.append(f'DefaultParameterSetName = "{one.default_set}"')
    if one.should_process:
        marks.append("SupportsShouldProcess = true")
    lines = [f"[Cmdlet({', '.join(marks)})]", f"public sealed class {verb}{noun} : RarmsTests.ModelCmdlet {{"]
    given_by_powershell = ("WhatIf", "Confirm") if one.should_process else ()
    own = [parameter for parameter in one.parameters.values() if parameter.name not in given_by_powershell]
    lines += [f"    {' '.join(_marks(each))} public {_type(each)} {each.name} {{ get; set; }}" for each in own]
    return [*lines, "}"]


def _marks(parameter: Parameter) -> list[str]:
    marks = [f"[Parameter({', '.join(_in_set(name, how))})]" for name, how in parameter.sets.items()]
    if parameter.aliases:
        marks.append(f"[Alias({_quoted(parameter.aliases)})]")
    if parameter.accepted:
        marks.append(f"[ValidateSet({_quoted(parameter.accepted)})]")
    if parameter.not_empty:
        marks.append("[ValidateNotNullOrEmpty]")
    return marks


def _in_set(name: str, how: SetMembership) -> list[str]:
    words = [] if name == "__AllParameterSets" else [f'ParameterSetName = "{name}"']
    words += ["Mandatory = true"] if how.mandatory else []
    words += [f"Position = {how.position}"] if how.position is not None else []
    words += ["ValueFromPipeline = true"] if how.from_pipeline else []
    return words + (["ValueFromPipelineByPropertyName = true"] if how.from_property else [])


def _quoted(words: tuple[str, ...]) -> str:
    return ", ".join(f'"{word}"' for word in words)


def _type(parameter: Parameter) -> str:
    name = parameter.type.removesuffix("[]")
    many = "[]" if parameter.type.endswith("[]") else ""
    if parameter.accepted and name not in ("Int32", "UInt32", "Int16"):
        return "string" + many
    return SIMPLE.get(name, f"global::{SPACE}.{name}") + many
