"""`rarms measure --script` on the stand-in: the scripts that measuring would run are shown, and none is run."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from rarms_iac.cli.main import main
from tests.fake_powershell import program as powershell
from tests.fake_powershell.host import WindowsHost
from tests.fake_powershell.measuring import MANIFEST, a_measurable_windows
from tests.needs import CHECKOUT
from tests.remote import pwsh

__all__ = ["pwsh"]


@pytest.mark.needs("posix")
@pytest.mark.usefixtures("pwsh")
def test_measuring_scripts_are_shown_and_can_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    powershell.save(tmp_path, a_measurable_windows())

    assert main(["measure", "--script"]) == 0
    shown = capsys.readouterr().out
    assert main(["measure", "--script", "--out", "scripts"]) == 0

    names = ["cell.remove.measure.ps1", "cell.vision.busy-loop.measure.ps1"]
    assert [path.name for path in sorted((tmp_path / "scripts").iterdir())] == [".gitattributes", *names]
    assert all(name in shown for name in names)
    assert "Add-TestPartition -Name 'rarms-p1'" in shown
    for name in names:
        assert main(["show", "--check", f"scripts/{name}"]) == 0
    assert powershell.load(tmp_path).vms == {}


@pytest.mark.needs("posix")
@pytest.mark.usefixtures("pwsh")
def test_a_measurement_whose_rarms_is_killed_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    powershell.save(tmp_path, a_measurable_windows())
    environment = {**os.environ, "PYTHONPATH": str(CHECKOUT)}
    words = [
        sys.executable,
        "-m",
        "rarms_iac.cli.main",
        "measure",
        "--samples",
        "100000",
        "--from",
        "40%",
        "--to",
        "40%",
    ]
    rarms = subprocess.Popen(words, cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)

    wait_until(lambda: rarms.poll() is not None or 40 in [vm.reserve for vm in powershell.load(tmp_path).vms.values()])
    assert rarms.poll() is None, rarms.communicate()[1]
    rarms.kill()
    rarms.communicate()

    wait_until(lambda: is_empty(powershell.load(tmp_path)))


def is_empty(host: WindowsHost) -> bool:
    """Neither a machine nor a file of a measurement is there."""
    return host.vms == {} and not any("rarms-p" in path for path in host.files)


def wait_until(happened: Callable[[], bool]) -> None:
    for _ in range(2000):
        if happened():
            return
        time.sleep(0.05)
    raise AssertionError("it did not happen")
