"""The whole way on real processes of this machine: measure, plan, apply, prove, drift after a change by hand, undo."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from rarms_iac.providers.cgroups.groups import GroupValues
from tests.contracts.benches import forget_host, groups_of, slice_of
from tests.contracts.test_measuring_contract import JOBS
from tests.unit.cli.running import rarms

MANIFEST = """\
schema: rarms/v1
application: {{ name: walk }}
policy: {{ interference: busy-loop }}
hosts:
  here:
    provider: linux
    logical_processors: {processors}
    memory: 1 GiB
    keep_for_host: {{ processor: 0 %, memory: 256 MiB }}
    linux: {{ slice: {slice} }}
components:
  eyes:
    criticality: 20
    memory: 64 MiB
    cpu: {{ reserve: measured }}
    apt: {{ mean_response_time: {{ at_most: 25 ms }} }}
    run:
      command: [python3, jobs.py, '0.006', '0', '1']
      until: {{ elapsed: 3 s }}
      samples: {{ from: json_lines, response_time: {{ field: ms, unit: ms }} }}
  ears:
    criticality: 10
    memory: 64 MiB
    cpu: {{ reserve: 20 % }}
    apt: {{ mean_response_time: {{ at_most: 100 ms }} }}
    run:
      command: [python3, jobs.py, '0.006', '0.02', '1']
      until: {{ elapsed: 3 s }}
      samples: {{ from: json_lines, response_time: {{ field: ms, unit: ms }} }}
interference:
  busy-loop: {{ kind: busy_loop }}
"""
"""Jobs of 6 ms of processor time, however fast the machine is: with 10 % they take about 33 ms beside busy loops."""


@pytest.fixture
def walk(tmp_path: Path) -> Iterator[Path]:
    """A folder with the manifest and its components; the machine is as before afterwards."""
    slice_name = slice_of(tmp_path)
    text = MANIFEST.format(processors=len(os.sched_getaffinity(0)), slice=slice_name)
    (tmp_path / "rarms.yaml").write_text(text, encoding="utf-8")
    (tmp_path / "jobs.py").write_text(JOBS, encoding="utf-8")
    yield tmp_path
    forget_host(tmp_path)


def run(folder: Path, command: str, *words: str, ends: int = 0) -> str:
    """What a command says that must end so."""
    ran = rarms(command, "-f", str(folder), *words)
    assert ran.code == ends, ran.out + ran.err
    return ran.out


def run_twice(folder: Path, first: tuple[str, ...], again: tuple[str, ...]) -> str:
    """What the first command says, or the second where others on this machine kept the first from an answer."""
    ran = rarms(first[0], "-f", str(folder), *first[1:])
    return ran.out if ran.code == 0 else run(folder, *again)


@pytest.mark.needs("control-groups")
@pytest.mark.alone
def test_real_processes_go_the_whole_way(walk: Path) -> None:
    groups, plan = groups_of(walk), str(walk / "walk.plan")

    paper = ("measure", "eyes", "--strategy", "paper")
    measured = run_twice(walk, paper, (*paper, "--again"))
    planned = run(walk, "plan", "--out", plan)
    proven = run_twice(walk, ("apply", plan, "--prove", "--load-host"), ("prove", "--load-host"))
    applied = groups.read("eyes")
    groups.write("eyes", GroupValues(shares_percent=applied.shares_percent + 10, memory=applied.memory))
    by_hand = groups.read("eyes")
    drifted = run(walk, "drift", ends=2)
    run(walk, "apply", "--auto-approve")
    mended = groups.read("eyes")
    nothing_to_do = run(walk, "plan")
    run(walk, "undo", "--auto-approve")
    undone = groups.read("eyes")
    run(walk, "destroy", "--auto-approve")

    assert "eyes" in measured
    assert "2 to add" in planned
    assert proven.count(" met") >= 2
    assert "eyes" in drifted
    assert "changed on the host" in drifted
    assert applied == mended != by_hand == undone
    assert "No changes" in nothing_to_do
    assert groups.names() == ()
