"""`rarms measure --script` on the stand-in: every script that measuring would run, shown and inspected, and none run."""

from pathlib import Path

import pytest

from rarms_iac.cli.main import main
from tests.standin import powershell
from tests.standin.remote import pwsh
from tests.twin.cells import a_windows
from tests.twin.measuring import MANIFEST

__all__ = ["pwsh"]


@pytest.mark.needs("posix")
@pytest.mark.usefixtures("pwsh")
def test_the_scripts_are_shown_and_pass_the_inspection(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    host = a_windows()
    powershell.save(tmp_path, host)

    assert main(["measure", "--script"]) == 0
    shown = capsys.readouterr().out
    assert main(["measure", "--script", "--out", "scripts"]) == 0

    names = ["cell.remove.measure.ps1", "cell.vision.measure.ps1"]
    assert [path.name for path in sorted((tmp_path / "scripts").iterdir())] == names
    assert all(name in shown for name in names)
    assert "Add-TestPartition -Name 'rarms-p1'" in shown
    for name in names:
        assert main(["show", "--check", f"scripts/{name}"]) == 0
    assert powershell.load(tmp_path).vms == {}
