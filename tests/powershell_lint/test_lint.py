"""The templates, filled with each operation, hold what the package does not look at again when a script is made."""

from dataclasses import replace
from typing import get_args

import pytest

from rarms_iac.model.changes import Change, Create
from rarms_iac.model.operations import Operation, RestorePartition
from rarms_iac.model.state import Partition, Tie
from rarms_iac.powershell.literals import unreadable
from rarms_iac.powershell.render import render_observe, render_scripts
from rarms_iac.powershell.templates import ENTRY, MEASURING_ENTRY, ScriptForm, module_text, template_text
from rarms_iac.providers.hyperv.transport import render_installed_receiver, render_loader, render_receiver
from tests.powershell_lint import allowed
from tests.powershell_lint.allowed import PLAN_CALLS
from tests.powershell_lint.filled import HOST_PLAN, everything, measuring_script, scripts
from tests.powershell_lint.lint import problems
from tests.powershell_lint.tree import calls_of, parse, plan_of, text_of, walk
from tests.unit.powershell.plans import all_changes, rendered_plan

SCRIPTS = {name: text.decode("ascii") for name, text in scripts().items()}


def test_every_operation_is_among_those_that_fill_templates() -> None:
    forward = {type(step.operation) for step in HOST_PLAN.steps}
    back = {type(step.undo.operation) for step in HOST_PLAN.steps}

    assert set(get_args(Operation)) - {RestorePartition} <= forward | back, "Hyper-V makes no machine again"


@pytest.mark.parametrize("name", sorted(SCRIPTS))
def test_a_script_of_a_plan(name: str) -> None:
    single = scripts(ScriptForm.SINGLE)[name]

    assert unreadable(SCRIPTS[name].encode("ascii"), name) == ()
    assert unreadable(single, name) == ()
    assert problems(single.decode("ascii")) == []  # with the functions that it calls


def test_a_script_that_measures() -> None:
    script = measuring_script()

    assert unreadable(script, "cell.measure.ps1") == ()
    assert problems(script.decode("ascii")) == []


@pytest.mark.parametrize(
    ("script", "line", "reason"),
    [
        (b"$x = 1\r\n$y = '\xe9'\r\n", 2, "0xe9 is not printable ASCII"),
        (b"$x = 1\r\n$y = 2\n", 2, "does not end with CR LF"),
        (b"$x = (1\r\n", 1, "grammar"),
    ],
)
def test_unreadable_script_names_its_line(script: bytes, line: int, reason: str) -> None:
    (found,) = unreadable(script, "cell.ps1")

    assert (found.code, found.place and found.place.line) == ("RARMS251", line)
    assert reason in found.detail


def test_the_module() -> None:
    assert problems(template_text("Rarms/Rarms.psm1")) == []
    assert problems(module_text(ScriptForm.MODULE) + "\n$rarms\n") == []


@pytest.mark.parametrize("entry", [ENTRY, MEASURING_ENTRY])
def test_a_module_that_a_script_holds(entry: str) -> None:
    assert problems(module_text(ScriptForm.SINGLE, entry) + "\n$rarms, $folder\n") == []


def test_the_script_that_observes_only_reads() -> None:
    assert problems(render_observe().decode("ascii"), reading=True) == []


def test_the_receiver() -> None:
    assert problems(render_receiver().decode("ascii")) == []
    assert problems(render_installed_receiver().decode("ascii")) == []


def test_loader_breaks_one_rule_only() -> None:
    found = sorted(problem.partition(": ")[2] for problem in problems(render_loader().decode("ascii")))

    assert [problem.partition(" ([")[0] for problem in found] == ["& runs"]


def of_a_cluster() -> list[Change]:
    """All changes, of machines that a failover cluster has too."""
    return [
        replace(change, before=replace(change.before, ties=(Tie.CLUSTER,)))
        if isinstance(change.before, Partition) and not isinstance(change, Create)
        else change
        for change in all_changes()
    ]


def test_plans_call_only_what_rarms_writes() -> None:
    called: dict[str, set[str]] = {}
    clustered = [text.decode("ascii") for text in render_scripts(*rendered_plan(of_a_cluster())).values()]
    for script in (*SCRIPTS.values(), *clustered, measuring_script().decode("ascii")):
        for call in calls_of(parse(plan_of(script))):
            called[call.name] = called.get(call.name, set()) | set(call.given)

    assert called == PLAN_CALLS


LISTS = {
    "type_spec": (allowed.TYPES, allowed.READING_TYPES),
    "member_name": (allowed.MEMBERS, allowed.READING_MEMBERS),
    "command_name_expr": (allowed.BLOCKS, frozenset[str]()),
    "variable": (allowed.VARIABLES, frozenset[str]()),
    "assignment_expression": (allowed.PINS, frozenset[str]()),
}
"""What all scripts and what observe.ps1 may have, by the kind of node."""


@pytest.mark.parametrize("reading", [False, True])
def test_lists_permit_only_what_scripts_have(reading: bool) -> None:
    texts = [render_observe()] if reading else [*everything().values(), *scripts(ScriptForm.SINGLE).values()]
    more = [] if reading else render_scripts(*rendered_plan(of_a_cluster())).values()
    trees = [parse(text.decode("ascii")) for text in (*texts, *more)]
    nodes = [node for tree in trees for node in walk(tree)]
    unused = {
        kind: lists[reading] - {text_of(node) for node in nodes if node.type == kind} for kind, lists in LISTS.items()
    }
    cmdlets = allowed.READING_CMDLETS if reading else allowed.CMDLETS
    unused["command"] = cmdlets - {call.name for tree in trees for call in calls_of(tree)}
    unused["construct"] = (frozenset() if reading else allowed.CONSTRUCTS) - {node.type for node in nodes}

    assert {kind: names for kind, names in unused.items() if names} == {}


BAD = {
    "a parameter misspelt": "Hyper-V\\Get-VMProcessor -VN $x",
    "a parameter shortened": "Hyper-V\\Set-VMProcessor -VM $x -Reserv 5",
    "a parameter in another case": "Hyper-V\\Set-VMProcessor -VM $x -reserve 5",
    "an alias of a parameter": "Hyper-V\\Get-VM -VMName 'x'",
    "a parameter that 7 lacks": "Get-Item -LiteralPath 'x' -UseTransaction",
    "a parameter that 5.1 lacks": "ConvertTo-Json -InputObject $x -AsArray",
    "a value without a name": "Hyper-V\\Get-VM 'x'",
    "a switch with a value": "Hyper-V\\Remove-VM -Force 'x'",
    "a cmdlet without its module": "Get-VM -Name 'x'",
    "a cmdlet that is not needed": "Restart-Computer -Force",
    "a line joined": "Get-Item `\n-LiteralPath 'x'",
    "a character that is hidden": "Get-It`em -LiteralPath 'x'",
    "an alias": "gci -LiteralPath 'x'",
    "a program": "cmd /c del x",
    "a block from text": "[scriptblock]::Create('x')",
    "& on a string": "& 'calc.exe'",
    "dot-sourcing": ". 'C:\\x.ps1'",
    "a redirection": "Get-Item -LiteralPath 'x' > 'y'",
    "splatting": "Hyper-V\\Get-VM @args",
    "text that is expanded": '$x = "a $y"; $x',
    "a member by a value": "$_.('Del' + 'ete')()",
    "a member": "$_.DeleteSubKeyTree('x')",
    "a type": "[System.Net.WebClient]::new()",
    "an operator": "$x = 5 -shl 2; $x",
    "a variable of PowerShell": "$WhatIfPreference = $true",
    "another scope": "$global:x = 1",
    "a variable of nobody": "Test-Path -LiteralPath $nowhere",
    "a trap": "trap { continue }",
    "a class": "class X { }",
    "a function over a cmdlet": "function Get-Item { 1 }",
    "text that is compared by culture": "if ([string] $x -eq 'y') { 1 }",
    "a pattern by culture": "$x -replace 'i', 'j'",
    "lower case by culture": "$x.ToLower()",
    "a key that would be emptied": "New-Item -Path 'x' -Force",
    "keys that would be removed": "Remove-Item -LiteralPath 'x' -Recurse",
    "a function's parameter misspelt": "function Read-It {\n    param($Name)\n    $Name\n}\nRead-It -Nam 'x'",
}


@pytest.mark.parametrize("text", BAD.values(), ids=BAD)
def test_forbidden_powershell_is_found(text: str) -> None:
    assert problems(f"$x = 5; Test-Path -LiteralPath $x\n{text}\n") != []


@pytest.mark.parametrize(
    "text",
    [
        "Hyper-V\\Start-VM -Name 'x'",
        "New-Item -Path 'HKLM:\\SOFTWARE\\x'",
        "[System.IO.Directory]::CreateDirectory('x')",
        "[System.IO.File]::WriteAllBytes('x', 'y')",
    ],
)
def test_what_changes_something_is_no_reading(text: str) -> None:
    assert problems(f"{text}\n") == []
    assert problems(f"{text}\n", reading=True) != []
