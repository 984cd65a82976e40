"""A plan's id says what it does, and not from where it was made."""

from dataclasses import replace

import pytest

from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, Place, Severity
from rarms_iac.model.plan import Plan
from rarms_iac.storage.plan_file import plan_id
from tests.builders_plan import because, create, host_plan, partition, plan, settings


def made_from(folder: str) -> Plan:
    """The plan as it is made when the manifest lies in this folder, seen from where `rarms` is called."""
    place = Place(file=f"{folder}rarms.yaml", line=3, column=5)
    note = Diagnostic(
        code="RARMS086",
        severity=Severity.NOTE,
        summary="An entry is not used",
        detail="It is not named.",
        advice=prose("Measure with it: ", command("measure", f=folder or ".")),
        place=place,
    )
    change = create(partition(settings()), because(file=place.file))
    return replace(plan(host_plan(changes=[change])), manifest=place.file, findings=(note,))


@pytest.mark.parametrize("folder", ["robot/", "../robot/", "/srv/robot/"])
def test_same_plan_has_same_id_from_every_folder(folder: str) -> None:
    assert plan_id(made_from(folder)) == plan_id(made_from(""))


def test_another_line_of_the_manifest_is_another_plan() -> None:
    moved = create(partition(settings()), because(line=32))

    assert plan_id(plan(host_plan(changes=[moved]))) != plan_id(made_from(""))
