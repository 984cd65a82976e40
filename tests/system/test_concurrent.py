"""Many processes that apply to one host at the same time: nothing is lost, and what they did has one order.

A usual run has 4 processes that apply 3 times each; `make test-long` has 20 with 50 each.
"""

import random
import re
import subprocess
import sys
import time
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import chdir
from multiprocessing import get_context
from pathlib import Path

import pytest

from rarms_iac.model.journal import Closing, Journal, PastRun, history_of
from rarms_iac.providers.journaled import LocalFiles, journal_in
from rarms_iac.providers.simulated.provider import SimulatedHostProvider
from rarms_iac.storage import disk
from rarms_iac.storage.codec import NotDecodable
from rarms_iac.storage.records import Damaged
from tests.builders import a_host
from tests.crashing import CrashingDisk
from tests.effort import LONG
from tests.unit.cli.running import rarms

PROCESSES, APPLIES = (20, 50) if LONG else (4, 3)
MANIFEST = """\
schema: rarms/v1
application: {{ name: {name} }}
hosts:
  onboard: {{ logical_processors: 32, memory: 64 GiB }}
components:
  {name}: {{ criticality: 1, memory: 128 MiB, processors: 1, cpu: {{ reserve: 1 %, weight: {weight} }} }}
"""
FIRST_WEIGHT = 100
QUICKER = "RARMS182"  # another process changed the host since the plan was made
JOURNAL = Path(".rarms", "hosts", "onboard.journal.jsonl")


def write_manifest(folder: Path, name: str, weight: int) -> Path:
    file = folder / f"{name}.yaml"
    file.write_text(MANIFEST.format(name=name, weight=weight), encoding="utf-8", newline="\n")
    return file


def apply_often(folder: Path, name: str) -> list[str]:
    """Apply another weight every time, again where another process was quicker; the plans' ids, in order."""
    plans, dice = [], random.Random(name)
    with chdir(folder), disk.use(CrashingDisk(0)):  # without flushes, which take long
        for number in range(APPLIES):
            manifest = write_manifest(folder, name, FIRST_WEIGHT + number)
            words = ("apply", "-f", manifest.name, "--auto-approve", "--lock-timeout", "3600s")
            while (answer := rarms(*words)).code != 0:
                assert answer.code == 3, answer.err
                assert re.findall(r"error\[(\w+)\]", answer.err) == [QUICKER], answer.err
                time.sleep(dice.random())
            plans += re.findall(r"^Applying plan (\w+) on onboard$", answer.err, re.MULTILINE)
    return plans


def follow_history(folder: Path, workers: list[Future[list[str]]]) -> list[PastRun]:
    """The runs on the host in their order, pieced together from what the journal remembers while they go on."""
    runs: list[PastRun] = []
    while True:
        over = all(worker.done() for worker in workers)
        past = [run for run in history_of(read_whole_journal(folder)) if run.closing is not None]
        known = past.index(runs[-1]) + 1 if runs else 0
        runs += past[known:]
        if over:
            return runs
        time.sleep(0.2)


def read_whole_journal(folder: Path) -> Journal | None:
    """The journal, unless a process is in the middle of writing to it."""
    try:
        return journal_in(LocalFiles().content(folder / JOURNAL), folder / JOURNAL)
    except (Damaged, NotDecodable):
        return None


def test_many_processes_lose_nothing_and_have_one_order(tmp_path: Path) -> None:
    names = [f"part-{number}" for number in range(PROCESSES)]

    with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
        workers = [pool.submit(apply_often, tmp_path, name) for name in names]
        runs = follow_history(tmp_path, workers)
    plans = {name: worker.result() for name, worker in zip(names, workers, strict=True)}

    state = SimulatedHostProvider(a_host(), tmp_path / ".rarms" / "hosts" / "onboard.json").observe()
    assert dict(state.serials) == dict.fromkeys(names, APPLIES)
    assert {partition.settings.name: partition.settings.weight for partition in state.partitions} == dict.fromkeys(
        names, FIRST_WEIGHT + APPLIES - 1
    )
    assert {run.closing for run in runs} == {Closing.DONE}
    assert {name: [run.plan for run in runs if run.application == name] for name in names} == plans
    assert len(runs) == PROCESSES * APPLIES


HOLD = """
import sys, time
from pathlib import Path
from rarms_iac.storage.writing import hold
with hold(Path(sys.argv[1]), "bob@cell, process 7"):
    print("held", flush=True)
    time.sleep(600)
"""


@pytest.mark.needs("posix")
def test_waiting_run_names_holder_and_follows_it(tmp_path: Path) -> None:
    manifest = write_manifest(tmp_path, "part-0", FIRST_WEIGHT)
    words = [sys.executable, "-m", "rarms_iac.cli.main", "apply", "-f", str(manifest), "--auto-approve"]
    lock = tmp_path / ".rarms" / "hosts" / "onboard.lock"
    lock.parent.mkdir(parents=True)
    with subprocess.Popen([sys.executable, "-c", HOLD, str(lock)], stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        refused = subprocess.run(words, capture_output=True, text=True, timeout=120)
        with subprocess.Popen([*words, "--lock-timeout", "600s"], stderr=subprocess.PIPE, text=True) as waiting:
            holder.kill()
            _, talk = waiting.communicate(timeout=120)

    assert refused.returncode == 3
    assert "bob@cell, process 7" in refused.stderr
    assert waiting.returncode == 0, talk
