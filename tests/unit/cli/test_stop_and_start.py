"""`rarms stop` and `rarms start` on a simulated host: what they leave, what plan and drift say of it, and undo."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.model.state import Partition, RunState
from rarms_iac.providers.simulated.content import read_content, write_content
from rarms_iac.storage.snapshot_file import read_snapshot
from tests.unit.cli.running import rarms

MANIFEST = """schema: rarms/v1
application: { name: robot }
hosts:
  onboard: { provider: simulated, logical_processors: 2, memory: 4 GiB, keep_for_host: { processor: 0 %, memory: 0 B } }
components:
  vision: { criticality: 9, memory: 512 MiB, cpu: { reserve: 40 % } }
  speech: { criticality: 5, memory: 512 MiB, cpu: { reserve: 20 % } }
  logger: { criticality: 1, memory: 512 MiB, cpu: { reserve: 5 % } }
partitions:
  logger: { start: manual }
"""


@pytest.fixture(autouse=True)
def _an_applied_host(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    assert rarms("apply", "--auto-approve").code == 0


def partitions() -> dict[str, Partition]:
    """What is on the host, by name."""
    assert rarms("snapshot", "--out", "seen.json").code == 0
    return {
        partition.settings.name: partition for partition in read_snapshot(Path("seen.json").read_bytes()).partitions
    }


def running() -> list[str]:
    return [name for name, partition in partitions().items() if partition.settings.running]


def test_stopped_partition_stays_off_without_drift() -> None:
    assert running() == ["speech", "vision"]

    stopped = rarms("stop", "vision", "--auto-approve")

    assert stopped.code == 0
    assert "\nStopping by plan " in f"\n{stopped.err}"
    assert "\nStopped on onboard: " in f"\n{stopped.out}{stopped.err}"
    assert running() == ["speech"]
    planned, drifted = rarms("plan"), rarms("drift")
    assert (planned.code, drifted.code) == (0, 0)
    assert "partition/vision stays stopped, as requested. `rarms start vision` starts it." in planned.out
    assert json.loads(rarms("plan", "--json").out)["hosts"][0]["stopped"] == ["vision"]

    assert rarms("start", "--auto-approve").code == 0

    assert running() == ["speech", "vision"]
    assert "stays stopped" not in rarms("plan").out
    assert rarms("drift").code == 0


def test_least_critical_stops_first() -> None:
    swapped = MANIFEST.replace("criticality: 9", "criticality: 4")
    Path("rarms.yaml").write_text(swapped, encoding="utf-8")

    stopped = rarms("stop", "--auto-approve").err
    started = rarms("start", "--auto-approve").err

    assert stopped.index("] vision  ") < stopped.index("] speech  ")
    assert started.index("] speech  ") < started.index("] vision  ")


def test_stopped_partition_takes_changes() -> None:
    assert rarms("stop", "--auto-approve").code == 0
    Path("rarms.yaml").write_text(MANIFEST.replace("40 %", "30 %"), encoding="utf-8")
    assert rarms("drift").code == 5

    assert rarms("apply", "--auto-approve").code == 0

    assert running() == []
    assert partitions()["vision"].settings.reserve == 30
    assert rarms("plan").code == 0
    assert rarms("start", "--auto-approve").code == 0
    assert running() == ["speech", "vision"]
    assert rarms("drift").code == 0


def test_undo_takes_a_stop_back() -> None:
    before = partitions()
    assert rarms("stop", "--auto-approve").code == 0

    assert rarms("undo", "--auto-approve").code == 0

    assert partitions() == before


def test_stopping_twice_changes_nothing() -> None:
    assert rarms("start", "--auto-approve").out == "No changes. None of these partitions was stopped by rarms.\n"
    assert rarms("stop", "--auto-approve").code == 0
    assert rarms("stop", "--auto-approve").out == "No changes. None of these partitions should be running.\n"


def test_manual_partition_starts_if_named() -> None:
    assert rarms("start", "logger", "--auto-approve").code == 0

    assert running() == ["logger", "speech", "vision"]
    assert rarms("plan").code == 0
    assert rarms("stop", "--auto-approve").code == 0
    assert running() == []
    assert (rarms("plan").code, rarms("drift").code) == (0, 0)


def test_foreign_start_is_stopped_again() -> None:
    assert rarms("stop", "vision", "--auto-approve").code == 0
    started_on_the_host("vision")
    assert running() == ["speech", "vision"]

    assert rarms("stop", "vision", "--auto-approve").code == 0

    assert running() == ["speech"]


def started_on_the_host(name: str) -> None:
    """Start a machine as the host's own tools do, past rarms: its mark stays."""
    path = Path(".rarms", "hosts", "onboard.json")
    content = read_content(path.read_bytes(), path)
    machine = next(each for each in content.machines.values() if each.settings.name == name)
    running_settings = replace(machine.settings, running=True)
    content = content.with_machine(replace(machine, settings=running_settings, state=RunState.RUNNING))
    path.write_bytes(write_content(content))


def test_stop_in_a_plan_file_is_applied() -> None:
    assert rarms("stop", "speech", "--out", "stop.plan").code == 0
    assert running() == ["speech", "vision"]

    assert rarms("apply", "stop.plan").code == 0

    assert running() == ["vision"]


def test_a_name_that_no_host_has_is_refused() -> None:
    refused = rarms("stop", "visoin", "--auto-approve")

    assert refused.code == 64
    assert 'On onboard, robot does not have the partition "visoin". Did you mean "vision"?' in refused.err
    assert running() == ["speech", "vision"]


def test_stopped_partition_stays_promised() -> None:
    assert rarms("stop", "vision", "--auto-approve").code == 0

    destroyed = rarms("destroy", "--target", "partition/speech", "--auto-approve")

    assert destroyed.code == 0
    assert "Afterwards: 0.9 LP of 2 LP" in destroyed.out, "vision, and logger, which was never started"


def test_history_calls_each_run_by_its_command() -> None:
    for words in (("stop", "vision"), ("start",), ("release", "speech"), ("destroy", "--target", "partition/logger")):
        assert rarms(*words, "--auto-approve").code == 0

    runs = json.loads(rarms("history", "--json").out)["hosts"]["onboard"]

    assert [run["purpose"] for run in runs] == ["apply", "stop", "start", "release", "destroy"]
    shown = [line.split()[3] for line in rarms("history").out.splitlines()[2:]]
    assert shown == ["destroy", "release", "start", "stop", "apply"]
    assert "Last run: destroy of plan" in rarms("status").out


@pytest.mark.parametrize("words", [("stop", "nosuch"), ("release", "nosuch"), ("import", "nosuch", "--id", "x")])
def test_unknown_partition_is_wrong_usage(words: tuple[str, ...]) -> None:
    ran = rarms(*words, "--auto-approve")

    assert ran.code == 64
    assert 'does not have the partition "nosuch"' in " ".join(ran.err.split())
