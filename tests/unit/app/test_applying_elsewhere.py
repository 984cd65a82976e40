"""A plan for a simulated host is applied where its host lies, and nowhere else."""

from contextlib import chdir
from pathlib import Path

import pytest

from tests.unit.cli.running import rarms


@pytest.fixture
def planned(tmp_path: Path) -> Path:
    """A folder with a manifest and a plan of it."""
    folder = tmp_path / "robot"
    assert rarms("init", str(folder), "--name", "robot").code == 0
    with chdir(folder):
        assert rarms("plan", "--out", "change.plan").code == 0
    return folder


def test_plan_in_another_folder_is_refused(planned: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    with chdir(elsewhere):
        answer = rarms("apply", str(planned / "change.plan"))

    assert answer.code == 3
    assert "RARMS182" in answer.err
    assert not list(elsewhere.iterdir())
