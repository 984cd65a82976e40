"""What the module Rarms gives a person at a prompt: a plan by its script's path, and what is said of the last run."""

from __future__ import annotations

import json

import pytest

from rarms_iac.model.plan import Purpose
from rarms_iac.powershell.render import render_observe
from tests.fake_powershell.cell import apply, apply_script, files_of, in_one_file, scripts_of, undo
from tests.fake_powershell.cells import Prepared, fresh
from tests.fake_powershell.host import WindowsHost
from tests.fake_powershell.observing import document_of, seen
from tests.fake_powershell.run import FOLDER, Ran, put, run
from tests.fake_powershell.signing import signed
from tests.fake_powershell.values import Thing, Value

IMPORTED = f"""[CmdletBinding()]
param([switch] $AsJson, [switch] $Abandon, [switch] $Force, [int] $LockTimeout = 0, [switch] $Test)
Set-StrictMode -Version 3.0
$ErrorActionPreference = 'Stop'
$rarms = Import-Module -Name '{FOLDER}\\Rarms\\Rarms.psd1' -PassThru
"""


def at_prompt(host: WindowsHost, line: str, output: list[Value] | None = None, **how: bool) -> Ran:
    """The line, typed where the module is imported."""
    put(host, {"prompt.ps1": (IMPORTED + line + "\n").replace("\n", "\r\n").encode("ascii")})
    return run(host, "prompt.ps1", as_json=False, output=output, **how)  # type: ignore[arg-type]  # names of options


@pytest.fixture
def prepared() -> Prepared:
    return fresh()


@pytest.fixture
def host(prepared: Prepared) -> WindowsHost:
    return prepared.furnished()


def test_plan_runs_and_tests_by_script_path(prepared: Prepared, host: WindowsHost) -> None:
    path = f"-Path '{FOLDER}\\{apply_script(prepared.plan)}'"
    before: list[Value] = []
    after: list[Value] = []

    tested = at_prompt(host, f"Test-RarmsPlan {path}", before)
    assert (tested.code, host.effects) == (0, []), tested.says
    done = at_prompt(host, f"Invoke-RarmsPlan {path} -AsJson")
    again = at_prompt(host, f"Test-RarmsPlan {path}", after)

    assert (done.code, again.code) == (0, 0), done.says
    assert done.events[-1]["status"] == "done"
    for given, wanted in ((before, False), (after, True)):
        assert {thing.get("InDesiredState") for thing in given if isinstance(thing, Thing)} == {wanted}
        assert any(str(thing.get("Address")).startswith("partition/") for thing in given if isinstance(thing, Thing))


def test_destructive_script_asks_by_its_path_too(prepared: Prepared, host: WindowsHost) -> None:
    """The module's own preference is that nothing is asked; a script that its function calls does not see that."""
    assert apply(host, prepared.plan).code == 0
    removal = prepared.cell.on(host).plan(purpose=Purpose.DESTROY)
    put(host, files_of(removal))
    before = seen(host)

    ran = at_prompt(host, f"Invoke-RarmsPlan -Path '{FOLDER}\\{apply_script(removal)}'", unanswered=True)

    assert "no console is available" in ran.says
    assert seen(host) == before


def test_path_must_be_given(host: WindowsHost) -> None:
    for name in ("Invoke-RarmsPlan", "Test-RarmsPlan"):
        assert "-Path is missing: give the script of a plan" in at_prompt(host, name).says


@pytest.mark.parametrize("data", [render_observe(), signed(render_observe())], ids=["as made", "signed"])
def test_module_folder_script_observes_the_computer(host: WindowsHost, data: bytes) -> None:
    put(host, {"Rarms/observe.ps1": data})

    ran = at_prompt(host, "Get-RarmsObservation")

    assert (ran.code, host.effects) == (0, []), ran.says
    assert json.loads(ran.lines[0]) == document_of(host)


@pytest.mark.parametrize(
    ("files", "says"),
    [
        ({}, "observe.ps1 is missing: restore the file that rarms wrote"),
        ({"Rarms/observe.ps1": render_observe() + b"Remove-Item C:\\\r\n"}, "observe.ps1 was edited"),
        ({"Rarms/observe.ps1": signed(render_observe()) + b"Remove-Item C:\\\r\n"}, "observe.ps1 was edited"),
        (
            {"Rarms/observe.ps1": render_observe().replace(b"\r\n", b"\n")},
            'observe.ps1 has changed line ends: in git, set "*.ps* -text"',
        ),
    ],
    ids=["missing", "a line more", "a line behind the block", "line ends"],
)
def test_no_other_script_observes_for_the_module(host: WindowsHost, files: dict[str, bytes], says: str) -> None:
    put(host, files)

    ran = at_prompt(host, "Get-RarmsObservation")

    assert (ran.code, ran.lines, host.effects) == (1, (), []), ran.says
    assert says in ran.says


def test_runs_of_computer_are_told_in_their_order(prepared: Prepared, host: WindowsHost) -> None:
    none: list[Value] = []
    runs: list[Value] = []
    assert at_prompt(host, "Get-RarmsRun", none).code == 0
    assert apply(host, prepared.plan).code == 0
    assert undo(host, prepared.plan).code == 0
    effects = len(host.effects)

    told = at_prompt(host, "Get-RarmsRun", runs)

    assert (told.code, len(host.effects), none) == (0, effects, []), told.says
    things = [thing for thing in runs if isinstance(thing, Thing)]
    assert [(thing.get("run"), thing.get("closing")) for thing in things] == [("apply", "done"), ("undo", "done")]
    assert {thing.get("plan") for thing in things} == {prepared.plan.id}


@pytest.mark.parametrize("single", [False, True], ids=["module", "single file"])
@pytest.mark.parametrize("finished", [True, False], ids=["done", "killed"])
def test_undo_uses_the_script_in_the_journal(prepared: Prepared, single: bool, finished: bool) -> None:
    plan = in_one_file(prepared.plan) if single else prepared.plan
    host = prepared.copy() if finished else prepared.copy(kill_after=20)
    assert apply(host, plan).code == (0 if finished else None)
    host = host.copy()
    for name in scripts_of(plan):
        del host.files[f"{FOLDER}\\{name}".lower()]
    put(host, files_of(prepared.plan))  # the module that is imported at the prompt

    ran = at_prompt(host, "Undo-RarmsRun -AsJson")

    assert (ran.code, ran.events[-1]["status"]) == (0, "done"), ran.says
    assert seen(host) == seen(prepared.copy())
    assert [path for path in host.files if "\\undo" in path and FOLDER.lower() not in path] == [], "nothing stays"


def test_interrupted_undo_goes_on(prepared: Prepared) -> None:
    host = prepared.after_a_run()
    host = host.copy(kill_after=4)
    assert undo(host, prepared.plan).code is None
    host = host.copy()

    ran = at_prompt(host, "Undo-RarmsRun -AsJson")

    assert (ran.code, ran.events[-1]["status"]) == (0, "done"), ran.says
    assert seen(host) == seen(prepared.copy())


def test_undo_is_previewed_or_nothing_to_undo(prepared: Prepared, host: WindowsHost) -> None:
    assert "there is nothing to undo" in at_prompt(host, "Undo-RarmsRun").says
    assert apply(host, prepared.plan).code == 0
    before = seen(host)

    ran = at_prompt(host, "Undo-RarmsRun -AsJson -WhatIf")

    assert (ran.code, seen(host)) == (0, before), ran.says
    assert {event["status"] for event in ran.events} == {"previewed"}
    assert at_prompt(host, "Undo-RarmsRun -AsJson").code == 0
    assert "there is nothing to undo" in at_prompt(host, "Undo-RarmsRun").says


def test_get_rarmsrun_lists_unfinished_run_without_closing(prepared: Prepared) -> None:
    runs: list[Value] = []

    assert at_prompt(prepared.after_a_run(kill_after=20), "Get-RarmsRun", runs).code == 0

    assert [thing.get("closing") for thing in runs if isinstance(thing, Thing)] == [None]


@pytest.mark.parametrize(("line", "closed"), [("-Force", True), ("-WhatIf", False)])
def test_an_unfinished_run_of_any_plan_is_closed(prepared: Prepared, line: str, closed: bool) -> None:
    host = prepared.after_a_run(kill_after=20)
    before = seen(host)
    runs: list[Value] = []

    ran = at_prompt(host, f"Close-RarmsRun {line}")

    assert ran.code == 0, ran.says
    assert at_prompt(host, "Get-RarmsRun", runs).code == 0
    assert [thing.get("closing") for thing in runs if isinstance(thing, Thing)] == ["abandoned" if closed else None]
    assert seen(host) == before


def test_closing_a_run_is_asked_for(prepared: Prepared) -> None:
    host = prepared.after_a_run(kill_after=20)

    ran = at_prompt(host, "Close-RarmsRun", unanswered=True)

    assert (ran.code, "no console is available" in ran.says) == (1, True), ran.says


def test_asked_run_stops_and_can_go_on(prepared: Prepared, host: WindowsHost) -> None:
    script = apply_script(prepared.plan)

    previewed = at_prompt(host, f"Stop-RarmsRun -Path '{FOLDER}\\{script}' -WhatIf")
    assert (previewed.code, host.effects) == (0, []), previewed.says
    assert at_prompt(host, f"Stop-RarmsRun -Path '{FOLDER}\\{script}'").code == 0
    stopped = run(host, script)
    again = run(host, script)

    assert (stopped.code, stopped.events[-1]["status"]) == (1, "stopped"), stopped.says
    assert (again.code, again.events[-1]["status"]) == (0, "done"), again.says
    said = at_prompt(host, f"Stop-RarmsRun -Path '{FOLDER}\\none.ps1'").says
    assert f"the script {FOLDER}\\none.ps1 does not exist: give the script of a plan" in said


def test_a_computer_that_is_held_is_not_closed(prepared: Prepared) -> None:
    host = prepared.after_a_run(kill_after=20)
    host.lock = "held"

    ran = at_prompt(host, "Close-RarmsRun -Force")

    assert (ran.code, "locked by " in ran.says) == (1, True), ran.says


def test_script_is_found_from_where_a_person_stands(prepared: Prepared, host: WindowsHost) -> None:
    script = apply_script(prepared.plan)

    assert at_prompt(host, f"Stop-RarmsRun -Path '.\\{script}'").code == 0
    stopped = run(host, script)
    tested: list[Value] = []

    assert (stopped.code, stopped.events[-1]["status"]) == (1, "stopped"), stopped.says
    assert at_prompt(host, f"Test-RarmsPlan -Path '{script}'", tested).code == 0
    assert tested


def test_previewed_undo_holds_nothing(prepared: Prepared, host: WindowsHost) -> None:
    none = at_prompt(host, "Undo-RarmsRun -WhatIf")
    assert ("there is nothing to undo" in none.says, host.effects) == (True, []), none.says
    assert apply(host, prepared.plan).code == 0
    host.lock = "held"

    ran = at_prompt(host, "Undo-RarmsRun -AsJson -WhatIf")

    assert (ran.code, {event["status"] for event in ran.events}) == (0, {"previewed"}), ran.says


def test_closed_run_is_in_the_event_log(prepared: Prepared) -> None:
    host = prepared.after_a_run(kill_after=20)
    host.event_log = []

    assert at_prompt(host, "Close-RarmsRun -Force").code == 0

    entries = [(number, json.loads(says)) for _, number, says in host.event_log]
    assert [(number, entry["status"], entry["plan"]) for number, entry in entries][-1] == (
        2,
        "abandoned",
        prepared.plan.id,
    )
