"""Without `-f` the manifest is also looked for above the current folder, within the git repository."""

import os
from contextlib import chdir
from pathlib import Path

import pytest

from rarms_iac.cli.ending import ExitCode
from tests.unit.cli.running import rarms

pytestmark = pytest.mark.needs("posix")


@pytest.fixture
def below(tmp_path: Path) -> Path:
    """A folder two levels below a manifest that lies in the root of a repository."""
    (tmp_path / "robot" / ".git").mkdir(parents=True)
    assert rarms("init", str(tmp_path / "robot"), "--name", "robot").code == 0
    folder = tmp_path / "robot" / "src" / "vision"
    folder.mkdir(parents=True)
    return folder


def test_the_manifest_above_is_used_and_named(below: Path) -> None:
    with chdir(below):
        planned, validated, status = rarms("plan"), rarms("validate"), rarms()

    assert (planned.code, validated.code, status.code) == (0, 0, 0)
    assert planned.err.startswith("The manifest is ../../rarms.yaml.\n")
    assert "from ../../rarms.yaml" in planned.out


def test_nearest_manifest_counts(below: Path) -> None:
    (below.parent / "rarms.yaml").write_bytes((below.parents[1] / "rarms.yaml").read_bytes())
    with chdir(below):
        nearest = rarms("plan")
    with chdir(below.parent):
        here = rarms("plan")

    assert "from ../rarms.yaml" in nearest.out
    assert "The manifest is" not in here.err


def test_nothing_above_root_of_repository_is_looked_at(below: Path) -> None:
    (below / ".git").mkdir()
    with chdir(below):
        in_another = rarms("plan")
    (below / ".git").rmdir()
    (below.parents[1] / ".git").rmdir()
    with chdir(below):
        in_none = rarms("plan")

    assert (in_another.code, in_none.code) == (ExitCode.USAGE, ExitCode.USAGE)


def test_manifest_that_is_named_is_not_looked_for(below: Path) -> None:
    with chdir(below):
        assert rarms("plan", "-f", "rarms.yaml").code == ExitCode.USAGE


@pytest.mark.needs("root")
@pytest.mark.parametrize("other", ["src", ".", "rarms.yaml"])
def test_another_users_folder_or_file_is_not_used(below: Path, other: str) -> None:
    os.chown(below.parents[1] / other, 12345, -1)
    with chdir(below):
        assert rarms("plan").code == ExitCode.USAGE
