"""A Hyper-V host by WinRM, with stand-ins for pypsrp and PowerShell: what is true over ssh is true here."""

import json
from collections.abc import Iterator

import pytest

from tests.remote import Remote, by_winrm
from tests.system.test_remote_host import (
    MANIFEST,
    an_empty_host,
    apply,
    is_as_wanted,
    journal_of,
    test_a_host_without_that_powershell_is_told,
    test_apply_ends_empty_and_undo_restores,
    test_ctrl_c_stops_after_step_and_apply_continues,
    test_garbled_scripts_are_not_run,
    test_host_runs_exact_bytes_and_keeps_no_copy,
    test_installed_module_of_another_version_is_refused,
    test_noise_on_streams_harms_nothing,
    test_powershells_refusal_is_told,
    test_signature_policy_runs_reviewed_scripts,
    test_silent_script_is_unknown,
)

__all__ = [
    "test_a_host_without_that_powershell_is_told",
    "test_apply_ends_empty_and_undo_restores",
    "test_ctrl_c_stops_after_step_and_apply_continues",
    "test_garbled_scripts_are_not_run",
    "test_host_runs_exact_bytes_and_keeps_no_copy",
    "test_installed_module_of_another_version_is_refused",
    "test_noise_on_streams_harms_nothing",
    "test_powershells_refusal_is_told",
    "test_signature_policy_runs_reviewed_scripts",
    "test_silent_script_is_unknown",
]

pytestmark = [pytest.mark.needs("linux")]

SSH = "connect: { ssh: cell, shell: pwsh }"
WINRM = "connect: { winrm: cell, shell: pwsh, user: rarms, password: { from_env: CELL_PASSWORD } }"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Remote:
    return by_winrm(tmp_path_factory.mktemp("winrm"), an_empty_host())


@pytest.fixture
def remote(server: Remote, monkeypatch: pytest.MonkeyPatch) -> Iterator[Remote]:
    """The host, empty and behaving, and a fresh manifest; those that tests of ssh write have this way, too."""
    monkeypatch.setattr("tests.system.test_remote_host.MANIFEST", MANIFEST.replace(SSH, WINRM))
    server.put(an_empty_host())
    server.ask()
    write(server)
    yield server
    server.ask()


def write(remote: Remote, connect: str = WINRM) -> None:
    (remote.folder / "rarms.yaml").write_text(MANIFEST.replace(SSH, connect), encoding="utf-8", newline="\n")


def in_a_line(text: str) -> str:
    return " ".join(text.split())


def test_broken_connection_is_unknown_then_finished(remote: Remote) -> None:
    broken = Remote(remote.folder, None, {**remote.variables, "WINRM_BREAKS": "1"})

    lost = apply(broken)

    assert lost.code == 1, lost
    assert "RARMS250" in lost.err
    finished = apply(remote)
    while finished.code == 3:  # the script there goes on until it notices
        finished = apply(remote)
    assert finished.code == 0, finished
    assert is_as_wanted(remote)


def test_what_plan_and_journal_hold_never_has_password(remote: Remote) -> None:
    assert remote.rarms("plan", "--out", "plan.json").code == 0
    assert remote.rarms("apply", "plan.json").code == 0

    written = "".join(path.read_text(encoding="utf-8") for path in remote.folder.rglob("*.json*"))
    assert remote.variables["CELL_PASSWORD"] not in written + json.dumps(journal_of(remote))
    assert "CELL_PASSWORD" in written


@pytest.mark.parametrize(
    ("connect", "variables", "message"),
    [
        (WINRM, {"CELL_PASSWORD": "another"}, "WinRM does not reach cell: Failed to authenticate the user"),
        (WINRM.replace("cell", "refused"), {}, "WinRM does not reach refused: Connection refused"),
        (WINRM.replace("CELL_", "NO_"), {}, "the variable NO_PASSWORD for the password of rarms is not set"),
        (WINRM, {"PYTHONPATH": "."}, "In the clone's .venv: `.venv/bin/pip install -e '.[winrm]'`."),
    ],
    ids=["password", "service", "variable", "package"],
)
def test_unreachable_host_is_told_with_advice(
    remote: Remote, connect: str, variables: dict[str, str], message: str
) -> None:
    from tests.needs import CHECKOUT

    given = {name: str(CHECKOUT) if value == "." else value for name, value in variables.items()}
    write(remote, connect)

    failed = Remote(remote.folder, None, {**remote.variables, **given}).rarms("plan")

    assert failed.code == 1
    assert message in in_a_line(failed.err)
    assert "another" not in failed.err


def test_kerberos_ticket_serves_without_user(remote: Remote) -> None:
    write(remote, "connect: { winrm: cell }")

    assert remote.rarms("plan").code == 0


def test_measuring_over_winrm_is_refused(remote: Remote) -> None:
    run = "run: { command: [app.exe], samples: { from: pattern, pattern: 'ms=([0-9.]+)' }, until: { samples: 10 } }"
    text = (remote.folder / "rarms.yaml").read_text(encoding="utf-8")
    text = text.replace(
        "memory: 16 GiB\n", "memory: 16 GiB\n    hyperv: { credential: robots, image: 'D:\\guest.vhdx' }\n"
    )
    text = text.replace("cpu: { reserve: 20 % } }", f"cpu: {{ reserve: 20 % }}, {run} }}")
    (remote.folder / "rarms.yaml").write_text(text, encoding="utf-8", newline="\n")

    refused = remote.rarms("measure", "vision", "--from", "10%", "--to", "100%")

    assert refused.code == 1, refused
    assert "cannot measure over WinRM" in in_a_line(refused.err)
    assert not remote.host.vms
