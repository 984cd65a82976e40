"""The engines start, say what they say, and are killed; under wine with a prefix of their own."""

import signal
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.real_powershell.engines import Engine, finish, kill, processes, windows_python

pytestmark = pytest.mark.sample
REGISTRY = r"""
$null = New-Item -Path 'HKCU:\Software\rarms-probe' -Value 'a registry' -Force
(Get-Item -LiteralPath 'HKCU:\Software\rarms-probe').GetValue('')
Remove-Item -LiteralPath 'HKCU:\Software\rarms-probe'
"""
COMMAND = ("-NoProfile", "-NonInteractive", "-Command")


def begun_since(others: Sequence[int], engine: Engine) -> set[int]:
    return set(processes(engine, "pwsh.exe")) - set(others)


@pytest.mark.needs("powershell-windows")
def test_windows_engine_runs_a_script(windows: Engine, tmp_path: Path) -> None:
    script = tmp_path / "a script.ps1"
    script.write_text(
        f"param([string] $Word)\n{REGISTRY}\n$Word\n$env:A_WORD\n[Console]::Error.WriteLine('e')\nexit 7\n",
        encoding="utf-8",
    )

    ended = windows.run(
        "-NoProfile", "-File", windows.path(script), "-Word", 'a "b" c', environment={"A_WORD": "d"}, folder=tmp_path
    )

    assert (ended.code, ended.out.splitlines(), ended.err) == (7, ["a registry", 'a "b" c', "d"], "e")


@pytest.mark.needs("powershell-linux")
def test_linux_engine_runs_a_script(linux: Engine, tmp_path: Path) -> None:
    script = tmp_path / "a script.ps1"
    script.write_text("param([string] $Word)\n$Word\n(Get-Location).Path\nexit 7\n", encoding="utf-8")

    ended = linux.run("-NoProfile", "-File", linux.path(script), "-Word", 'a "b" c', folder=tmp_path)

    assert (ended.code, ended.out.splitlines(), ended.err) == (7, ['a "b" c', str(tmp_path)], "")


@pytest.mark.needs("powershell-windows")
def test_windows_engine_reads_its_input(windows: Engine) -> None:
    command = "[Console]::In.ReadLine(); exit 3"

    process = windows.start(*COMMAND, command, with_input=True)
    out, _ = process.communicate(b"a line\n", timeout=60)

    assert (process.returncode, out) == (3, b"a line\r\n")


@pytest.mark.needs("powershell-windows", "windows-python")
def test_windows_python_starts_powershell(windows: Engine) -> None:
    words = [windows.program if not windows.prefix else windows.path(Path(windows.program)), *COMMAND, "1 + 1; exit 5"]
    program = f"import subprocess as s; p = s.run({words!r}, capture_output=True, input=b''); print(p)"

    ended = windows.run("-c", program, program=windows_python(windows))

    assert r"returncode=5, stdout=b'2\r\n'" in ended.out, ended


@pytest.mark.needs("powershell-windows", "wine")
def test_killed_windows_engine_is_gone(windows: Engine) -> None:
    others = processes(windows, "pwsh.exe")  # other tests of this process may keep a warm engine in its prefix
    process = windows.start(*COMMAND, "'ready'; Start-Sleep 600")
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\r\n"
    running = processes(windows, "pwsh.exe")

    kill(process)

    assert process.pid in running
    assert process.returncode == -signal.SIGKILL
    left, tries = begun_since(others, windows), 100
    while left and tries:  # the kernel takes a moment to remove them
        time.sleep(0.1)
        left, tries = begun_since(others, windows), tries - 1
    assert not left
    assert finish(windows.start(*COMMAND, "exit 4")).code == 4
