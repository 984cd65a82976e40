"""What an operation makes of a machine, and its way back."""

from dataclasses import replace
from typing import Any

import pytest

from rarms_iac.model.operation_effects import applied, partition_after, reverse
from rarms_iac.model.operations import (
    EraseMark,
    MachineOperation,
    RemovePartition,
    RenamePartition,
    SetActions,
    SetCpu,
    SetMemory,
    SetProcessors,
    SetSecureBoot,
    StartPartition,
    StopPartition,
    WriteMark,
)
from rarms_iac.model.state import Checkpoints, Mark, RunState, StartAction, StopAction, StoppedBy
from tests import builders_plan as build

HERE: dict[str, Any] = {"partition": "vision", "machine": "0a1b2c3d-vm"}
NEW = Mark(application="robot", name="vision", machine="0a1b2c3d", set="0" * 12, stopped_by=StoppedBy.USER)
OLD = replace(NEW, name="eyes", set="1" * 12, stopped_by=StoppedBy.NO_USER)

SETTINGS: tuple[tuple[MachineOperation, dict[str, Any]], ...] = (
    (RenamePartition(name="eyes", **HERE), {"name": "eyes"}),
    (SetProcessors(processors=3, **HERE), {"processors": 3}),
    (
        SetCpu(reserve=41, limit=82, weight=300, quota_period_us=8_000, **HERE),
        {"reserve": 41, "limit": 82, "weight": 300, "quota_period_us": 8_000},
    ),
    (SetMemory(memory=7, dynamic=True, **HERE), {"memory": 7, "dynamic_memory": True}),
    (SetActions(stop=StopAction.SAVE, **HERE), {"stop_action": StopAction.SAVE}),
    (
        SetActions(start=StartAction.NOTHING, checkpoints=Checkpoints.STANDARD, **HERE),
        {"start_action": StartAction.NOTHING, "checkpoints": Checkpoints.STANDARD},
    ),
    (SetSecureBoot(secure_boot="off", **HERE), {"secure_boot": "off"}),
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

    back = reverse(operation, before)

    assert back is not None
    assert partition_after(partition_after(before, operation), back) == before  # type: ignore[arg-type]  # on a machine


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
