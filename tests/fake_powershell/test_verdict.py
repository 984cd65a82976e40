"""What operations have of a run: its verdict beside the script, entries of the event log, a bar, what remains to do."""

import json
import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from rarms_iac.model.plan import Purpose
from tests.effort import every_few
from tests.fake_powershell.cell import apply, apply_script, files_of, undo
from tests.fake_powershell.cells import MMCSS, Prepared, everything, fresh
from tests.fake_powershell.host import READ, WRITE, Entry, WindowsHost
from tests.fake_powershell.observing import JOURNAL
from tests.fake_powershell.run import BETWEEN_RUNS_MS, FOLDER, put, run

RESOURCE = json.loads((Path(__file__).parents[2] / "docs" / "rarms.dsc.resource.json").read_text(encoding="utf-8"))
RESULT = f"{FOLDER}\\onboard.ps1.result.json"


def verdict(host: WindowsHost, path: str = RESULT) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(host.data(path))
    return found


def entries(host: WindowsHost) -> list[tuple[str, int]]:
    assert host.event_log is not None
    return [(kind, number) for kind, number, _ in host.event_log]


def a_run(prepared: Prepared, **how: object) -> tuple[WindowsHost, Any]:
    host = prepared.furnished()
    return host, run(host, apply_script(prepared.plan), **how)  # type: ignore[arg-type]  # names of options


@pytest.mark.parametrize("prepared", [fresh, everything], ids=["fresh", "everything"])
def test_finished_run_leaves_a_verdict(prepared: Any) -> None:
    made = prepared()
    host, ran = a_run(made)
    steps = [event for event in ran.events if event["status"] == "changed"]

    found = verdict(host)

    assert (found["format"], found["plan"], found["run"]) == ("rarms-result/1", made.plan.id, "apply")
    assert (found["status"], found["exit_code"]) == ("done", 0)
    assert found["changed"] == ran.events[-1]["changed"] == len(steps) > 0
    assert found["operator"].startswith("operator@ONBOARD")
    assert entries(host)[-2:] == [("Information", 1), ("Information", 2)]
    assert host.event_log is not None
    for _, _, says in host.event_log[-2:]:
        assert json.loads(says).items() >= {"plan": made.plan.id, "run": "apply", "operator": found["operator"]}.items()
    assert json.loads(host.event_log[-1][2]) == found


def test_interrupted_run_shows_no_earlier_verdict() -> None:
    prepared = fresh()
    effects = a_run(prepared)[0].effects
    told = effects.index(f"write {RESULT}")  # by then it holds the computer
    for kill_after in every_few(len(effects) - 1 - told, 3):
        host = prepared.copy(kill_after=told + kill_after)
        host.write_file(RESULT, b'{"status":"done"}')
        put(host, files_of(prepared.plan))
        assert run(host, apply_script(prepared.plan)).code is None
        if host.data(RESULT):  # killed before its first byte it says nothing
            assert (verdict(host)["status"], verdict(host)["exit_code"]) == ("begun", 1)
        assert run(again := host.copy(), apply_script(prepared.plan)).code == 0
        assert verdict(again)["status"] == "done"


def test_verdict_after_ctrl_c_is_not_done() -> None:
    made = fresh()
    host = made.after_a_run()
    removal = made.cell.on(host).plan(purpose=Purpose.DESTROY)
    host.interrupt = True

    ran = apply(host, removal)

    assert ran.code == 0
    assert verdict(host)["status"] == "begun"


def test_refusals_and_failures_are_verdicts_and_entries_too() -> None:
    made = fresh()
    refused, failed = made.copy(computer="OTHER"), made.copy(scheduler=4)

    codes = [apply(host, made.plan).code for host in (refused, failed)]

    assert codes == [3, 1]
    for host, status, code, entry in ((refused, "refused", 3, ("Warning", 5)), (failed, "failed", 1, ("Warning", 3))):
        found = verdict(host)
        assert (found["status"], found["exit_code"], found["changed"]) == (status, code, 0)
        assert found["detail"]
        assert entries(host)[-1] == entry


def test_link_in_place_of_verdict_is_refused() -> None:
    made = fresh()
    host = made.copy()
    host.write_file(RESULT, b"elsewhere")
    host.files[RESULT.lower()].link = True

    ran = apply(host, made.plan)

    assert ran.code == 1, ran.says
    assert [effect for effect in host.effects if "owner.txt" not in effect and "Acl" not in effect] == [
        "make folder C:\\ProgramData\\rarms"
    ]
    assert f"{RESULT} is a link" in ran.events[-1]["detail"]
    assert host.file(RESULT).data == b"elsewhere"  # type: ignore[union-attr]


def test_deaf_event_log_does_not_fail_the_run() -> None:
    made = fresh()
    host = made.copy(event_log=None)

    assert apply(host, made.plan).code == 0
    assert undo(host, made.plan).code == 0


def test_bar_is_shown_where_person_looks_on() -> None:
    host, _ = a_run(fresh(), as_json=False)
    silent, _ = a_run(fresh())
    previewed, _ = a_run(fresh(), as_json=False, what_if=True)

    assert (silent.progress, previewed.progress) == ([], [])
    shares = [share for _, share in host.progress]
    assert shares[-1] == -1
    shares = [share for share in shares if share >= 0]
    assert shares == sorted(shares)
    assert max(shares) > 50


@pytest.mark.parametrize("start", [2, 4, None], ids=["there", "disabled", "missing"])
def test_task_classes_wait_for_restart_and_service(start: int | None) -> None:
    made = fresh()
    host = made.copy()
    if start is None:
        del host.registry[MMCSS.lower()]
    else:
        host.add_key(MMCSS).values["start"] = Entry(name="Start", kind="DWord", data=start)
    put(host, files_of(made.plan))

    ran = run(host, apply_script(made.plan))
    again = run(host, apply_script(made.plan))

    noted = [event["detail"] for event in ran.events if event["status"] == "noted"][:-1]
    assert ran.events[-2]["detail"] == "restart Windows: MMCSS reads the classes at the start"
    assert ran.events[-1]["status"] == "done"
    assert [detail.partition(" here:")[0] for detail in noted] == ["the service MMCSS is missing or disabled"] * (
        start != 2
    )
    assert "noted" not in {event["status"] for event in again.events}


def test_plan_without_task_classes_asks_for_no_restart() -> None:
    made = fresh()
    host = made.after_a_run()
    ran = apply(host, made.cell.on(host).plan(purpose=Purpose.DESTROY))
    assert ran.code == 0, ran.says
    assert any(event["status"] == "noted" for event in ran.events) == any(
        step["address"].startswith("task/") and step["status"] == "changed" for step in ran.events
    )


def test_a_test_as_json_is_one_object() -> None:
    made = fresh()
    host = made.furnished()

    before = run(host, apply_script(made.plan), test=True)
    assert run(host, apply_script(made.plan)).code == 0
    after = run(host, apply_script(made.plan), test=True)

    for ran, wanted in ((before, False), (after, True)):
        (line,) = ran.lines
        found = json.loads(line)
        assert (ran.code, found["_inDesiredState"]) == (0, wanted)
        assert (found["plan"], found["script"]) == (made.plan.id, f"{FOLDER}\\onboard.ps1")
        assert {step["InDesiredState"] for step in found["steps"]} == {wanted}
        jsonschema.validate(found, RESOURCE["schema"]["embedded"])


def test_second_dsc_set_looks_again() -> None:
    made = fresh()
    host = made.furnished()
    script = apply_script(made.plan)
    assert run(host, script, force=True).code == 0
    done = len(host.effects)

    again = run(host, script, force=True)
    machines = host.copy().vms
    for vm in host.vms.values():
        vm.reserve = 1
    moved = [run(host, script, force=True), run(host, script, test=True)]

    assert (again.code, again.events[-1]["status"], verdict(host)["changed"]) == (0, "done", 0), again.says
    assert [(ran.code, "is not as wanted: reserve" in ran.says) for ran in moved] == [(3, True), (3, True)]
    assert {vm.reserve for vm in host.vms.values()} == {1} != {vm.reserve for vm in machines.values()}
    assert not [effect for effect in host.effects[done:] if "VM" in effect]


def test_dsc_resource_uses_existing_parameters() -> None:
    (part,) = fresh().plan.hosts
    script = part.scripts["onboard.ps1"]
    for operation in ("get", "test", "set"):
        called = RESOURCE[operation]["args"][-1]
        for switch in re.findall(r" -([A-Za-z]+)", called):
            assert f"[switch] ${switch}" in script, switch
        assert "$env:script" in called
        assert RESOURCE[operation]["input"] == "env"
    assert set(RESOURCE["exitCodes"]) == {"0", "1", "3"}


def held_by_another(host: WindowsHost, path: str, share: frozenset[str], ms: int) -> None:
    """Another process has the file open for so long, and shares it so."""
    until, handle = host.clock + BETWEEN_RUNS_MS + ms, host.open(path, READ, share, here=False)

    def let_go(on: WindowsHost) -> None:
        if on.clock >= until:
            on.close(handle)

    host.slept = let_go


@pytest.mark.parametrize("path", [RESULT, JOURNAL], ids=["verdict", "journal"])
@pytest.mark.parametrize("share", [READ, READ | WRITE], ids=["reading", "writing too"])
def test_reader_of_a_moment_breaks_no_run(path: str, share: frozenset[str]) -> None:
    made = fresh()
    host = made.after_a_run()
    removal = made.cell.on(host).plan(purpose=Purpose.DESTROY)
    host = host.copy()
    held_by_another(host, path, share, 2000)

    ran = apply(host, removal)

    assert (ran.code, verdict(host)["status"]) == (0, "done"), ran.says


def test_held_journal_is_named() -> None:
    made = fresh()
    host = made.after_a_run()
    removal = made.cell.on(host).plan(purpose=Purpose.DESTROY)
    host = host.copy()
    held_by_another(host, JOURNAL, READ, 60_000)

    ran = apply(host, removal)

    assert (ran.code, ran.events[-1]["status"]) == (1, "failed"), ran.says
    assert f"{JOURNAL} cannot be used; close the program that has it open" in ran.events[-1]["detail"]


def test_held_verdict_lies_in_program_data() -> None:
    made = fresh()
    host = made.copy()
    host.write_file(RESULT, b"{}")
    held_by_another(host, RESULT, READ, 3_600_000)

    ran = apply(host, made.plan)

    elsewhere = "C:\\ProgramData\\rarms\\onboard.ps1.result.json"
    assert (ran.code, verdict(host, elsewhere)["status"]) == (0, "done"), ran.says
    (noted,) = (event["detail"] for event in ran.events if "verdict" in event["detail"])
    assert noted.startswith(f"the verdict is in {elsewhere}: {RESULT} cannot be used")


def test_refused_start_leaves_the_verdict_of_the_running_one() -> None:
    made = fresh()
    host = made.copy(lock="held")
    host.write_file(RESULT, b'{"status":"begun"}')

    ran = apply(host, made.plan)

    assert (ran.code, ran.events[-1]["kind"], verdict(host)) == (3, "lock", {"status": "begun"}), ran.says
    assert entries(host) == [("Warning", 5)]
