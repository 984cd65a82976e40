"""A host that dies at any effect on its files is as it was before the call or as it is after it."""

from contextlib import suppress
from pathlib import Path

import pytest

from rarms_iac.model.journal import Closing, Journal, JournalRecord, RunClosed, RunStarted, StepRecorded, StepStatus
from rarms_iac.model.operations import CreatePartition, Operation, SetCpu, WriteMark
from rarms_iac.model.plan import Scope
from rarms_iac.model.state import State
from rarms_iac.providers.simulated.run import SimulatedHostProvider
from rarms_iac.storage import disk
from tests import builders
from tests.contracts.runs import a_run
from tests.crashing import Crash, CrashingDisk, When

SCOPE = Scope(application="robot", plan="0123456789ab")
OPERATIONS: list[Operation] = [
    CreatePartition(partition="vision", generation=2, memory=2**29),
    WriteMark(partition="vision", application="robot", name="vision", set="0" * 12),
    SetCpu(partition="vision", reserve=40, limit=100, weight=100),
]
RECORDS: list[JournalRecord] = [
    StepRecorded(number=0, status=StepStatus.BEGUN),
    StepRecorded(number=0, status=StepStatus.CHANGED),
    RunClosed(closing=Closing.DONE),
]


def a_host(folder: Path) -> SimulatedHostProvider:
    return SimulatedHostProvider(builders.a_host(), folder / ".rarms" / "hosts" / "onboard.json")


def effects_of_all(folder: Path) -> int:
    """How many effects the operations have, done one after the other on a fresh host."""
    counting = CrashingDisk(0)
    with disk.use(counting):
        for operation in OPERATIONS:
            a_host(folder).execute(operation, SCOPE)
    return len(counting.effects)


def run_until_crash(folder: Path, at: int, when: When) -> tuple[int, State]:
    """Do the operations until the crash: how many returned, and the state before the one that did not."""
    before, done = a_host(folder).observe(), 0
    with disk.use(CrashingDisk(at, when)), suppress(Crash):
        for operation in OPERATIONS:
            before = a_host(folder).observe()
            a_host(folder).execute(operation, SCOPE)
            done += 1
    return done, before


@pytest.mark.parametrize("when", When)
def test_operations_are_done_or_not_done(tmp_path: Path, when: When) -> None:
    total = effects_of_all(tmp_path / "undisturbed")
    end = a_host(tmp_path / "undisturbed").observe()
    assert total > 3 * len(OPERATIONS)

    for at in range(1, total + 1):
        folder = tmp_path / str(at)
        done, before = run_until_crash(folder, at, when)
        assert done < len(OPERATIONS)
        also_done = a_host(folder).observe() != before
        for operation in OPERATIONS[done + also_done :]:
            a_host(folder).execute(operation, SCOPE)
        assert a_host(folder).observe() == end


def record_until_crash(host: SimulatedHostProvider, started: RunStarted, at: int, when: When) -> int:
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
def test_a_record_is_there_or_not_there(tmp_path: Path, when: When) -> None:
    started = a_run(a_host(tmp_path).observe())
    whole = [started, *RECORDS]
    crashes = 0
    for at in range(1, 100):
        host = a_host(tmp_path / str(at))
        returned = record_until_crash(host, started, at, when)
        kept = kept_records(host.journal())
        assert kept == whole[: len(kept)]
        assert returned <= len(kept) <= returned + 1
        if returned == len(whole):
            break
        crashes += 1
    assert crashes > 2 * len(whole)
