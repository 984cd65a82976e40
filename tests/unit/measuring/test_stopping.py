"""Measuring on an applied host: what runs there rests meanwhile, where the user consents, and runs again afterwards."""

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rarms_iac.app.hosts import load
from rarms_iac.measuring import measure, session
from rarms_iac.measuring.session import MeasuringSession
from rarms_iac.measuring.stopping import starting_again
from rarms_iac.model.operations import Operation, StopPartition
from rarms_iac.model.plan import Scope
from rarms_iac.model.state import State, StoppedBy
from rarms_iac.providers.interface import HostFailed
from rarms_iac.providers.simulated.provider import SimulatedHostProvider
from rarms_iac.storage.snapshot_file import read_snapshot
from tests.robots import a_measured, a_robot_of
from tests.unit.cli.running import rarms

MANIFEST = a_robot_of(
    a_measured(until="samples: 20", reserve="45 %").replace("samples: { from", "timeout: 2 s, samples: { from"),
    "  speech: { criticality: 5, memory: 512 MiB, cpu: { reserve: 20 % } }\n",
)
SWEEP = ("measure", "vision", "--from", "50%", "--to", "60%")


@pytest.fixture(autouse=True)
def _an_applied_host(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    assert rarms("apply", "--auto-approve").code == 0


def machines() -> dict[str, tuple[bool, StoppedBy | None]]:
    """By name: whether it runs, and who stopped it."""
    assert rarms("snapshot", "--out", "seen.json").code == 0
    return {
        partition.settings.name: (partition.settings.running, partition.mark.stopped_by if partition.mark else None)
        for partition in read_snapshot(Path("seen.json").read_bytes()).partitions
    }


RUNNING = {"speech": (True, StoppedBy.NO_USER), "vision": (True, StoppedBy.NO_USER)}


def test_stopped_partitions_run_again() -> None:
    ran = rarms(*SWEEP, "--stop-partitions")

    assert ran.code == 0, ran.err
    assert "onboard: stopped speech and vision to measure. rarms starts them again afterwards." in ran.err
    assert "onboard: started speech and vision again, stopped by a measurement." in ran.err
    assert machines() == RUNNING
    assert '"beside":[]' in Path("measurements/onboard/vision/busy-loop.jsonl").read_text(encoding="utf-8")
    assert (rarms("plan").code, rarms("drift").code) == (0, 0)


def test_history_has_only_runs_of_the_user() -> None:
    assert rarms(*SWEEP, "--stop-partitions").code == 0
    assert rarms("stop", "speech", "--auto-approve").code == 0
    assert rarms("start", "speech", "--auto-approve").code == 0

    assert kinds() == ["start", "stop", "apply"]


def kinds() -> list[str]:
    """The kinds of the runs that `rarms history` lists, the last one first."""
    [_, _, *rows] = rarms("history").out.splitlines()
    return [re.split(r" {2,}", row.strip())[1] for row in rows]


def test_undo_takes_back_the_last_apply_before_measuring() -> None:
    Path("rarms.yaml").write_text(MANIFEST.replace("reserve: 20 %", "reserve: 30 %"), encoding="utf-8")
    assert rarms("apply", "--auto-approve").code == 0
    for setting in ("50%", "60%"):  # a measurement after a measurement
        assert rarms("measure", "vision", "--from", setting, "--to", setting, "--stop-partitions").code == 0

    undone = rarms("undo", "--auto-approve")

    assert undone.code == 0, undone.err
    assert machines() == RUNNING
    assert kinds() == ["undo", "apply", "apply"]
    Path("rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    assert "No changes" in rarms("plan").out
    assert "the last run there was the undo of plan" in " ".join(rarms("undo", "--auto-approve").err.split())


def test_what_is_recorded_already_stops_nothing() -> None:
    assert rarms(*SWEEP, "--stop-partitions").code == 0

    assert "stopped" not in rarms(*SWEEP, "--stop-partitions").err


@pytest.mark.parametrize(("answer", "code"), [("y\n", 0), ("what\nyes\n", 0), ("n\n", 3), ("\n", 3), ("", 3)])
def test_terminal_is_asked_before_partitions_stop(answer: str, code: int) -> None:
    ran = rarms(*SWEEP, stdin=answer, at_a_terminal=True)

    assert ran.code == code, ran.err
    question = (
        "The partitions speech and vision run on onboard. Stop them while measuring, and start them again afterwards?"
    )
    assert question in " ".join(ran.err.split())
    assert machines() == RUNNING


def test_a_failed_measurement_starts_them_again() -> None:
    Path("rarms.yaml").write_text(MANIFEST.replace("timeout: 2 s", "timeout: 1 ms"), encoding="utf-8")

    failed = rarms(*SWEEP, "--stop-partitions")

    assert failed.code == 4, failed.err
    assert machines() == RUNNING


@contextmanager
def _killed(*_: object) -> Iterator[list[object]]:
    yield []


@pytest.fixture
def _stopped_and_out_of_room(monkeypatch: pytest.MonkeyPatch) -> None:
    """A measurement was killed, and the host keeps more for itself since."""
    with monkeypatch.context() as kill:
        kill.setattr(measure, "starting_again", _killed)
        assert rarms(*SWEEP, "--stop-partitions").code == 0
    keep_half_for_the_host()


STOPPED = {"speech": (False, StoppedBy.MEASUREMENT), "vision": (False, StoppedBy.MEASUREMENT)}


@pytest.mark.usefixtures("_stopped_and_out_of_room")
def test_unstartable_partition_is_an_error() -> None:
    ran = rarms(*SWEEP)
    for_programs = rarms(*SWEEP, "--json")

    assert (ran.code, for_programs.code) == (1, 1), ran.err
    assert "error[RARMS269] Partitions did not start again after a measurement" in ran.err
    assert "could not start them again: speech, vision." in " ".join(ran.err.split())
    assert "vision" in ran.out
    answer = json.loads(for_programs.out)
    assert (len(answer["experiments"]), answer["findings"][0]["code"]) == (1, "RARMS269")


@pytest.mark.usefixtures("_stopped_and_out_of_room")
def test_unstartable_partition_is_told_with_the_failure() -> None:
    failed = rarms("measure", "vision", "--from", "70%", "--to", "90%")

    assert failed.code == 4, failed.err
    assert "error[RARMS115]" in failed.err
    assert "error[RARMS269] Partitions did not start again after a measurement" in failed.err


def test_unreachable_host_keeps_no_other_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as kill:
        kill.setattr(measure, "starting_again", _killed)
        assert rarms(*SWEEP, "--stop-partitions").code == 0
    assert machines() == STOPPED
    hosts = load("rarms.yaml")
    onboard, gone = (hosts.open_to_measure("onboard") for _ in range(2))
    assert onboard is not None
    assert gone is not None
    monkeypatch.setattr(gone, "observe", unreachable)

    with starting_again(MeasuringSession(hosts=hosts, held_hosts={"gone": gone, "onboard": onboard})) as errors:
        pass

    assert [(error.code, error.detail) for error in errors] == [("RARMS189", "gone: no route.")]
    assert machines() == RUNNING


def unreachable() -> State:
    raise HostFailed("gone", "no route", "Look at its cable.")


def test_what_the_user_stopped_stays_stopped() -> None:
    assert rarms("stop", "speech", "--auto-approve").code == 0

    assert rarms(*SWEEP, "--stop-partitions").code == 0

    assert machines() == {"speech": (False, StoppedBy.USER), "vision": (True, StoppedBy.NO_USER)}


def test_stop_overrules_a_killed_measurement(monkeypatch: pytest.MonkeyPatch) -> None:
    by_hand = MANIFEST + "partitions: { speech: { start: manual } }\n"
    Path("rarms.yaml").write_text(by_hand, encoding="utf-8")
    assert rarms("apply", "--auto-approve").code == 0
    with monkeypatch.context() as kill:
        kill.setattr(measure, "starting_again", _killed)
        assert rarms(*SWEEP, "--stop-partitions").code == 0

    assert rarms("stop", "speech", "--auto-approve").code == 0
    assert rarms(*SWEEP).code == 0

    assert machines() == {"speech": (False, StoppedBy.USER), "vision": (True, StoppedBy.NO_USER)}


def keep_half_for_the_host() -> None:
    less = MANIFEST.replace("memory: 4 GiB }", "memory: 4 GiB, keep_for_host: { processor: 50 % } }")
    Path("rarms.yaml").write_text(less, encoding="utf-8")


SMALL_SWEEP = ("measure", "vision", "--from", "20%", "--to", "30%", "--stop-partitions")


def test_nothing_stops_without_room_to_return() -> None:
    keep_half_for_the_host()

    refused = rarms(*SMALL_SWEEP)

    assert refused.code == 3, refused.err
    assert "error[RARMS115]" in refused.err
    assert "rarms could not restart these partitions on onboard after measuring: speech, vision." in " ".join(
        refused.err.split()
    )
    assert machines() == RUNNING
    assert "`rarms plan` shows the cause." in refused.err
    assert "keep_for_host" in rarms("plan").err


def test_partition_of_the_user_takes_no_room() -> None:
    assert rarms("stop", "speech", "--auto-approve").code == 0
    keep_half_for_the_host()

    assert rarms(*SMALL_SWEEP).code == 0

    assert machines() == {"speech": (False, StoppedBy.USER), "vision": (True, StoppedBy.NO_USER)}


def test_run_killed_meanwhile_is_not_measured_over(monkeypatch: pytest.MonkeyPatch) -> None:
    def kill_a_run(_: object) -> None:
        """As one that began while the measurement waited for the lock."""
        journal = Path(".rarms", "hosts", "onboard.journal.jsonl")
        journal.write_bytes(b"".join(journal.read_bytes().splitlines(keepends=True)[:-1]))

    monkeypatch.setattr(session, "refuse_unfinished", kill_a_run)

    refused = rarms(*SWEEP, "--stop-partitions")

    assert refused.code == 3, refused.err
    assert "error[RARMS183]" in refused.err
    assert machines() == RUNNING


def test_kill_before_stop_is_no_foreign_change(monkeypatch: pytest.MonkeyPatch) -> None:
    def killed_at_a_stop(host: SimulatedHostProvider, operation: Operation, scope: Scope) -> None:
        if isinstance(operation, StopPartition):
            raise KeyboardInterrupt
        execute(host, operation, scope)

    execute = SimulatedHostProvider.execute
    with monkeypatch.context() as kill:
        kill.setattr(measure, "starting_again", _killed)
        kill.setattr(SimulatedHostProvider, "execute", killed_at_a_stop)
        assert rarms(*SWEEP, "--stop-partitions").code == 130

    drift = rarms("drift")

    assert machines() == {"speech": (True, StoppedBy.MEASUREMENT), "vision": (True, StoppedBy.NO_USER)}
    assert "0 changed on the host, 1 not applied yet" in drift.out
    assert "RARMS311" not in rarms("plan").out
    assert rarms("start", "--auto-approve").code == 0
    assert (machines(), rarms("drift").code) == (RUNNING, 0)


def test_remaining_time_is_told_after_some_settings() -> None:
    loads = ("--interference", "busy-loop", "--interference", "bursts-20")
    said = " ".join(rarms(*SWEEP, *loads, "--stop-partitions", "--samples", "10").err.split())

    first, second = re.findall(r"vision with [a-z0-9-]+ on onboard \(simulated\): 2 settings(.*?)\.(?= |$)", said)
    assert first == "; then 1 more load"
    assert re.fullmatch(r", ([0-9.]+ s to )?about [0-9.]+ s", second)


def test_stopping_and_measuring_beside_exclude_each_other() -> None:
    assert rarms(*SWEEP, "--stop-partitions", "--on-busy-host").code == 64
