"""Measuring on Windows as a whole: rarms, the receiver, the measuring script, and a load inside the model's guests."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.effort import LONG
from tests.fake_powershell.host import WindowsHost
from tests.fake_powershell.measuring import CREDENTIAL, MANIFEST, a_measurable_windows
from tests.real_powershell.engines import SECONDS, Engine, finish
from tests.real_powershell.on_windows import RarmsOnWindows, rarms_on
from tests.real_powershell.runner import RealPowerShell

pytestmark = pytest.mark.needs("powershell-windows", "wine", "windows-python")

SETTINGS = 500 if LONG else 30
DRIVER = """
import sys
from pathlib import Path
from rarms_iac.providers.channel import no_look
from rarms_iac.providers.hyperv.transport import FAILED, LocalTransport
from rarms_iac.providers.interface import ScriptBundle

script = Path(sys.argv[1])
bundle = ScriptBundle(runs=script.name, files={script.name: script.read_text("ascii")})

def hear(talk, *words):
    while line := talk.next_line(60.0, no_look):
        if all(word in line for word in words):
            return
        if line.startswith(FAILED) or '"kind":"failed"' in line:
            break
    sys.exit(f"it ended: {line}")

with LocalTransport("cell").session(bundle, ("-AsJson", "-Force")) as talk:
    hear(talk, '"ready"')
    for number in range(int(sys.argv[2])):
        setting = f"{2 * number + 1} run {20 + number % 40} 20 20 20."
        talk.send(setting.encode())
        hear(talk, setting, '"begun"')
        hear(talk, setting, "ended ")
        print(setting, flush=True)
        talk.send(f"{2 * number + 2} rest.".encode())
"""
LOOKER = """
import os, tempfile, time
from pathlib import Path

seen = 0
places = [*tempfile.gettempdir().split(";"), os.environ["PROGRAMDATA"] + r"\\rarms"]
while True:
    for path in [path for place in places for path in Path(place).rglob("*") if "rarms" in str(path)]:
        try:
            seen += len(path.read_bytes()) > 0
        except OSError:
            continue  # it went, or is a folder, or is written just now
    print(seen, flush=True)
    time.sleep(0.5)
"""


def secret_of(engine: Engine, host: WindowsHost) -> str:
    """The password of guests as a file keeps it: only this account of this Windows reads it."""
    plain = f"ConvertTo-SecureString -AsPlainText -Force -String '{host.guest_secret}'"
    return engine.answer(f"ConvertFrom-SecureString ({plain})")


@pytest.fixture
def host(windows: Engine) -> WindowsHost:
    host = a_measurable_windows()
    folder = CREDENTIAL.rpartition("\\")[0]
    for path in (folder.rpartition("\\")[0], folder):
        host.write_file(path, None)
    host.write_file(CREDENTIAL, f"{host.guest_user}\r\n{secret_of(windows, host)}\r\n".encode("ascii"))
    return host


@pytest.fixture
def cell(real: RealPowerShell, host: WindowsHost, tmp_path: Path) -> Iterator[RarmsOnWindows]:
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    with rarms_on(real, host, tmp_path) as cell:
        yield cell


def script_of(cell: RarmsOnWindows) -> str:
    """The measuring script that rarms would run, as a file."""
    written = cell.rarms("measure", "--script", "--out", "scripts")
    assert written.code == 0, written
    return "scripts/cell.vision.busy-loop.measure.ps1"


def test_component_is_measured_on_windows(cell: RarmsOnWindows, host: WindowsHost) -> None:
    measured = cell.rarms("measure", "--samples", "10", "--from", "40%", "--to", "40%")

    assert measured.code == 0, measured
    assert "40 %" in measured.out
    assert (host.vms, cell.left_behind()) == ({}, ["credentials"])


def test_looks_do_not_disturb_measuring(cell: RarmsOnWindows, host: WindowsHost) -> None:
    script = script_of(cell)
    looker = cell.python("-c", LOOKER)

    measured = finish(cell.python("-c", DRIVER, script, str(SETTINGS)), 7 * SECONDS)

    looker.kill()
    looks = looker.communicate()[0].split()
    assert measured.code == 0, measured
    assert len(measured.out.splitlines()) == SETTINGS
    assert int(looks[-1]) > len(looks) > 5
    assert host.vms == {}
    cell.wait_until(lambda: cell.left_behind() == ["credentials"])  # a file that a look had open goes with the look


def test_killed_receiver_ends_measuring(cell: RarmsOnWindows, host: WindowsHost) -> None:
    measuring = cell.python("-c", DRIVER, script_of(cell), "1000000")
    assert measuring.stdout is not None
    measuring.stdout.readline()
    assert {vm.name for vm in host.vms.values()} == {"rarms-p1", "rarms-p2", "rarms-p2b", "rarms-p2c"}

    cell.kill("pwsh.exe", word="-EncodedCommand")

    cell.wait_until(lambda: not cell.running("pwsh.exe"))
    assert finish(measuring).code == 1
    assert host.vms == {}
