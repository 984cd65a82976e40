"""Files that one process writes while another reads them, by the rules of Windows; paths as people give them."""

import hashlib
import os
import signal
import subprocess
from pathlib import Path

import pytest

from rarms_iac.powershell.templates import MODULE_FILES, fill, module_digests, module_file
from tests.needs import CHECKOUT
from tests.real_powershell.engines import Engine, finish, kill, processes, windows_python

pytestmark = pytest.mark.needs("powershell-windows", "wine")

RECORDS, SETTINGS = 60, 60

READER = """param([string] $From, [string] $Path)
$module = Import-Module -Name $From -PassThru
$looks = 0
[System.IO.File]::WriteAllText($Path + '.ready', 'x')
while (-not [System.IO.File]::Exists($Path + '.end')) {
    if ($null -eq (& $module { param($path) Read-SharedFile -Path $path } $Path)) { throw 'missing' }
    $looks++
}
'looks: {0}' -f ($looks -gt 0)
"""

LOOKER = """import sys
from pathlib import Path
from rarms_iac.providers.hyperv import local_windows

journal, looks = Path(sys.argv[1]), 0
local_windows.own_folder = lambda: journal.parent
Path(f"{journal}.ready").touch()
while not Path(f"{journal}.end").exists():
    owner, _ = local_windows.ThisWindows().journal()
    assert owner.startswith("S-1-"), owner
    looks += 1
print("looks:", looks > 0)
"""

WRITER = """param([string] $From, [string] $Path, [int] $Count)
$ErrorActionPreference = 'Stop'
$module = Import-Module -Name $From -PassThru
while (-not [System.IO.File]::Exists($Path + '.ready')) { Start-Sleep -Milliseconds 50 }
try {
    & $module {
        param($path, $count)
        Initialize-Run
        $script:Journal = $path
        $script:Run = @{ ScriptPath = $PSCommandPath; ModulePath = '' }
        $script:Plan = @{ Undo = ''; Application = 'a'; Run = 'apply'; Plan = 'p'; Robot = ''; Purpose = 'apply' }
        for ($number = 0; $number -lt $count; $number++) {
            if ($number % 5 -eq 0) { Write-FirstRecord }
            Add-Record -Record ([ordered] @{ number = $number; status = 'changed'; kind = 'step_recorded' })
        }
    } $Path $Count
    'written'
} finally { [System.IO.File]::WriteAllText($Path + '.end', 'x') }
"""

CHILD = """$module = Import-Module -Name '{module}' -PassThru
$seen = @{{}}
$next = $PSCommandPath + '.next'
[System.IO.File]::WriteAllText('{ready}', 'x')
while (-not [System.IO.File]::Exists($PSCommandPath + '.stop')) {{
    $text = '' + (& $module {{ param($path) Read-SharedFile -Path $path }} $next)
    if ($text) {{ $seen[$text] = 1 }}
}}
'saw many: {{0}}' -f ($seen.Count -gt {many})
"""

RECEIVER = """param([string] $From)
$module = Import-Module -Name $From -PassThru
$invoke = $module.ExportedFunctions['Receive-RarmsPlan']
exit (& $invoke -Source ([Console]::OpenStandardInput()))
"""


@pytest.fixture
def module(windows: Engine, tmp_path: Path) -> str:
    """The path of the module as a program of the engine reads it."""
    return windows.path(laid(tmp_path / "Rarms") / MODULE_FILES[1])


def laid(folder: Path) -> Path:
    folder.mkdir(parents=True)
    for name in MODULE_FILES:
        (folder / name).write_bytes(module_file(name))
    return folder


def words(windows: Engine, folder: Path, name: str, text: str) -> tuple[str, ...]:
    """The first arguments of a PowerShell that runs this script."""
    (folder / name).write_text(text, encoding="ascii")
    return ("-NoProfile", "-NonInteractive", "-File", windows.path(folder / name))


def test_reader_in_a_loop_breaks_no_writer(windows: Engine, tmp_path: Path, module: str) -> None:
    journal = tmp_path / "journal.jsonl"
    journal.write_bytes(b"")
    given = ("-From", module, "-Path", windows.path(journal))

    reader = windows.start(*words(windows, tmp_path, "reader.ps1", READER), *given)
    writer = windows.run(*words(windows, tmp_path, "writer.ps1", WRITER), *given, "-Count", str(RECORDS))
    looked = finish(reader)

    assert (writer.out.splitlines(), writer.err) == (["written"], ""), writer
    assert (looked.out.splitlines(), looked.err) == (["looks: True"], ""), looked


@pytest.mark.needs("windows-python")
def test_rarms_that_looks_breaks_no_writer(windows: Engine, tmp_path: Path, module: str) -> None:
    journal = tmp_path / "journal.jsonl"
    journal.write_bytes(b"")
    (tmp_path / "looker.py").write_text(LOOKER, encoding="ascii")
    given = ("-From", module, "-Path", windows.path(journal), "-Count", str(RECORDS))

    looker = windows.start(
        windows.path(tmp_path / "looker.py"),
        windows.path(journal),
        program=windows_python(windows),
        environment={"PYTHONPATH": windows.path(CHECKOUT)},
    )
    writer = windows.run(*words(windows, tmp_path, "writer.ps1", WRITER), *given)
    looked = finish(looker)

    assert (writer.out.splitlines(), writer.err) == (["written"], ""), writer
    assert (looked.out.splitlines(), looked.err) == (["looks: True"], ""), looked


def test_settings_reach_a_script_that_reads_in_a_loop(windows: Engine, tmp_path: Path, module: str) -> None:
    ready = tmp_path / "ready"
    child = CHILD.format(module=module, ready=windows.path(ready), many=SETTINGS // 2)
    receiver = a_receiver(windows, tmp_path, module, child)
    assert receiver.stdin is not None
    try:
        wait_for(receiver, ready)
        for part in (b"1 run 40." * 99, b"2 run", b" 40."):  # many at once, and one in pieces
            receiver.stdin.write(part)
            receiver.stdin.flush()
            with pytest.raises(subprocess.TimeoutExpired):
                receiver.wait(0.5)
        for number in range(SETTINGS):
            receiver.stdin.write(f"{number} run 40.".encode("ascii"))
            receiver.stdin.flush()
            with pytest.raises(subprocess.TimeoutExpired):
                receiver.wait(0.25)
        receiver.stdin.write(b"s")
        receiver.stdin.flush()
        ended = finish(receiver)
    finally:
        if receiver.poll() is None:
            kill(receiver)

    assert (ended.code, ended.out.splitlines()) == (0, ["saw many: True"]), ended


def a_receiver(windows: Engine, folder: Path, module: str, child: str) -> subprocess.Popen[bytes]:
    """A receiver that has got a script."""
    script = child.encode("ascii")
    table = f"\nchild.ps1 {len(script)} {hashlib.sha256(script).hexdigest()}".encode("ascii")
    receiver = windows.start(*words(windows, folder, "receiver.ps1", RECEIVER), "-From", module, with_input=True)
    assert receiver.stdin is not None
    receiver.stdin.write(b"%08d" % len(table) + table + script)
    receiver.stdin.flush()
    return receiver


def test_next_receiver_removes_what_a_killed_one_left(windows: Engine, tmp_path: Path, module: str) -> None:
    def left() -> list[Path]:
        return sorted(windows.drive_c.glob("users/*/Temp/rarms-*"))

    before, running, ready = left(), processes(windows, "pwsh.exe"), tmp_path / "ready"
    sleeps = f"[System.IO.File]::WriteAllText('{windows.path(ready)}', [string] $PID)\nStart-Sleep -Seconds 600\n"
    killed = a_receiver(windows, tmp_path, module, sleeps)
    wait_for(killed, ready)
    (child,) = set(processes(windows, "pwsh.exe")) - {*running, killed.pid}
    (folder,) = set(left()) - set(before)

    os.kill(killed.pid, signal.SIGKILL)
    beside = finish(a_receiver(windows, tmp_path, module, "'beside'"))
    is_kept = folder.is_dir()
    os.kill(child, signal.SIGKILL)
    after = finish(a_receiver(windows, tmp_path, module, "'after'"))

    assert ([beside.out.strip(), after.out.strip()], is_kept) == (["beside", "after"], True), (beside, after)
    assert left() == before
    kill(killed)


def wait_for(process: subprocess.Popen[bytes], path: Path) -> None:
    """Wait until the file is there, as long as the process lives."""
    while not path.exists():
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(0.1)


def test_module_is_imported_in_a_folder_with_a_bracket(windows: Engine, tmp_path: Path) -> None:
    folder = tmp_path / "b [ro"
    laid(folder / "Rarms")
    head = fill("module.ps1.j2", {"version": "0", "digests": module_digests().items()}).decode("ascii")

    ended = windows.run(*words(windows, folder, "x.ps1", head + "$rarms.ExportedFunctions['Invoke-RarmsPlan'].Name\n"))

    assert (ended.code, ended.out.splitlines(), ended.err) == (0, ["Invoke-RarmsPlan"], ""), ended


def test_script_is_found_where_a_person_stands(windows: Engine, tmp_path: Path, module: str) -> None:
    (tmp_path / "x.ps1").write_text("", encoding="ascii")
    text = "Import-Module -Name '{}'\nSet-Location -LiteralPath '{}'\nStop-RarmsRun -Path .\\x.ps1\n"

    ended = windows.run(
        *words(windows, tmp_path, "ask.ps1", text.format(module, windows.path(tmp_path))), folder=Path("/")
    )

    assert (ended.code, ended.err) == (0, ""), ended
    assert (tmp_path / "x.ps1.stop").exists()
