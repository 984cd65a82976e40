"""Titles of steps say from what to what, on the way there and on the way back."""

from collections.abc import Mapping
from dataclasses import replace

import pytest

from rarms_iac.model.plan import Step
from rarms_iac.model.state import PartitionSettings
from rarms_iac.model.step_titles import reversal
from rarms_iac.powershell.render import render_scripts
from tests import builders_plan as build
from tests.unit.powershell.plans import marked, rendered_plan

OLD = build.settings("vision", reserve=80, processors=2, ram="1 GiB", running=False)
CHANGED: Mapping[str, tuple[PartitionSettings, str, str]] = {
    "reserve": (
        replace(OLD, reserve=40),
        "reserve 1.6 -> 0.8 LP (80 -> 40 % of each of 2 processors)",
        "reserve 0.8 -> 1.6 LP (40 -> 80 % of each of 2 processors)",
    ),
    "weight and limit": (
        replace(OLD, limit=90, weight=200),
        f"limit {OLD.limit} -> 90 % of each of 2 processors, weight {OLD.weight} -> 200",
        f"limit 90 -> {OLD.limit} % of each of 2 processors, weight 200 -> {OLD.weight}",
    ),
    "processors": (replace(OLD, processors=1), "processors 2 -> 1", "processors 1 -> 2"),
    "memory": (replace(OLD, memory=2**31), "memory 1 GiB -> 2 GiB", "memory 2 GiB -> 1 GiB"),
    "name": (replace(OLD, name="eyes"), "name vision -> eyes", "name eyes -> vision"),
}


def steps_for(new: PartitionSettings) -> tuple[list[Step], list[Step]]:
    """The steps that set this, but for the mark, and those that take them back."""
    host_plan, _ = rendered_plan([build.update(build.partition(OLD), marked(build.partition(new)))])
    steps = [step for step in host_plan.steps if "mark" not in step.after]
    return steps, [reversal(step, host_plan.changes_by_address) for step in reversed(steps)]


@pytest.mark.parametrize("setting", CHANGED)
def test_reversed_step_says_from_and_to(setting: str) -> None:
    new, there, back = CHANGED[setting]

    done, undone = steps_for(new)

    assert ([step.title for step in done], [step.title for step in undone]) == ([there], [back])


def test_dynamic_memory_is_named_again() -> None:
    dynamic = replace(OLD, dynamic_memory=True)
    host_plan, _ = rendered_plan([build.update(build.partition(dynamic), marked(build.partition(OLD)))])
    (step, *_) = host_plan.steps

    assert step.title == "memory 1 GiB -> 1 GiB, static"
    assert reversal(step, host_plan.changes_by_address).title == "memory 1 GiB -> 1 GiB, dynamic"


def test_undo_script_has_reserve_in_both_units() -> None:
    new, _, back = CHANGED["reserve"]
    change = build.update(build.partition(OLD), marked(build.partition(new)))
    known = replace(change, address=replace(change.address, machine="id-of-vision"))
    script = render_scripts(*rendered_plan([known]))["onboard.undo.ps1"].decode("ascii")

    assert script.count(f"    Add-Step -Action '{back}' ") == 1
    assert f"    vision  {back}\r\n" in script
