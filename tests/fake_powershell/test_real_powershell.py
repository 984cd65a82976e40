"""What generated scripts met under a real PowerShell: each is here as the stand-in has learnt it."""

import json
import re
from collections.abc import Callable
from dataclasses import replace

import pytest

from rarms_iac.model.plan import Purpose
from rarms_iac.powershell.render import render_observe
from tests.fake_powershell.cell import apply, apply_script, files_of, scripts_of, undo, undo_script
from tests.fake_powershell.cells import Prepared, everything, fresh
from tests.fake_powershell.host import Entry, WindowsHost
from tests.fake_powershell.observing import JOURNAL, PROFILE, seen
from tests.fake_powershell.run import Ran, put, run
from tests.fake_powershell.signing import signed

PENDING_FOLDER = "c:\\run\\"


def asked(prepared: Prepared, host: WindowsHost, *declined: str) -> Ran:
    """A run at whose prompts the user says no to these addresses or actions."""
    put(host, files_of(prepared.plan))
    return run(host, apply_script(prepared.plan), declined=frozenset(declined))


def actions(prepared: Prepared, address: str) -> list[str]:
    """What the run says of an address and of what lies in it, step by step."""
    ran = apply(prepared.copy(), prepared.plan)
    begun = [event for event in ran.events if event["status"] == "begun"]
    return [event["detail"] for event in begun if f"{event['address']}/".startswith(f"{address}/")]


@pytest.mark.parametrize(("cell", "name"), [(fresh, "planning"), (everything, "speech")], ids=["creation", "stop"])
def test_declined_step_skips_what_builds_on_it(cell, name: str) -> None:  # type: ignore[no-untyped-def]
    prepared = cell()
    address = f"partition/{name}"
    undisturbed = prepared.copy()
    assert apply(undisturbed, prepared.plan).code == 0
    for action in actions(prepared, address):
        host = prepared.copy()

        ran = asked(prepared, host, action)

        statuses = ran.status_of(address)
        assert ran.code == 1, ran.says
        assert statuses.index("skipped") >= 0
        assert set(statuses[statuses.index("skipped") :]) == {"skipped"}, f"{action}\n{ran.says}"
        reasons = {event["detail"] for event in ran.events if event["status"] == "skipped"}
        named = {reason for reason in reasons if re.fullmatch(rf"needs [^ ]+, {re.escape(action)}", reason)}
        assert reasons - named <= {"left out", "needs capacity that skipped steps would have freed"}
        taken_back = host.copy()
        undone = undo(taken_back, prepared.plan)
        assert undone.code == 0, f"{action}\n{undone.says}"
        assert seen(taken_back)["machines"] == seen(prepared.copy())["machines"], action
        finished = apply(host, prepared.plan)
        assert finished.code == 0, f"{action}\n{finished.says}"
        assert seen(host)["machines"] == seen(undisturbed)["machines"], action


def given_since(host: WindowsHost, what: str) -> None:
    vm = host.machine("planning")
    match what:
        case "disk":
            host.write_file("D:\\results.vhdx", b"somebody's")
            vm.disks.append("D:\\results.vhdx")
        case "name":
            vm.name = "kept"
        case _:
            vm.checkpoint_count = 1


@pytest.mark.parametrize("what", ["disk", "name", "checkpoint"])
def test_undo_keeps_machine_that_others_changed(what: str) -> None:
    prepared = fresh()
    host = prepared.after_a_run()
    given_since(host, what)
    before = seen(host)

    ran = undo(host, prepared.plan)

    assert ran.code == 3, ran.says
    assert "added" in ran.says
    assert seen(host) == before


@pytest.mark.parametrize("what", ["disk", "name", "checkpoint"])
def test_removal_refuses_machine_that_others_changed(what: str) -> None:
    made = fresh()
    host = made.after_a_run()
    removal = made.cell.on(host).plan(purpose=Purpose.DESTROY)
    given_since(host, what)
    before = seen(host)

    ran = apply(host, removal)

    assert ran.code == 3, ran.says
    assert seen(host) == before


def test_profile_defaults_do_not_reach_a_run() -> None:
    prepared = everything()
    plain = prepared.copy()
    apply(plain, prepared.plan)
    host = prepared.copy(defaults={"Set-VM:AutomaticStartAction": "Nothing", "*:ErrorAction": "SilentlyContinue"})

    ran = apply(host, prepared.plan)

    assert ran.code == 0, ran.says
    assert seen(host.copy(defaults={})) == seen(plain)
    failing = prepared.copy(defaults={"*:ErrorAction": "SilentlyContinue"}, refusals={"Get-VMHost": ("E1", "X", "no")})
    assert "no" in apply(failing, prepared.plan).says


def test_profile_does_not_reach_observing() -> None:
    host = everything().copy(refusals={"Get-VM": ("AccessDenied", "PermissionDenied", "may not")})
    hidden = host.copy(defaults={"*:ErrorAction": "SilentlyContinue"})
    for machine in (host, hidden):
        put(machine, {"observe.ps1": render_observe()})

    assert run(hidden, "observe.ps1").lines == run(host, "observe.ps1").lines
    assert json.loads(run(host, "observe.ps1").lines[0])["machines"]["status"] == "denied"


def test_ctrl_c_leaves_the_run_open() -> None:
    prepared = everything()
    host = prepared.copy(interrupt=True)

    ran = apply(host, prepared.plan)

    assert ran.code == 0, "PowerShell's own"
    assert ran.events[-1]["status"] == "begun", "no closing event: no reader may take it for done"
    assert host.lock == ""
    other = apply(host.copy(), fresh().plan)
    assert (other.code, "run its script again, or its undo script" in other.says) == (3, True)
    host = host.copy()
    assert apply(host, prepared.plan).events[-1]["status"] == "done"


@pytest.mark.parametrize("at_prompt", [False, True], ids=["-File", "at a prompt"])
def test_profile_preview_is_told_by_last_event(at_prompt: bool) -> None:
    """PowerShell gives such a default to a script's own -WhatIf, so that the exit code is that of a preview."""
    prepared = fresh()
    host = prepared.furnished(defaults={"*:WhatIf": True})

    ran = run(host, apply_script(prepared.plan), at_prompt=at_prompt)

    assert (ran.code, host.effects) == (0, []), ran.says
    assert {event["status"] for event in ran.events} == {"previewed"}
    assert "nothing was changed" in ran.events[-1]["detail"]


def test_no_other_line_stands_between_the_events() -> None:
    """-Verbose makes ShouldProcess tell what it lets pass, also where the preference for that is silent."""
    prepared = fresh()
    host = prepared.furnished()

    refused = run(host, apply_script(prepared.plan), verbose=True)
    spoken = run(host, apply_script(prepared.plan), verbose=True, as_json=False)

    assert refused.code == 1
    assert [event["status"] for event in refused.events] == ["failed"]
    assert "-AsJson excludes -Verbose" in refused.says
    assert any(line.startswith("VERBOSE: ") for line in spoken.lines), "as the stand-in knows it"
    assert spoken.code == 0
    assert b"Cannot be combined with -Verbose" in files_of(prepared.plan)[apply_script(prepared.plan)]


def test_preview_as_json_takes_no_lock() -> None:
    prepared = fresh()
    host = prepared.furnished(lock="held")

    ran = run(host, apply_script(prepared.plan), what_if=True)
    spoken = run(host, apply_script(prepared.plan), what_if=True, as_json=False)

    assert ran.code == 0, ran.says
    assert {event["status"] for event in ran.events} == {"previewed"}
    assert sum(line.startswith("What if: ") for line in spoken.lines) > 3


def test_failure_names_step_cmdlet_and_error() -> None:
    prepared = fresh()
    at = prepared.effect("Set-VMMemory")
    host = prepared.copy(fail_at=at)

    *_, begun, failed = apply(host, prepared.plan).events

    assert (failed["kind"], failed["address"]) == ("failed", "partition/planning")
    assert (begun["status"], begun["number"]) == ("begun", failed["number"])
    assert "Set-VMMemory Unspecified" in failed["detail"]


def test_failed_reading_names_its_step() -> None:
    prepared = everything()
    host = prepared.copy(refusals={"Get-VMProcessor": ("InvalidState,GetVMCpu", "InvalidOperation", "it is busy")})

    failed = apply(host, prepared.plan).events[-1]

    assert failed["address"].startswith("partition/")
    assert "it is busy (Get-VMProcessor InvalidState,GetVMCpu, line" in failed["detail"]


@pytest.mark.parametrize("seconds", [-5, 3_000_000])
def test_impossible_wait_is_refused(seconds: int) -> None:
    prepared = fresh()
    host = prepared.furnished()

    ran = run(host, apply_script(prepared.plan), lock_timeout=seconds)

    assert ran.code == 1
    assert ran.events[-1]["detail"] == "-LockTimeout must be 0 to 86400 seconds"
    assert [effect for effect in host.effects if not effect.endswith(".result.json")] == []


def test_confirm_without_console_is_refused() -> None:
    prepared = fresh()
    host = prepared.furnished()

    ran = run(host, apply_script(prepared.plan), unanswered=True, confirm=True)
    alone = run(host, apply_script(prepared.plan), unanswered=True)

    assert ran.code == 1
    assert "no console is available" in ran.events[-1]["detail"]
    assert "with -Force" in ran.events[-1]["detail"]
    assert alone.code == 0, "nothing is stopped, removed or deleted: it does not ask"


@pytest.mark.parametrize(
    ("asked", "code"),
    [({}, 1), ({"force": True}, 0), ({"force": True, "confirm": True}, 1)],
    ids=["no console", "force", "force and confirm"],
)
def test_what_stops_and_removes_has_to_be_confirmed(asked: dict[str, bool], code: int) -> None:
    prepared = everything()
    host = prepared.furnished()
    text = scripts_of(prepared.plan)[apply_script(prepared.plan)]

    ran = run(host, apply_script(prepared.plan), unanswered=True, **asked)  # type: ignore[arg-type]  # switches

    assert b"ConfirmImpact = 'High'" in text
    assert ran.code == code, ran.says
    assert [effect for effect in host.effects if effect.startswith("Stop-VM")] == [] or code == 0


def test_line_ends_that_git_changed_are_called_so() -> None:
    prepared = fresh()
    host = prepared.copy()
    name = undo_script(prepared.plan)
    put(host, {**files_of(prepared.plan), name: scripts_of(prepared.plan)[name].replace(b"\r\n", b"\n")})

    ran = run(host, apply_script(prepared.plan))

    assert (ran.code, "has changed line ends" in ran.says) == (1, True), ran.says


def test_missing_undo_script_is_named() -> None:
    prepared = fresh()
    host = prepared.furnished()
    del host.files[PENDING_FOLDER + undo_script(prepared.plan)]

    ran = run(host, apply_script(prepared.plan))

    assert ran.code == 1
    assert ran.events[-1]["detail"].endswith("is missing: restore the file that rarms wrote")


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (signed, 0),
        (lambda text: signed(text.replace(b"& $invoke", b"&  $invoke")), 1),
        (lambda text: signed(text) + b"Remove-Item C:\\\r\n", 1),
        (lambda text: signed(text + b"Remove-Item C:\\\r\n"), 1),
        (lambda text: text.replace(b"& $invoke", b"# SIG # Begin signature block\r\n& $invoke"), 1),
    ],
    ids=["signed", "edited", "a line behind", "a line ahead", "code in the block"],
)
def test_undo_script_may_be_signed_and_nothing_else(change: Callable[[bytes], bytes], code: int) -> None:
    prepared = fresh()
    host = prepared.furnished()
    name = undo_script(prepared.plan)
    put(host, {name: change(scripts_of(prepared.plan)[name])})
    before = seen(host)

    ran = run(host, apply_script(prepared.plan))

    assert ran.code == code, ran.says
    if code:
        assert "was edited" in ran.says
        assert seen(host) == before
    else:
        assert run(host, name).code == 0


@pytest.mark.parametrize("after", ["apply", "undo", "undo of another"])
def test_journal_that_never_began_is_cleared(after: str) -> None:
    prepared = fresh()
    at = next(
        at for at, effect in enumerate(prepared.effects()) if effect.startswith("write") and "jsonl.new" in effect
    )
    host = prepared.after_a_run(kill_after=at)
    assert host.file(JOURNAL + ".new")

    ran = apply(host, prepared.plan) if after == "apply" else undo(host, prepared.plan)

    assert ran.code == (0 if after == "apply" else 3), ran.says
    assert host.file(JOURNAL + ".new") is None


def test_a_value_of_another_type_is_written_again() -> None:
    prepared = fresh()
    host = prepared.after_a_run()
    task = host.registry[f"{PROFILE}\\Tasks\\Localization".lower()]
    task.values["priority"] = replace(task.values["priority"], kind="String", data="5")
    assert isinstance(task.values["priority"], Entry)

    left = prepared.cell.on(host).plan()
    ran = apply(host, left)

    assert ran.code == 0, ran.says
    assert task.values["priority"].kind == "DWord"


@pytest.mark.parametrize("task", ["Games", "Localization"])
def test_class_with_default_value_is_refused_beforehand(task: str) -> None:
    prepared = everything()
    for done in (False, True):
        host = prepared.copy()
        if done:
            apply(host, prepared.plan)
        host.add_key(f"{PROFILE}\\Tasks\\{task}").values[""] = Entry(name="", kind="String", data="somebody's")
        before = seen(host)

        ran = undo(host, prepared.plan) if done else apply(host, prepared.plan)

        assert ran.code == 3, ran.says
        assert seen(host) == before
