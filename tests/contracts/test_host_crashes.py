"""A host that dies at any effect on its files is as it was before the call or as it is after it."""

from contextlib import suppress
from pathlib import Path

import pytest

from rarms_iac.model.journal import Closing, Journal, JournalRecord, RunClosed, RunStarted, StepRecorded, StepStatus
from rarms_iac.model.operations import (
    CreatePartition,
    Operation,
    RemovePartition,
    RenamePartition,
    SetCpu,
    SetMemory,
    StartPartition,
    StopPartition,
    WriteMark,
)
from rarms_iac.model.plan import Scope
from rarms_iac.model.state import State
from rarms_iac.providers.interface import StepwiseHost
from rarms_iac.storage import disk
from tests import builders
from tests.contracts.benches import Bench, kernel_effects_on_disk
from tests.contracts.benches import bench_here as bench
from tests.contracts.runs import a_run
from tests.crashing import Crash, CrashingDisk, When

__all__ = ["bench"]  # pytest finds fixtures by their names

SCOPE = Scope(application="robot", plan="0123456789ab")
OPERATIONS: list[Operation] = [
    CreatePartition(partition="vision", generation=2, memory=2**29),
    WriteMark(partition="vision", application="robot", name="vision", set="0" * 12),
    SetCpu(partition="vision", reserve=40, limit=100, weight=100),
    RenamePartition(partition="vision", name="vision"),
    StartPartition(partition="vision"),
    SetCpu(partition="vision", reserve=30, limit=80, weight=100, quota_period_us=10_000),
    SetMemory(partition="vision", memory=2**28),
    StopPartition(partition="vision", grace_ms=0),
    RemovePartition(partition="vision"),
]
RECORDS: list[JournalRecord] = [
    StepRecorded(number=0, status=StepStatus.BEGUN),
    StepRecorded(number=0, status=StepStatus.CHANGED),
    RunClosed(closing=Closing.DONE),
]


def effects_of_all(bench: Bench, folder: Path) -> int:
    """How many effects the operations have, done one after the other on a fresh host."""
    counting = CrashingDisk(0)
    with disk.use(counting):
        for operation in OPERATIONS:
            bench.open(builders.a_host(), folder).execute(operation, SCOPE)
    return len(counting.effects)


def run_until_crash(host: StepwiseHost, at: int, when: When) -> tuple[int, State]:
    """Do the operations until the crash: how many returned, and the state before the one that did not."""
    before, done = host.observe(), 0
    with disk.use(CrashingDisk(at, when)), suppress(Crash):
        for operation in OPERATIONS:
            before = host.observe()
            host.execute(operation, SCOPE)
            done += 1
    return done, before


@pytest.mark.parametrize("when", When)
def test_operations_are_done_or_not_done(bench: Bench, tmp_path: Path, when: When) -> None:
    with kernel_effects_on_disk():
        total = effects_of_all(bench, tmp_path / "undisturbed")
        end = bench.open(builders.a_host(), tmp_path / "undisturbed").observe()
        assert total > 3 * len(OPERATIONS)

        for at in range(1, total + 1, bench.stride):
            folder = tmp_path / str(at)
            done, before = run_until_crash(bench.open(builders.a_host(), folder), at, when)
            assert done < len(OPERATIONS)
            host = bench.open(builders.a_host(), folder)
            also_done = host.observe() != before
            with host.lock("ann@lab"):
                for operation in OPERATIONS[done + also_done :]:
                    host.execute(operation, SCOPE)
            assert host.observe() == end


def record_until_crash(host: StepwiseHost, started: RunStarted, at: int, when: When) -> int:
    """Start the run and add the records until the crash: how many calls returned."""
    returned = 0
    with disk.use(CrashingDisk(at, when)), suppress(Crash):
        host.start_run(started)
        returned += 1
        for record in RECORDS:
            host.record(record)
            returned += 1
    return returned


def kept_records(journal: Journal | None) -> list[JournalRecord]:
    if journal is None:
        return []
    return [journal.started, *journal.steps, *([journal.closed] if journal.closed else [])]


@pytest.mark.parametrize("when", When)
def test_a_record_is_there_or_not_there(bench: Bench, tmp_path: Path, when: When) -> None:
    started = a_run(bench.open(builders.a_host(), tmp_path).observe())
    whole = [started, *RECORDS]
    crashes = 0
    for at in range(1, 100):
        host = bench.open(builders.a_host(), tmp_path / str(at))
        returned = record_until_crash(host, started, at, when)
        kept = kept_records(host.journal())
        assert kept == whole[: len(kept)]
        assert returned <= len(kept) <= returned + 1
        if returned == len(whole):
            break
        crashes += 1
    assert crashes > 2 * len(whole)
