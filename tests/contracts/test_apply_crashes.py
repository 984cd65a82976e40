"""A process killed at any effect on the host's files, and the same apply again: the same end, and nothing is asked.

The whole of a small apply in one process; `tests/system` does the same to the command.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import pytest

from rarms_iac.applying.execute import apply_plan, finish_unfinished
from rarms_iac.applying.make_plan import make_plan
from rarms_iac.applying.plan_request import PlanRequest
from rarms_iac.applying.run_report import RunEnding, RunReport
from rarms_iac.applying.run_steps import take_back_starts
from rarms_iac.applying.undo import undo
from rarms_iac.model.journal import JournalRecord, StepRecorded, StepStatus
from rarms_iac.model.plan import Plan
from rarms_iac.model.state import Partition
from rarms_iac.model.system import System
from rarms_iac.providers.interface import StepwiseHost
from rarms_iac.storage import disk
from tests import builders
from tests.contracts.benches import Bench, copy_host, forget_groups, kernel_effects_on_disk
from tests.contracts.benches import bench_here as bench
from tests.crashing import Crash, CrashingDisk, When

__all__ = ["bench"]  # pytest finds fixtures by their names

FIRST = builders.a_system(
    hosts=[builders.a_host()],
    components=[builders.a_component("vision", reserve="40 %"), builders.a_component("speech", reserve="30 %")],
)
SECOND = builders.a_system(
    hosts=[builders.a_host()],
    components=[
        builders.a_component("vision", reserve="20 %", task="ObjectIdentification", memory="256 MiB"),
        replace(
            builders.a_component("driving", reserve="40 %", processors=1),
            cpu=builders.a_cpu(reserve="40 %", starting=("50 %", "20 ms")),
        ),
    ],
    tasks=[builders.a_task("ObjectIdentification")],
)


@dataclass(frozen=True)
class Lab:
    """A kind of host, opened again for each command."""

    bench: Bench

    def host(self, folder: Path) -> StepwiseHost:
        return self.bench.open(builders.a_host(), folder)

    def system(self, system: System) -> System:
        """The system with its hosts of this kind."""
        hosts = {name: self.bench.described(host) for name, host in system.hosts.items()}
        return replace(system, hosts=hosts)

    def settled(self, folder: Path) -> Path:
        """A folder whose host has the first system applied."""
        folder.mkdir()
        assert apply_again(self.system(FIRST), self.bench.furnished(folder)).ending is RunEnding.DONE
        return folder


@pytest.fixture
def lab(bench: Bench) -> Iterator[Lab]:
    with kernel_effects_on_disk():
        yield Lab(bench)


def a_plan(system: System, host: StepwiseHost) -> Plan:
    request = PlanRequest(
        system=system,
        places=builders.PathPlaces(),
        manifest="rarms.yaml",
        manifest_digest="0" * 12,
        today=date(2026, 1, 1),
    )
    prepared = make_plan(request, {host.name: host.observe()})
    assert prepared.plan is not None, prepared.findings
    return prepared.plan


def apply_again(system: System, host: StepwiseHost) -> RunReport:
    """What `rarms apply --auto-approve` does: finish what was begun and go no further, or plan and apply."""
    with host.lock("ann@lab"):
        finished = finish_unfinished([host])
        if finished is not None:
            return finished
        return apply_plan(a_plan(system, host), {host.name: host}, builders.ORIGIN)


def as_left(host: StepwiseHost) -> list[Partition]:
    """The machines, without the ids and marks that are new with every machine."""
    return [replace(partition, id="", mark=None) for partition in host.observe().partitions]


def test_second_apply_is_empty_and_undo_restores(lab: Lab, tmp_path: Path) -> None:
    host = lab.host(lab.settled(tmp_path / "host"))
    before = as_left(host)

    assert apply_again(lab.system(SECOND), host).ending is RunEnding.DONE
    assert not a_plan(lab.system(SECOND), host).has_changes
    assert undo(host, builders.ORIGIN).ending is RunEnding.DONE

    assert as_left(host) == before
    assert dict(host.observe().serials) == {"robot": 3}


def go_on(lab: Lab, host: StepwiseHost) -> None:
    """Run the same command until it has nothing to do: once where the run was begun, twice where it was not."""
    for _ in range(2):
        journal = host.journal()
        unfinished = journal is not None and journal.unfinished
        if unfinished or a_plan(lab.system(SECOND), host).has_changes:
            assert apply_again(lab.system(SECOND), host).ending is RunEnding.DONE


@pytest.mark.parametrize("when", [When.HALF, When.AFTER])  # before an effect is after the one before it
def test_killed_apply_run_again_reaches_same_end(lab: Lab, tmp_path: Path, when: When) -> None:
    undisturbed = lab.settled(tmp_path / "undisturbed")
    counting = CrashingDisk(0)
    with disk.use(counting):
        assert apply_again(lab.system(SECOND), lab.host(undisturbed)).ending is RunEnding.DONE
    end = lab.host(undisturbed).observe()
    assert len(counting.effects) > 50

    start, first = lab.settled(tmp_path / "start"), 1 + list(When).index(when)  # so that other places are tried, too
    for at in range(first, len(counting.effects) + 1, lab.bench.stride):
        folder = tmp_path / str(at)
        copy_host(start, folder)
        with disk.use(CrashingDisk(at, when)), suppress(Crash):
            apply_again(lab.system(SECOND), lab.host(folder))
        with disk.use(CrashingDisk(0)):
            go_on(lab, lab.host(folder))
        assert lab.host(folder).observe() == end, counting.effects[at - 1]
        forget_groups(folder)


def test_killed_start_keeps_more_until_next_look(lab: Lab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What starts partitions with the machine gives it back, without the rest of the run."""
    folder = lab.settled(tmp_path / "host")
    host = lab.host(folder)
    steps = a_plan(lab.system(SECOND), host).hosts[0].steps
    (number,) = [at for at, step in enumerate(steps) if step.wait_ms]
    record = host.record

    def killed_after_start(entry: JournalRecord) -> None:
        record(entry)
        if isinstance(entry, StepRecorded) and entry.number == number - 1 and entry.status is StepStatus.CHANGED:
            raise Crash

    monkeypatch.setattr(host, "record", killed_after_start)
    with suppress(Crash):
        apply_again(lab.system(SECOND), host)

    again = lab.host(folder)
    journal = again.journal()
    assert journal is not None
    assert (journal.unfinished, reserve_of(again)) == (True, 100)
    with again.lock("boot"):
        assert take_back_starts(again, journal) is None
    assert reserve_of(again) == 80
    assert not take_back_starts(again, journal)
    go_on(lab, again)
    assert reserve_of(again) == 80


def reserve_of(host: StepwiseHost) -> int:
    """What `driving` has of its processor."""
    (driving,) = [each for each in host.observe().partitions if each.settings.name == "driving"]
    return driving.settings.reserve
