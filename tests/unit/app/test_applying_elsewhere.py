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
        assert rarms("plan", "--out", "change.plan").code == 2
    return folder


def test_in_another_folder_the_plan_is_refused_and_no_host_is_made(planned: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    with chdir(elsewhere):
        answer = rarms("apply", str(planned / "change.plan"))

    assert answer.code == 3
    assert "RARMS213" in answer.err
    assert not list(elsewhere.iterdir())


def test_from_another_folder_the_manifest_can_be_named(planned: Path, tmp_path: Path) -> None:
    with chdir(tmp_path):
        answer = rarms("apply", str(planned / "change.plan"), "-f", str(planned))

    assert answer.code == 0
    assert (planned / ".rarms" / "hosts").is_dir()


def test_a_manifest_that_changed_since_the_plan_is_a_note_and_the_plan_is_applied(planned: Path) -> None:
    with chdir(planned):
        Path("rarms.yaml").write_text(Path("rarms.yaml").read_text(encoding="utf-8") + "# later\n", encoding="utf-8")
        answer = rarms("apply", "change.plan")

    assert answer.code == 0
    assert "note: rarms.yaml has changed since plan " in answer.err


def test_a_manifest_that_is_as_the_plan_saw_it_is_not_spoken_of(planned: Path) -> None:
    with chdir(planned):
        assert "has changed" not in rarms("apply", "change.plan").err
