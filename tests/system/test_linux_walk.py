"""The way of an operator over a Linux host: plan, apply, drift, undo, destroy, on real control groups.

It runs on the kernel of this machine, and in `tests/linux_machine/` with control groups of version 2 and with systemd.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.contracts.benches import forget_host, groups_of, slice_of
from tests.unit.cli.running import rarms

MANIFEST = """\
schema: rarms/v1
application: {{ name: robot }}
hosts:
  onboard:
    provider: linux
    logical_processors: 2
    memory: 1 GiB
    keep_for_host: {{ processor: 10 % }}
    linux: {{ slice: {slice} }}
components:
  face-detection: {{ criticality: 2, memory: 64 MiB, cpu: {{ reserve: 40 % }} }}
  speech: {{ criticality: 1, memory: 64 MiB, cpu: {{ reserve: 20 % }} }}
partitions:
  face-detection: {{ components: [face-detection], linux: {{ mechanism: quota }} }}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """A manifest whose host is this machine; its control groups are gone after the test."""
    (tmp_path / "rarms.yaml").write_text(MANIFEST.format(slice=slice_of(tmp_path)), encoding="utf-8")
    yield tmp_path
    forget_host(tmp_path)


@pytest.mark.needs("control-groups")
@pytest.mark.alone
@pytest.mark.sample
def test_plan_apply_drift_undo_and_destroy(folder: Path) -> None:
    where = ("-f", str(folder))
    planned = rarms("plan", *where, "--verbose")
    assert planned.code == 0
    assert "partition/face-detection is kept as a quota" in " ".join(planned.out.split())
    assert rarms("apply", *where, "--auto-approve").code == 0
    assert rarms("plan", *where).code == 0
    tree = groups_of(folder)
    vision, speech = tree.name_for("face-detection"), tree.name_for("speech")
    assert tree.names() == tuple(sorted((vision, speech)))
    assert tree.read(vision).quota_percent == pytest.approx(80, abs=0.1)
    assert tree.read("").quota_percent == 180

    tree._write_quota(vision, 120, 100_000)
    drifted = rarms("drift", *where)
    assert drifted.code == 2
    assert "limit" in drifted.out
    assert rarms("apply", *where, "--auto-approve").code == 0
    assert tree.read(vision).quota_percent == pytest.approx(80, abs=0.1)

    undone = rarms("undo", *where, "--auto-approve")
    assert undone.code == 0
    assert "rarms did not set limit 1.2 LP; the last apply set 0.8 LP." in " ".join(undone.err.split())
    assert tree.read(vision).quota_percent == pytest.approx(120, abs=0.1)
    assert rarms("destroy", *where, "--auto-approve").code == 0
    assert tree.names() == ()

    shown = rarms("show", "--script", *where)
    assert "Linux hosts do not have scripts (onboard)" in " ".join(shown.err.split())


@pytest.mark.needs("control-groups")
@pytest.mark.alone
def test_removed_entry_is_removed_and_undone(folder: Path) -> None:
    where, manifest = ("-f", str(folder)), folder / "rarms.yaml"
    assert rarms("apply", *where, "--auto-approve").code == 0
    tree = groups_of(folder)
    speech = tree.name_for("speech")
    before = tree.names(), tree.read(speech)
    lines = manifest.read_text(encoding="utf-8").splitlines(keepends=True)
    manifest.write_text("".join(line for line in lines if not line.startswith("  speech:")), encoding="utf-8")

    removed = rarms("apply", *where, "--auto-approve")
    assert removed.code == 0, removed.err
    assert speech not in tree.names()
    undone = rarms("undo", *where, "--auto-approve")

    assert undone.code == 0, undone.err
    assert (tree.names(), tree.read(speech)) == before
    assert rarms("destroy", *where, "--auto-approve").code == 0
