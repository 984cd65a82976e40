"""A live Hyper-V host as the command line is given it: looked at, examined and written down, all of one look."""

import json
import re
import shutil
from collections.abc import Callable
from operator import methodcaller
from pathlib import Path

import pytest

from rarms_iac.app.wiring import read_script_output
from rarms_iac.applying.run_script import finish_job, undo_job
from rarms_iac.model.journal import ScriptRun
from rarms_iac.model.state import Rights
from rarms_iac.powershell.render import render_observe
from rarms_iac.providers.hyperv.condition import findings_of
from rarms_iac.providers.hyperv.provider import LiveHypervHost
from rarms_iac.providers.interface import NO_WAITING, HostFailed, RecordableHost, RunEvent, ScriptExited, ScriptLost
from rarms_iac.storage.plan_file import is_signed_script
from rarms_iac.storage.plan_file import signed as sign_plan
from tests.builders import a_host, codes
from tests.effort import every_few
from tests.fake_powershell.cell import apply_script, files_of, job_of
from tests.fake_powershell.cells import everything, fresh
from tests.fake_powershell.host import Entry, WindowsHost
from tests.fake_powershell.observing import JOURNAL, PROFILE, RECORDS, WINDOWS, document_of
from tests.fake_powershell.signing import signed
from tests.fake_powershell.transport import FakePowerShellTransport
from tests.recorded_hosts import read_observation


def live(host: WindowsHost | None, before: str = "", after: str = "", signatures: Path | None = None) -> LiveHypervHost:
    return LiveHypervHost(a_host("onboard"), FakePowerShellTransport(host, before, after), signatures)


def test_what_is_written_down_is_what_script_printed() -> None:
    host = everything().copy()

    data = live(host, before="Windows PowerShell").recorded()

    assert json.loads(data) == document_of(host)
    assert data.isascii()
    assert data.count(b"\n") == 1


@pytest.mark.parametrize(("build", "edition"), [("14393", "Desktop"), ("26100", "Core")], ids=["2016", "2025"])
def test_windows_powershell_looks_on_server_2016(build: str, edition: str) -> None:
    host = everything().copy(powershell={"version": "7.4.6", "edition": "Core"}, loads_hyperv=build == "26100")
    host.add_key(WINDOWS).values["currentbuildnumber"] = Entry(name="CurrentBuildNumber", kind="String", data=build)
    there = live(host)

    state = there.observe()

    assert host.powershell["edition"] == edition
    assert state.partitions == live(everything().copy()).observe().partitions


def test_snapshot_says_what_the_live_host_says() -> None:
    host = everything().after_a_run(kill_after=25)
    there = live(host)

    seen = read_script_output(there.recorded(), "onboard")

    assert seen is not None
    looked = there.examined("robot")
    assert (seen.state, seen.condition, seen.findings) == (looked.state, looked.condition, looked.findings)
    assert seen.state == there.observe()
    assert seen.unfinished == there.unfinished() is not None


def test_host_that_constrains_language_of_scripts_says_so() -> None:
    host = fresh().copy(language="ConstrainedLanguage")

    with pytest.raises(HostFailed, match="runs in ConstrainedLanguage here, by AppLocker or App Control"):
        live(host).examined("robot")


def test_examining_tells_what_is_odd_there() -> None:
    host = everything().copy()
    host.files[JOURNAL.lower()].owner = "S-1-5-21-1-2-3-1001"

    looked = live(host).examined("robot")

    assert codes(looked.findings) == ["RARMS190"]
    assert looked.findings == findings_of(read_observation(live(host).recorded()), "onboard")


def test_a_caller_without_rights_is_examined_too() -> None:
    host = fresh().copy(elevated=False)
    host.refusals["Get-CimInstance Msvm_ComputerSystem"] = ("AccessDenied", "PermissionDenied", "Access denied")

    looked = live(host).examined("robot")

    assert looked.state.facts.rights is Rights.MISSING
    assert looked.state.partitions == ()


class Heard:
    """An `EventListener` that keeps what it is told, and lets the run go on."""

    def __init__(self) -> None:
        self.events: list[RunEvent] = []

    def on_event(self, event: RunEvent) -> None:
        self.events.append(event)

    def on_output(self, line: str) -> None:
        raise AssertionError(line)

    def should_stop(self) -> bool:
        return False


def test_signed_copy_is_what_runs(tmp_path: Path) -> None:
    prepared = fresh()
    host = prepared.copy(all_signed=True)
    (part,) = prepared.plan.hosts
    apply_it, undo_it = job_of(prepared.plan).script, f"{part.host.name}.undo.ps1"
    there = live(host, signatures=tmp_path)
    with pytest.raises(HostFailed, match="not digitally signed"):
        there.observe()
    (tmp_path / "Rarms").mkdir()
    for name, text in {"observe.ps1": render_observe(), **files_of(prepared.plan)}.items():
        (tmp_path / name).write_bytes(signed(text))
    before = there.observe()

    assert there.run_script(apply_it, NO_WAITING, Heard()).code == 0  # type: ignore[union-attr]
    run = there.journal()
    assert run is not None
    assert run.started.undo.encode("ascii") == (tmp_path / undo_it).read_bytes()
    shutil.rmtree(tmp_path / "Rarms")  # a run is finished or undone by what the journal holds, signed as it was
    for path in tmp_path.iterdir():
        path.unlink()
    back = there.run_script(undo_job(part.host.name, run).script, NO_WAITING, Heard())
    (tmp_path / "observe.ps1").write_bytes(signed(render_observe()))

    assert back == ScriptExited(code=0)
    assert there.observe().partitions == before.partitions


def test_killed_signed_run_is_finished_from_journal(tmp_path: Path) -> None:
    prepared = everything()
    own = job_of(prepared.plan).script
    (tmp_path / "Rarms").mkdir()
    for name, text in {"observe.ps1": render_observe(), **files_of(prepared.plan)}.items():
        (tmp_path / name).write_bytes(signed(text))
    whole = prepared.copy(all_signed=True)
    assert live(whole, signatures=tmp_path).run_script(own, NO_WAITING, Heard()) == ScriptExited(code=0)
    wanted, effects = live(whole, signatures=tmp_path).observe(), len(whole.effects)

    for number in every_few(effects, 2):
        host = prepared.copy(all_signed=True, kill_after=number)
        live(host, signatures=tmp_path).run_script(own, NO_WAITING, Heard())
        host = host.copy()
        run = live(host, signatures=tmp_path).journal()
        bundle, signatures = own, tmp_path
        if isinstance(run, ScriptRun) and run.started.plan == prepared.plan.id:  # what is not signed would not run
            bundle = finish_job("onboard", run).script
            signatures = tmp_path / "nowhere"

        assert live(host, signatures=signatures).run_script(bundle, NO_WAITING, Heard()) == ScriptExited(code=0), number
        assert live(host, signatures=tmp_path).observe().partitions == wanted.partitions, number


@pytest.mark.parametrize("changed", ["another text", "another line behind it", "no signature"])
def test_signed_file_with_other_text_does_not_run(tmp_path: Path, changed: str) -> None:
    prepared = fresh()
    host = prepared.copy()
    script = job_of(prepared.plan).script
    text = script.files[script.runs].encode("ascii")
    copy = {
        "another text": signed(text.replace(b"& $invoke", b"&  $invoke")),
        "another line behind it": signed(text) + b"exit 7\r\n",
        "no signature": text.replace(b"& $invoke", b"&  $invoke"),
    }[changed]
    (tmp_path / script.runs).write_bytes(copy)

    assert live(host, signatures=tmp_path).run_script(script, NO_WAITING, Heard()) == ScriptExited(code=0)
    assert host.file(f"C:\\run\\{script.runs}").data == text  # type: ignore[union-attr]


KEY = b"0123456789abcdef"


def test_run_of_keyed_plan_is_known_by_journal(tmp_path: Path) -> None:
    prepared = fresh()
    plan = sign_plan(prepared.plan, KEY)
    host = prepared.copy(kill_after=20)
    assert isinstance(live(host).run_script(job_of(plan).script, NO_WAITING, Heard()), ScriptLost)
    host = host.copy()

    run = live(host).journal()

    assert isinstance(run, ScriptRun)
    assert is_signed_script(run.started.script, KEY)
    assert not is_signed_script(run.started.script, KEY[::-1])
    assert not is_signed_script(run.started.script.replace("-Reserve 4", "-Reserve 5"), KEY)
    assert not is_signed_script(files_of(prepared.plan)[apply_script(plan)].decode(), KEY)
    assert live(host).run_script(finish_job("onboard", run).script, NO_WAITING, Heard()) == ScriptExited(code=0)
    run = live(host).journal()
    assert isinstance(run, ScriptRun)
    back = undo_job("onboard", run)
    assert is_signed_script(back.script.files[back.script.runs], KEY)
    assert live(host).run_script(back.script, NO_WAITING, Heard()) == ScriptExited(code=0)


DENIED = ("PermissionDenied", "PermissionDenied", "Requested registry access is not allowed.")
BROKEN = ("System.IO.IOException", "NotSpecified", "The disk has a bad sector.")
TASKS, OURS = f"Get-ChildItem {PROFILE}\\Tasks", f"Get-ChildItem {RECORDS}"
READING_JOURNAL = f"open {JOURNAL}"


@pytest.mark.parametrize("error", [DENIED, BROKEN], ids=["denied", "broken"])
@pytest.mark.parametrize(
    ("command", "subject"),
    [
        (TASKS, "its task classes"),
        (OURS, "its records in HKLM"),
        (READING_JOURNAL, "journal.jsonl"),
        ("Get-VMMemory backup", 'machine "backup"'),
        ("Get-VMSnapshot backup", 'machine "backup"'),
    ],
)
def test_unread_is_not_empty(command: str, subject: str, error: tuple[str, str, str]) -> None:
    host = everything().copy()
    host.refusals[command] = error

    with pytest.raises(HostFailed, match=re.escape(subject)) as refused:
        live(host).observe()
    seen = read_script_output(live(host).recorded(), "onboard")

    assert error[2] in refused.value.message
    assert seen is not None
    assert str(seen.unread) == str(refused.value)
    others = [vm.name for vm in host.vms.values() if not command.endswith(" backup") or vm.name != "backup"]
    assert sorted(partition.settings.name for partition in seen.state.partitions) == sorted(others)
    assert read_script_output(live(everything().copy()).recorded(), "onboard").unread is None  # type: ignore[union-attr]


def test_unlistable_journal_is_not_absent() -> None:
    host = everything().copy(elevated=False)
    there = live(host)

    with pytest.raises(HostFailed, match="journal"):
        there.unfinished()
    seen = read_script_output(there.recorded(), "onboard")

    assert seen is not None
    assert seen.unread is not None


def test_looking_changes_nothing() -> None:
    host = everything().copy()

    live(host).examined("robot")
    live(host).recorded()

    assert host.effects == []


@pytest.mark.parametrize(
    "ask", [methodcaller("observe"), methodcaller("examined", "robot"), methodcaller("recorded")], ids=repr
)
def test_unreachable_or_garbled_host_is_told(ask: Callable[[LiveHypervHost], object]) -> None:
    with pytest.raises(HostFailed, match="nobody answers"):
        ask(live(None))
    with pytest.raises(HostFailed, match="cannot be read"):
        ask(live(everything().copy(), after='{"format": "other"}'))


def test_live_host_keeps_its_contracts() -> None:
    host = live(fresh().copy())

    assert isinstance(host, RecordableHost)
