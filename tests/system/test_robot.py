"""A Linux host behind a real sshd, which is this machine: the operator's way over it, and connections that break."""

import json
import shutil
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.providers.cgroups.provider import STATE_FOLDER
from tests.contracts.benches import forget_groups, groups_of, slice_of
from tests.robot_install import on_robot, robot_rarms
from tests.standin.remote import Remote, a_server
from tests.system.test_linux_walk import MANIFEST
from tests.unit.cli.running import Ran, rarms

__all__ = ["robot_rarms"]

pytestmark = [pytest.mark.needs("ssh", "control-groups", "mounts"), pytest.mark.alone]


@pytest.fixture(scope="module")
def server(robot_rarms: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Remote]:
    with a_server(tmp_path_factory.mktemp("server"), partial(on_robot, robot_rarms)) as remote:
        yield remote


@pytest.fixture
def folder(server: Remote, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A manifest whose host is reached over ssh; its control groups are gone after the test."""
    text = MANIFEST.format(slice=slice_of(tmp_path)).replace("linux\n", "linux\n    connect: { ssh: cell }\n")
    (tmp_path / "rarms.yaml").write_text(text, encoding="utf-8")
    monkeypatch.setenv("PATH", server.environment["PATH"])
    yield tmp_path
    forget_groups(tmp_path)
    shutil.rmtree(STATE_FOLDER / slice_of(tmp_path), ignore_errors=True)


def run(folder: Path, command: str, *words: str) -> Ran:
    return rarms(command, *words, "-f", str(folder))


def apply(folder: Path) -> Ran:
    return run(folder, "apply", "--auto-approve")


def partitions(folder: Path) -> list[dict[str, Any]]:
    """Those of a snapshot."""
    assert run(folder, "snapshot", "--out", str(folder / "snapshot.json")).code == 0
    document: Any = json.loads((folder / "snapshot.json").read_text(encoding="utf-8"))
    return list(document["state"]["partitions"])


def test_plan_apply_drift_undo_and_destroy(folder: Path) -> None:
    assert run(folder, "plan").code == 0
    assert apply(folder).code == 0
    assert run(folder, "plan").code == 0
    (folder / "here").mkdir()
    text = (folder / "rarms.yaml").read_text(encoding="utf-8").replace("connect: { ssh: cell }", "")
    (folder / "here" / "rarms.yaml").write_text(text, encoding="utf-8")
    assert run(folder / "here", "plan").code == 0, "rarms on the host sees the same"
    tree = groups_of(folder)
    vision, speech = tree.name_for("face-detection"), tree.name_for("speech")
    assert tree.names() == tuple(sorted((vision, speech)))
    assert tree.read(vision).quota_percent == pytest.approx(80, abs=0.1)
    assert tree.read("").quota_percent == 180

    assert run(folder, "doctor").code == 0
    assert run(folder, "release", "speech", "--auto-approve").code == 0
    (released,) = (found for found in partitions(folder) if found["mark"] is None)
    assert run(folder, "import", "speech", "--id", released["id"], "--auto-approve").code == 0
    assert run(folder, "plan").code == 0

    tree._write_quota(vision, 120, 100_000)
    assert run(folder, "drift").code == 2
    assert apply(folder).code == 0
    assert tree.read(vision).quota_percent == pytest.approx(80, abs=0.1)

    kept = run(folder, "undo", "--keep", "--auto-approve")
    assert "partition/face-detection: stays as it was applied" in kept.err
    assert tree.read(vision).quota_percent == pytest.approx(80, abs=0.1)
    undone = run(folder, "undo", "--auto-approve")
    assert (kept.code, undone.code) == (0, 0)
    assert "limit 1.2 LP was not set by rarms; the apply set 0.8 LP." in " ".join(undone.err.split())
    assert tree.read(vision).quota_percent == pytest.approx(120, abs=0.1)
    assert run(folder, "destroy", "--auto-approve").code == 0
    assert tree.names() == ()


def test_a_host_with_another_key_is_not_trusted(folder: Path, server: Remote) -> None:
    known = server.folder / "known"
    run(folder, "plan")
    original = known.read_text(encoding="ascii")
    host, kind, _ = original.split(maxsplit=2)
    key = (server.folder / "key.pub").read_text(encoding="ascii").split()[1]
    known.write_text(f"{host} {kind} {key}\n", encoding="ascii")

    refused = run(folder, "plan")

    known.write_text(original, encoding="ascii")
    assert refused.code == 1
    assert "Host key verification failed" in " ".join(refused.err.split())
    assert "ssh -o BatchMode=yes cell" in " ".join(refused.err.split())
