from pathlib import Path

import pytest

from rarms_iac.measuring.partitions import (
    load_shape,
    remove_test_partitions,
    running_test_partitions,
    set_reserves,
    shapes_of_test_partitions,
)
from rarms_iac.model.measurement import P1, P2, EnvironmentSetup
from rarms_iac.model.operations import CreatePartition
from rarms_iac.model.plan import Scope
from rarms_iac.providers.interface import Refused
from rarms_iac.providers.simulated.run import SimulatedHostProvider
from rarms_iac.storage import disk
from tests.builders import a_host, memory
from tests.crashing import Crash, CrashingDisk, When

SETUP = EnvironmentSetup(
    members=("vision",), interference="busy-loop", processors=1, memory=memory("512 MiB"), limit=80, weight=200
)
SHAPES = shapes_of_test_partitions(SETUP, 2, memory("256 MiB"))


class DeadDisk(CrashingDisk):
    """Once crashed, it stays so: whatever a clean-up tries after the end of the process did not happen."""

    def _effect(self, name: str, do: object, half: object = lambda: None) -> None:
        if self.at and len(self.effects) >= self.at:
            raise Crash
        super()._effect(name, do, half)  # type: ignore[arg-type]  # handed through


def the_host(folder: Path) -> SimulatedHostProvider:
    return SimulatedHostProvider(a_host(), folder / "onboard.json")


def names(host: SimulatedHostProvider) -> list[str]:
    return [partition.settings.name for partition in host.observe().partitions]


def test_test_partitions_stand_marked_and_running_while_the_context_lasts(tmp_path: Path) -> None:
    host = the_host(tmp_path)
    with running_test_partitions(host, "robot", SHAPES):
        p1, p2 = host.observe().partitions
        set_reserves(host, "robot", SHAPES, {P1: 30, P2: 70})
        set_reserves(host, "robot", SHAPES, {P1: 40, P2: 60})
        reserves = [partition.settings.reserve for partition in host.observe().partitions]

    assert [partition.mark and (partition.mark.application, partition.mark.name) for partition in (p1, p2)] == [
        ("robot", P1),
        ("robot", P2),
    ]
    assert (p1.settings.processors, p1.settings.limit, p1.settings.weight, p1.settings.memory) == (1, 80, 200, 2**29)
    assert (p2.settings.processors, p2.settings.limit, p2.settings.weight, p2.settings.memory) == (2, 100, 100, 2**28)
    assert p1.settings.running
    assert p2.settings.running
    assert reserves == [40, 60]
    assert names(host) == []


def test_they_go_when_the_work_fails(tmp_path: Path) -> None:
    host = the_host(tmp_path)
    with pytest.raises(KeyboardInterrupt), running_test_partitions(host, "robot", SHAPES):
        raise KeyboardInterrupt

    assert names(host) == []


def test_they_go_when_only_one_can_be_made(tmp_path: Path) -> None:
    host = the_host(tmp_path)
    with (
        pytest.raises(Refused, match="needs"),
        running_test_partitions(host, "robot", (SHAPES[0], load_shape(2, memory("4 GiB")))),
    ):
        raise AssertionError("P2 has no room")

    assert names(host) == []


def test_what_a_kill_left_behind_goes_with_the_next_run_wherever_it_struck(tmp_path: Path) -> None:
    stranger = CreatePartition(partition="theirs", generation=2, memory=2**29)
    the_host(tmp_path).execute(stranger, Scope(application="somebody", plan="1"))

    def all_of_it() -> None:
        host = the_host(tmp_path)
        with running_test_partitions(host, "robot", SHAPES):
            set_reserves(host, "robot", SHAPES, {P1: 30, P2: 70})

    counting = CrashingDisk(0)
    with disk.use(counting):
        all_of_it()
    left = set()
    for at in range(1, len(counting.effects) + 1):
        with disk.use(DeadDisk(at, When.HALF)), pytest.raises(Crash):
            all_of_it()
        left.add(len(names(the_host(tmp_path))))
        with disk.use(CrashingDisk(0)):
            remove_test_partitions(the_host(tmp_path))
        assert names(the_host(tmp_path)) == ["theirs.rarms-1"]

    assert left == {1, 2, 3}
