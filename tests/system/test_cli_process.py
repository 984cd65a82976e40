"""What only a process of its own can show: signals, pipes and encodings."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.unit.cli.running import rarms

RARMS = [sys.executable, "-m", "rarms_iac.cli.main"]


def run(*words: str, **environment: str) -> "subprocess.CompletedProcess[bytes]":
    """The command as a process."""
    return subprocess.run([*RARMS, *words], capture_output=True, env={**os.environ, **environment}, timeout=300)


@pytest.fixture
def manifest(tmp_path: Path) -> Path:
    """A manifest that `init` wrote."""
    assert rarms("init", str(tmp_path)).code == 0
    return tmp_path / "rarms.yaml"


@pytest.mark.sample
def test_an_ascii_stream_never_breaks_a_command(tmp_path: Path) -> None:
    name = tmp_path / "Prüfung.yaml"

    answer = run("validate", str(name), PYTHONIOENCODING="ascii", PYTHONUTF8="0")

    assert answer.returncode == 64
    assert b"Pr\\xfcfung.yaml" in answer.stdout
    assert b"Traceback" not in answer.stderr


@pytest.mark.sample
def test_pipe_gets_no_colour_and_unix_line_ends(manifest: Path) -> None:
    planned = run("plan", "-f", str(manifest), NO_COLOR="").stdout

    assert planned.count(b"\n") > 5
    assert not set(b"\x1b\r") & set(planned)


@pytest.mark.needs("posix", "bash")
@pytest.mark.parametrize(
    ("words", "reader"),
    [(["plan"], "head -n 1"), (["--help"], "true"), (["--version"], "true"), (["measure", "--help"], "true")],
)
def test_reader_that_stops_changes_no_exit_code(manifest: Path, words: list[str], reader: str) -> None:
    quoted = " ".join(f"'{word}'" for word in [*RARMS, *words])
    script = f"cd '{manifest.parent}'; {quoted} | {reader}; echo ${{PIPESTATUS[0]}}"
    environment = {**os.environ, "PYTHONUNBUFFERED": ""}

    answer = subprocess.run(["bash", "-c", script], capture_output=True, text=True, env=environment, timeout=300)

    assert answer.stdout.splitlines()[-1] == "0"
    assert answer.stderr == ("Next: `rarms apply`\n" if words == ["plan"] else "")


@pytest.mark.needs("posix", "bash")
@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_process_without_a_stream_works(manifest: Path, closed: str) -> None:
    words = " ".join(f"'{word}'" for word in [*RARMS, "apply", "-f", str(manifest), "--auto-approve"])

    answer = subprocess.run(["bash", "-c", f"{words} {closed}"], capture_output=True, text=True, timeout=300)

    assert answer.returncode == 0
    assert "Traceback" not in answer.stderr
    assert rarms("plan", "-f", str(manifest)).code == 0


@pytest.mark.needs("posix", "bash")
def test_json_without_standard_output_is_refused_first(manifest: Path) -> None:
    words = " ".join(f"'{word}'" for word in [*RARMS, "apply", "-f", str(manifest), "--auto-approve", "--json"])

    answer = subprocess.run(["bash", "-c", f"{words} >&-"], capture_output=True, text=True, timeout=300)

    assert answer.returncode == 1
    assert answer.stderr.startswith("error[RARMS178]")
    assert answer.stderr.count("Standard output is closed") == 1
    assert not (manifest.parent / ".rarms" / "hosts").exists()


@pytest.mark.needs("linux")
def test_full_disk_for_programs_is_told_without_trace(tmp_path: Path) -> None:
    words = [*RARMS, "plan", "-f", str(tmp_path / "missing.yaml"), "--json"]
    with Path("/dev/full").open("wb") as full:
        answer = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, timeout=300)

    assert answer.returncode == 1
    assert b"error[RARMS178]" in answer.stderr
    assert b"Traceback" not in answer.stderr


@pytest.mark.needs("linux")
def test_a_full_disk_is_told_without_a_trace(manifest: Path) -> None:
    with Path("/dev/full").open("wb") as full:
        answer = subprocess.run([*RARMS, "plan", "-f", str(manifest)], stdout=full, stderr=subprocess.PIPE, timeout=300)

    assert answer.returncode == 1
    assert answer.stderr.startswith(b"error[RARMS178]")
    assert b"Exception ignored" not in answer.stderr


@pytest.mark.needs("posix")
@pytest.mark.parametrize(
    ("number", "code"), [pytest.param(signal.SIGINT, 130, marks=pytest.mark.sample), (signal.SIGTERM, 143)]
)
def test_signal_stops_after_running_step_and_apply_finishes(manifest: Path, number: signal.Signals, code: int) -> None:
    late = '{ faults: { slow: { operation: set_cpu, at: "*", effect: late, delay: 4 s, times: 1 } } }'
    text = manifest.read_text(encoding="utf-8")
    manifest.write_text(
        text.replace("provider: simulated", f"provider: simulated\n    simulated: {late}\n    #"), encoding="utf-8"
    )
    words = [*RARMS, "apply", "-f", str(manifest), "--auto-approve"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        journal = manifest.parent / ".rarms" / "hosts" / "onboard.journal.jsonl"
        deadline = time.monotonic() + 120
        while not (journal.is_file() and journal.read_bytes().count(b"\n") >= 6) and time.monotonic() < deadline:
            time.sleep(0.01)
        process.send_signal(number)
        _, said = process.communicate(timeout=300)

    assert process.returncode == code, said.decode()
    plain = " ".join(said.decode().split())  # as wide as the terminal
    assert "Stopping. A second Ctrl-C stops at once." in plain
    assert "Stopped after the current step." in plain
    assert "rarms undo" in plain
    assert "Traceback" not in plain
    assert rarms("apply", "-f", str(manifest)).code == 0
    assert rarms("plan", "-f", str(manifest)).code == 0
