"""Machines alike stand as rows of a table, and mean the same as their blocks one after another."""

import random
from dataclasses import replace

import pytest

from rarms_iac.model.changes import Change
from rarms_iac.powershell.inspection.inspect import inspect, inspect_recorded
from rarms_iac.powershell.outline import ScriptStep, outline
from rarms_iac.powershell.render import render_scripts
from rarms_iac.powershell.rows import PlanBlock, plan_lines
from rarms_iac.powershell.templates import StepText, shipped_module
from tests import builders_plan as build
from tests.builders import codes
from tests.unit.powershell.mutations import IN_THE_PLAN
from tests.unit.powershell.plans import marked, rendered_plan

NAMES = ("arm", "o'hare", "Zo\u00eb", "count")
"""Partitions alike; what a hostile plan file could call them."""

APPLY, UNDO = "onboard.ps1", "onboard.undo.ps1"


def creation(name: str) -> Change:
    return build.create(marked(replace(build.partition(build.settings(name, running=False)), id="")))


def changed(name: str, number: int) -> Change:
    old, new = (build.partition(build.settings(name, reserve=reserve)) for reserve in (70, 40 - number))
    change = build.update(old, marked(new))
    return replace(change, address=replace(change.address, machine=f"id-of-{number}"))


CHANGES = {
    "made": [creation(name) for name in NAMES],
    "changed": [changed(name, number) for number, name in enumerate(NAMES)],
}


def scripts_of(changes: list[Change]) -> dict[str, str]:
    return {name: text.decode("ascii") for name, text in render_scripts(*rendered_plan(changes)).items()}


def steps_of(script: str) -> list[ScriptStep]:
    """Without their numbers, which differ where a script has others before them."""
    return [replace(step, number=0, undoes=None) for step in outline(script.encode("ascii")).steps]


@pytest.mark.parametrize("kind", CHANGES)
@pytest.mark.parametrize("name", [APPLY, UNDO])
def test_a_table_means_what_its_rows_mean_alone(kind: str, name: str) -> None:
    script = scripts_of(CHANGES[kind])[name]
    order = CHANGES[kind] if name == APPLY else CHANGES[kind][::-1]

    assert script.count("foreach ($row in $rows) {") == 1
    assert steps_of(script) == [step for change in order for step in steps_of(scripts_of([change])[name])]


def test_each_row_of_an_undo_takes_back_its_own_step() -> None:
    scripts = scripts_of(CHANGES["changed"])
    done = outline(scripts[APPLY].encode("ascii")).steps
    undone = outline(scripts[UNDO].encode("ascii")).steps

    assert [step.number for step in undone] == list(range(len(NAMES)))
    assert [done[step.undoes].address for step in undone if step.undoes is not None] == [
        step.address for step in undone
    ]


@pytest.mark.parametrize("kind", CHANGES)
@pytest.mark.parametrize("name", [APPLY, UNDO])
def test_scripts_with_rows_pass_the_inspection_and_their_mutants_do_not(kind: str, name: str) -> None:
    script = scripts_of(CHANGES[kind])[name]
    assert inspect(script.encode("ascii")) == ()
    assert inspect_recorded(script.encode("ascii"), name, shipped_module()) == ()
    pick = random.Random(7)

    mutants = {told: mutate(script, pick) for told, mutate in IN_THE_PLAN.items()}

    assert [told for told, mutant in mutants.items() if mutant and not inspect(mutant.encode("utf-8"))] == []


EDITS = {
    "a row without a column": ("Mark = 'robot/arm'", "Marc = 'robot/arm'"),
    "a column without a row": ("Row.Machine", "Row.Other"),
    "a loop's variable in a block": ("$script:Row.Machine", "$row.Machine"),
    "a later variable in a table": ("reserve = $row.NewReserve", "reserve = $script:Row.NewReserve"),
    "a row that is not handed on": (" -Row $row", ""),
    "another row": (" -Row $row", " -Row $rows"),
    "another table": ("in $rows", "in $script:Rows"),
    "a table in two": ("    foreach ($row", "    $rows = @()\r\n    foreach ($row"),
    "a loop without a table": ("    $rows = @(", "    $more = @("),
    "a value that is computed": ("Reserve = 40", "Reserve = (20 + 20)"),
    "a value that is called": ("Reserve = 40", "Reserve = $(Hyper-V\\Get-VM)"),
    "a column of a column": ("$script:Row.Machine", "$script:Row.Machine.Length"),
    "a method of a column": ("$row.Address ", "$row.Address.Trim() "),
    "a statement more": ("        Add-Step", "        Hyper-V\\Get-VM\r\n        Add-Step"),
    "a step that leaves the loop": ("        Add-Step", "        break\r\n        Add-Step"),
}


@pytest.mark.parametrize("edit", EDITS)
def test_a_table_of_another_form_is_refused(edit: str) -> None:
    script = scripts_of(CHANGES["changed"])[APPLY]
    old, new = EDITS[edit]
    assert old in script

    edited = script.replace(old, new, 1).encode("ascii")

    assert codes(inspect(edited)) == ["RARMS211"]
    assert codes(inspect_recorded(edited, APPLY, shipped_module())) == ["RARMS211"]


def test_a_table_stands_where_it_is_shorter_alone() -> None:
    few = scripts_of(CHANGES["changed"][:1])[APPLY]

    assert "$rows" not in few


def test_a_table_whose_blocks_have_no_banner_says_what_its_steps_do() -> None:
    def lines(*actions: str) -> list[str]:
        blocks = (
            PlanBlock(
                owner=f"part-{at}",
                reason="",
                action=action,
                place="",
                is_first=False,
                statements=tuple(
                    StepText(action=f"'{action}'", same={}, before={}, after={}, calls=(f"Stop-VM -Name 'part-{at}'",))
                    for _ in range(3)
                ),
            )
            for at, action in enumerate(actions)
        )
        return list(plan_lines(blocks))

    assert lines(*["stop it"] * 6)[0].startswith("    # === part-0 and 5 more alike: stop it =")
    assert lines(*map(str, range(6)))[0].startswith("    # === part-0 and 5 more alike: as each row says =")
