"""What an operation makes of a machine, and its way back."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from rarms_iac.model.facets import Facet, setting_values
from rarms_iac.model.operation_effects import applied, partition_after, reverse
from rarms_iac.model.operations import (
    EraseMark,
    MachineOperation,
    RemovePartition,
    RenamePartition,
    Set,
    StartPartition,
    StopPartition,
    WriteMark,
    set_to,
)
from rarms_iac.model.plan import Step
from rarms_iac.model.state import Checkpoints, Mark, PartitionSettings, RunState, StartAction, StopAction, StoppedBy
from rarms_iac.powershell.render import render_scripts
from rarms_iac.storage.codec import NotDecodable, decode
from rarms_iac.texts.plans import reversal_title
from tests import builders_plan as build
from tests.unit.powershell.plans import marked, rendered_plan

HERE: dict[str, Any] = {"partition": "vision", "machine": "0a1b2c3d-vm"}
NEW = Mark(application="robot", name="vision", machine="0a1b2c3d", set="0" * 12, stopped_by=StoppedBy.USER)
OLD = replace(NEW, name="eyes", set="1" * 12, stopped_by=StoppedBy.NO_USER)

SETTINGS: tuple[tuple[MachineOperation, dict[str, Any]], ...] = (
    (RenamePartition(name="eyes", **HERE), {"name": "eyes"}),
    (set_to(processors=3, **HERE), {"processors": 3}),
    (
        set_to(reserve=41, limit=82, weight=300, quota_period_us=8_000, **HERE),
        {"reserve": 41, "limit": 82, "weight": 300, "quota_period_us": 8_000},
    ),
    (set_to(memory=7, dynamic_memory=True, **HERE), {"memory": 7, "dynamic_memory": True}),
    (set_to(stop_action=StopAction.SAVE, **HERE), {"stop_action": StopAction.SAVE}),
    (
        set_to(start_action=StartAction.NOTHING, checkpoints=Checkpoints.STANDARD, **HERE),
        {"start_action": StartAction.NOTHING, "checkpoints": Checkpoints.STANDARD},
    ),
    (set_to(secure_boot="off", **HERE), {"secure_boot": "off"}),
    (StopPartition(grace_ms=5, **HERE), {"running": False}),
    (WriteMark(application="robot", name="vision", set="0" * 12, **HERE), {}),
)


@pytest.mark.parametrize(("operation", "changes"), SETTINGS)
def test_operation_changes_what_it_names_and_nothing_else(operation: MachineOperation, changes: dict[str, Any]) -> None:
    before = replace(build.settings("vision"), secure_boot="MicrosoftWindows")

    assert applied(before, operation) == replace(before, **changes)


@pytest.mark.parametrize("mark", [None, OLD])
@pytest.mark.parametrize(
    "operation", [*(operation for operation, _ in SETTINGS), StartPartition(**HERE), EraseMark(**HERE)]
)
def test_the_way_back_leads_to_what_was_there(operation: MachineOperation, mark: Mark | None) -> None:
    settings = replace(
        build.settings("vision", running=not isinstance(operation, StartPartition)), secure_boot="MicrosoftWindows"
    )
    before = replace(build.partition(settings), id="0a1b2c3d-vm", mark=mark)
    if isinstance(operation, Set):
        operation = replace(operation, before=setting_values(settings, operation.after))

    back = reverse(operation, before)

    assert back is not None
    assert partition_after(partition_after(before, operation), back) == before  # type: ignore[arg-type]  # on a machine


@pytest.mark.parametrize(
    "values", [{"memory": 7}, {"reserve": 40, "running": True}, {"reserve": "40"}, {"limit": True}]
)
def test_set_takes_only_values_of_its_facet(values: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"is not a setting of cpu|not of type int"):
        Set(facet=Facet.CPU, after=values, **HERE)


def test_read_set_refuses_other_settings() -> None:
    data = {"kind": "set", "partition": "vision", "facet": "actions", "after": {"stop_action": "save"}}

    assert decode(Set, data) == set_to("vision", stop_action=StopAction.SAVE)
    with pytest.raises(NotDecodable, match="'explode' is not a valid StopAction"):
        decode(Set, {**data, "after": {"stop_action": "explode"}})


def test_machine_gets_its_own_id_into_its_mark() -> None:
    writing = WriteMark(application="robot", name="vision", set="0" * 12, stopped_by=StoppedBy.USER, **HERE)

    assert partition_after(replace(build.partition(), id="0a1b2c3d-vm", mark=OLD), writing).mark == NEW


def test_what_cannot_come_back_has_no_way_back() -> None:
    running = build.partition()
    paused = replace(running, settings=replace(running.settings, running=False), state=RunState.PAUSED)

    assert reverse(RemovePartition(**HERE), running) is None
    assert reverse(StopPartition(grace_ms=0, **HERE), paused) is None


def test_undo_of_start_keeps_the_grace() -> None:
    off = build.partition(build.settings(running=False))

    assert reverse(StartPartition(**HERE), off, grace_ms=7) == StopPartition(grace_ms=7, **HERE)


BEFORE = build.settings("vision", reserve=80, processors=2, ram="1 GiB", running=False)
CHANGED: Mapping[str, tuple[PartitionSettings, str, str]] = {
    "reserve": (
        replace(BEFORE, reserve=40),
        "reserve 1.6 -> 0.8 LP (80 -> 40 % of each of 2 processors)",
        "reserve 0.8 -> 1.6 LP (40 -> 80 % of each of 2 processors)",
    ),
    "weight and limit": (
        replace(BEFORE, limit=90, weight=200),
        f"limit {BEFORE.limit} -> 90 % of each of 2 processors, weight {BEFORE.weight} -> 200",
        f"limit 90 -> {BEFORE.limit} % of each of 2 processors, weight 200 -> {BEFORE.weight}",
    ),
    "processors": (replace(BEFORE, processors=1), "processors 2 -> 1", "processors 1 -> 2"),
    "memory": (replace(BEFORE, memory=2**31), "memory 1 GiB -> 2 GiB", "memory 2 GiB -> 1 GiB"),
    "name": (replace(BEFORE, name="eyes"), "name vision -> eyes", "name eyes -> vision"),
}


def steps_for(new: PartitionSettings) -> tuple[list[Step], list[Step]]:
    """The steps that set this, but for the mark, and those that take them back."""
    host_plan, _ = rendered_plan([build.update(build.partition(BEFORE), marked(build.partition(new)))])
    steps = [step for step in host_plan.steps if "mark" not in step.after]
    return steps, [step.reversed(reversal_title(step, host_plan.changes_by_address)) for step in reversed(steps)]


@pytest.mark.parametrize("setting", CHANGED)
def test_reversed_step_says_from_and_to(setting: str) -> None:
    new, there, back = CHANGED[setting]

    done, undone = steps_for(new)

    assert ([step.title for step in done], [step.title for step in undone]) == ([there], [back])


def test_dynamic_memory_is_named_again() -> None:
    dynamic = replace(BEFORE, dynamic_memory=True)
    host_plan, _ = rendered_plan([build.update(build.partition(dynamic), marked(build.partition(BEFORE)))])
    (step, *_) = host_plan.steps

    assert step.title == "dynamic memory yes -> no"
    assert reversal_title(step, host_plan.changes_by_address) == "dynamic memory no -> yes"


def test_undo_script_has_reserve_in_both_units() -> None:
    new, _, back = CHANGED["reserve"]
    change = build.update(build.partition(BEFORE), marked(build.partition(new)))
    known = replace(change, address=replace(change.address, machine="id-of-vision"))
    script = render_scripts(*rendered_plan([known]))["onboard.undo.ps1"].decode("ascii")

    assert script.count(f"    Add-Step -Action '{back}' ") == 1
    assert f"    vision  {back}\r\n" in script
