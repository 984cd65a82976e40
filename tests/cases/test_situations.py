"""Situations of a Hyper-V host: what rarms makes of each lies beside it, can be read, and does it."""

import json
import re
from pathlib import Path

import pytest

from rarms_iac.app.plan_files import plan_in
from rarms_iac.powershell.literals import unreadable
from rarms_iac.storage.plan_file import write_plan
from tests.cases.situations import ON_POWERSHELL, WITH_SCRIPTS, command_of, folders, made, outputs, stand_in
from tests.fake_powershell.cell import apply, in_one_file, scripts_of, undo
from tests.fake_powershell.observing import document_of

FOLDERS = folders()
situations = pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)


def test_situations_are_many_and_some_have_scripts() -> None:
    assert len(FOLDERS) >= 25
    assert {folder.name for folder in FOLDERS if list(folder.glob("*.ps1"))} == WITH_SCRIPTS


@situations
def test_a_situation_says_why_it_is_there(folder: Path) -> None:
    assert len((folder / "WHY").read_text(encoding="utf-8").strip().splitlines()) == 1


@situations
def test_golden_files_are_what_rarms_makes(folder: Path) -> None:
    lies, fresh = outputs(folder), made(folder).files

    assert sorted(lies) == sorted(fresh)
    for name, data in sorted(lies.items()):
        assert data == fresh[name], f"{folder.name}/{name}: run `python -m tests.cases.situations`, read the difference"
    for name, text in scripts_of(plan).items() if (plan := made(folder).plan) else ():
        assert unreadable(text, name) == ()


def forms_of_calls(folder: Path) -> set[tuple[str, ...]]:
    """Each cmdlet of the scripts with the names of its parameters."""
    plan = made(folder).plan
    calls = re.findall(
        r"\b([A-Z][a-z]+-[A-Z]\w+)\b([^|;{}\n]*)", b"".join(scripts_of(plan).values()).decode() if plan else ""
    )
    return {(name, *re.findall(r" (-[A-Za-z]+)\b", rest)) for name, rest in calls}


def test_real_powershell_runs_each_form_of_call() -> None:
    forms = {folder.name: forms_of_calls(folder) for folder in FOLDERS}

    assert set().union(*forms.values()) == set().union(*(forms[name] for name in ON_POWERSHELL))


@situations
def test_plan_file_makes_its_plan_again(folder: Path) -> None:
    plan = made(folder).plan
    if plan is not None:
        data = write_plan(plan)
        assert plan_in("made.plan", data) == plan
        assert plan_in("made.plan", data.replace(b"\n", b"\r\n")) == plan


@pytest.mark.parametrize(
    ("folder", "single"),
    [
        pytest.param(folder, single, id=f"{folder.name}-{'single' if single else 'module'}")
        for folder in FOLDERS
        for single in (False, True)
        if not single or folder.name in WITH_SCRIPTS
    ],
)
def test_scripts_do_what_plan_says_and_undo(folder: Path, single: bool) -> None:
    plan, host = made(folder).plan, stand_in(folder)
    if plan is None or not plan.hosts[0].steps:
        return
    before = host.copy()
    if single:
        plan = in_one_file(plan)

    ran = apply(host, plan)

    assert ran.code == 0, ran.says
    if command_of(folder)[0] in ("plan", "destroy") and "--target" not in command_of(folder):
        left = made(folder, json.dumps(document_of(host)).encode()).plan
        assert left is not None
        assert [str(step.address) for step in left.hosts[0].steps] == []
    taken_back = undo(host, plan)
    assert taken_back.code == 0, taken_back.says
    if not any(step.undo.message for step in plan.hosts[0].steps):
        assert document_of(host)["machines"] == document_of(before)["machines"]
        assert document_of(host)["tasks"] == document_of(before)["tasks"]
