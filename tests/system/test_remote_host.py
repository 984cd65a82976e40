"""A Hyper-V host behind a real sshd, with a stand-in for its PowerShell: the command itself, to an empty plan."""

import json
import re
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from rarms_iac.model.version import __version__
from rarms_iac.powershell.templates import without_signature
from tests.fake_powershell.host import WindowsHost
from tests.fake_powershell.observing import JOURNAL, host_from
from tests.fake_powershell.program import STAND_IN
from tests.fake_powershell.signing import signed
from tests.needs import CHECKOUT, require
from tests.remote import Ended, Remote, a_remote, finish

pytestmark = [pytest.mark.needs("ssh", "linux")]

MANIFEST = """\
schema: rarms/v1
application: { name: robot }
hosts:
  onboard:
    provider: hyperv
    connect: { ssh: cell, shell: pwsh }
    logical_processors: 8
    memory: 16 GiB
components:
  vision: { criticality: 50, memory: 1 GiB, processors: 2, cpu: { reserve: 20 % } }
  speech: { criticality: 40, memory: 1 GiB, processors: 2, cpu: { reserve: 10 % } }
"""
EMPTY = "No changes."


def an_empty_host() -> WindowsHost:
    recorded = CHECKOUT / "tests" / "recorded" / "hyperv" / "empty-host.json"
    return host_from(json.loads(recorded.read_text(encoding="utf-8")))


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Remote]:
    require("ssh", "linux")
    folder = tmp_path_factory.mktemp("remote")
    with a_remote(folder, an_empty_host()) as remote:
        yield remote


@pytest.fixture
def remote(server: Remote) -> Remote:
    """The server with an empty host that behaves, and a fresh manifest."""
    server.put(an_empty_host())
    server.ask()
    (server.folder / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    return server


def apply(remote: Remote, *more: str) -> Ended:
    return remote.rarms("apply", "--auto-approve", *more)


def change_manifest(remote: Remote, before: str, after: str) -> None:
    path = remote.folder / "rarms.yaml"
    path.write_text(path.read_text(encoding="utf-8").replace(before, after), encoding="utf-8", newline="\n")


def is_as_wanted(remote: Remote) -> bool:
    planned = remote.rarms("plan")
    return planned.code == 0 and EMPTY in planned.out


def journal_of(remote: Remote) -> list[dict[str, object]]:
    file = remote.host.file(JOURNAL)
    assert file is not None
    assert file.data is not None
    return [json.loads(line) for line in file.data.splitlines()]


def after_steps(remote: Remote, count: int) -> None:
    """Wait until a run on the host has recorded so many."""
    until = time.monotonic() + 120
    while time.monotonic() < until:
        file = remote.host.file(JOURNAL)
        if file is not None and file.data is not None and file.data.count(b'"status":"changed"') >= count:
            return
        time.sleep(0.02)
    raise AssertionError("the run does not get on")


@pytest.mark.sample
def test_apply_ends_empty_and_undo_restores(remote: Remote) -> None:
    applied = apply(remote)

    assert applied.code == 0, applied
    done = re.findall(r"^(\w+)  \d+ steps  ", applied.err, re.MULTILINE)
    assert done == ["speech", "vision"], "each partition is a line"
    assert "2 added, 0 changed, 0 removed" in " ".join(applied.err.split())
    assert is_as_wanted(remote)
    assert {vm.name: vm.state for vm in remote.host.vms.values()} == {"vision": "Running", "speech": "Running"}

    assert remote.rarms("drift").code == 0

    undone = remote.rarms("undo", "--auto-approve")
    assert undone.code == 0, undone
    assert not remote.host.vms


def test_installed_module_of_another_version_is_refused(remote: Remote) -> None:
    change_manifest(remote, "shell: pwsh", "shell: pwsh, receiver: installed")
    missing = remote.rarms("plan")
    remote.ask(installed=["0.0.1", "0.0.2"])
    other = remote.rarms("plan")
    examined = remote.rarms("doctor")
    remote.ask(installed=["0.0.1", __version__])

    applied = apply(remote)

    assert (missing.code, other.code, applied.code) == (1, 1, 0), (missing, other, applied)
    assert f"the module Rarms {__version__} is not installed on cell, which has: 0.0.1 0.0.2" in " ".join(
        other.err.split()
    )
    for refused in (missing, other, examined):
        assert "rarms show --transport --out FOLDER" in " ".join((refused.out + refused.err).split())
    assert is_as_wanted(remote)


def test_host_runs_exact_bytes_and_keeps_no_copy(remote: Remote) -> None:
    assert remote.rarms("plan", "--out", "plan.json").code == 0
    scripts = json.loads(remote.rarms("show", "plan.json", "--json").out)["hosts"][0]["scripts"]

    applied = remote.rarms("apply", "plan.json")

    assert applied.code == 0, applied
    assert journal_of(remote)[0]["script"] == scripts["onboard.ps1"]
    assert journal_of(remote)[0]["undo"] == scripts["onboard.undo.ps1"]
    received = Path((remote.folder / "received").read_text(encoding="utf-8"))
    assert not received.exists()
    assert remote.rarms("apply", "plan.json").code == 3, "a plan is used once"


def test_signature_policy_runs_reviewed_scripts(remote: Remote) -> None:
    host = an_empty_host()
    host.all_signed = True
    remote.put(host)
    folder = remote.folder / ".rarms" / "signed"

    def sign(*words: str) -> None:
        assert remote.rarms(*words).code == 0
        for path in (*folder.glob("*.ps1"), *folder.glob("Rarms/*")):
            path.write_bytes(signed(without_signature(path.read_bytes().decode("ascii")).encode("ascii")))

    try:
        unsigned = remote.rarms("plan")
        folder.mkdir(parents=True)
        sign("snapshot", "--script", "--out", ".rarms/signed/observe.ps1")
        assert remote.rarms("plan", "--out", "plan.json").code == 0
        not_yet = remote.rarms("apply", "plan.json")
        sign("show", "plan.json", "--script", "--out", ".rarms/signed")
        applied = remote.rarms("apply", "plan.json")
        assert applied.code == 0, applied
        assert is_as_wanted(remote)
        assert "# SIG # End" in str(journal_of(remote)[0]["undo"])
        undone = remote.rarms("undo", "--auto-approve")
    finally:
        shutil.rmtree(folder, ignore_errors=True)

    assert undone.code == 0, undone
    assert not remote.host.vms
    for refused in (unsigned, not_yet):
        assert refused.code == 1, refused
        assert "is not digitally signed" in " ".join(refused.err.split())


def test_garbled_scripts_are_not_run(remote: Remote) -> None:
    remote.ask(garbles=True)

    refused = remote.rarms("plan")

    assert refused.code == 1
    assert "received damaged scripts" in " ".join(refused.err.split())
    assert remote.host.file(JOURNAL) is None


def test_broken_connection_is_unknown_and_finished_later(remote: Remote) -> None:
    remote.ask(step_ms=250)
    running = remote.start("apply", "--auto-approve")
    after_steps(remote, 3)

    remote.cut()

    lost = finish(running)
    assert lost.code == 1, lost
    assert "RARMS250" in lost.err
    assert "Run `rarms apply` to read the journal of the host" in " ".join(lost.err.split())
    remote.ask()
    finished = apply(remote)
    while finished.code == 3:  # the script there goes on until its next step
        time.sleep(0.2)
        finished = apply(remote)
    assert finished.code == 0, finished
    assert "continued from an earlier run" in " ".join(finished.err.split())
    assert is_as_wanted(remote)


def test_host_changed_since_look_is_not_touched(remote: Remote) -> None:
    remote.ask(meddles_with="host")
    refused = apply(remote)
    remote.ask()

    assert refused.code == 3, refused
    assert "No step was done. Show the state with `rarms drift`, then make a new plan." in " ".join(refused.err.split())
    assert remote.rarms("drift").code == 5, "nothing of it is applied yet"
    change_manifest(remote, "logical_processors: 8", "logical_processors: 7")
    assert remote.rarms("plan", "--out", "new.json").code == 0
    assert remote.rarms("apply", "new.json").code == 0


def test_machine_with_foreign_mark_is_adopted_as_recommended(remote: Remote) -> None:
    assert apply(remote).code == 0
    host = remote.host
    (vision,) = (vm for vm in host.vms.values() if vm.name == "vision")
    vision.notes = re.sub("vm=[0-9a-f]{8}", "vm=00000000", vision.notes)
    remote.put(host)

    planned = remote.rarms("plan")
    assert "import the correct machine with `rarms import PARTITION --id ID`" in " ".join(planned.err.split())
    assert remote.rarms("import", "vision", "--id", vision.id, "--auto-approve").code == 0
    assert is_as_wanted(remote)


def test_elevated_apply_does_what_plain_cannot(remote: Remote) -> None:
    remote.put(an_empty_host().copy(elevated=False, hyperv_administrator=True))
    examined = remote.rarms("doctor")
    remote.put(an_empty_host())

    assert "Run `rarms apply` from a prompt opened with" in " ".join(examined.out.split())
    assert apply(remote).code == 0


def test_ctrl_c_stops_after_step_and_apply_continues(remote: Remote) -> None:
    remote.ask(step_ms=250)
    running = remote.start("apply", "--auto-approve")
    after_steps(remote, 2)

    running.send_signal(signal.SIGINT)

    stopped = finish(running)
    assert stopped.code == 130, stopped
    assert "rarms apply" in stopped.err
    statuses = [record.get("status") for record in journal_of(remote)]
    assert statuses.count("begun") == statuses.count("changed") < 16
    remote.ask()
    assert apply(remote).code == 0
    assert is_as_wanted(remote)


def test_noise_on_streams_harms_nothing(remote: Remote) -> None:
    noise = ["Welcome to CELL-4", "{", '{"format":"rarms-event/9"}', "\u001b[31mred"]
    remote.ask(noise=noise, warnings=["WARNING: a module was loaded twice"])

    applied = apply(remote)

    assert applied.code == 0, applied
    assert "onboard printed: Welcome to CELL-4" in applied.err
    assert "\x1b" not in applied.err
    assert is_as_wanted(remote)


def test_silent_script_is_unknown(remote: Remote) -> None:
    assert remote.rarms("plan", "--out", "plan.json").code == 0
    remote.ask(step_ms=3000)

    lost = remote.rarms("apply", "plan.json", "--event-timeout", "1s")

    assert lost.code == 1, lost
    assert "no output for 1 s" in " ".join(lost.err.split())


def test_powershells_refusal_is_told(remote: Remote) -> None:
    remote.ask(refuses="observe.ps1 cannot be loaded because running scripts is disabled on this system.")

    failed = remote.rarms("plan")

    assert failed.code == 1
    assert "running scripts is disabled" in " ".join(failed.err.split())


def test_unreachable_host_is_told_in_sshs_words(remote: Remote) -> None:
    manifest = remote.folder / "rarms.yaml"
    manifest.write_text(MANIFEST.replace("ssh: cell", "ssh: nobody@127.0.0.1"), encoding="utf-8", newline="\n")

    failed = remote.rarms("plan")

    assert failed.code == 1
    assert "ssh does not reach nobody@127.0.0.1" in " ".join(failed.err.split())
    assert "ssh -o BatchMode=yes" in failed.err


def test_a_host_without_that_powershell_is_told(remote: Remote) -> None:
    manifest = remote.folder / "rarms.yaml"
    manifest.write_text(MANIFEST.replace("shell: pwsh", "shell: powershell"), encoding="utf-8", newline="\n")

    failed = remote.rarms("plan")

    assert failed.code == 1
    assert "powershell.exe does not start on cell" in " ".join(failed.err.split())
    assert "connect.shell" in failed.err


LOCAL = MANIFEST.replace("    connect: { ssh: cell, shell: pwsh }\n", "")


def test_on_the_host_itself_no_ssh_is_needed(remote: Remote) -> None:
    (remote.folder / "rarms.yaml").write_text(LOCAL, encoding="utf-8", newline="\n")
    elsewhere = remote.rarms("plan")

    applied = remote.rarms("apply", "--auto-approve", with_pwsh=True)

    assert elsewhere.code == 1
    assert "is not on this computer" in " ".join(elsewhere.err.split())
    assert applied.code == 0, applied
    assert EMPTY in remote.rarms("plan", with_pwsh=True).out
    assert remote.rarms("undo", "--auto-approve", with_pwsh=True).code == 0
    assert not remote.host.vms


def test_ctrl_c_stops_script_of_this_computer_too(remote: Remote) -> None:
    (remote.folder / "rarms.yaml").write_text(LOCAL, encoding="utf-8", newline="\n")
    remote.ask(step_ms=250)
    running = remote.start("apply", "--auto-approve", with_pwsh=True)
    after_steps(remote, 2)

    running.send_signal(signal.SIGINT)

    assert finish(running).code == 130
    remote.ask()
    assert remote.rarms("apply", with_pwsh=True).code == 0
    assert EMPTY in remote.rarms("plan", with_pwsh=True).out


def test_the_stand_in_says_what_it_is(remote: Remote) -> None:
    remote.ask(refuses="no")

    assert "stand-in" in STAND_IN
    assert STAND_IN in " ".join(remote.rarms("plan").err.split())
