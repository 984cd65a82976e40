"""Every command that changes something, disturbed at its effects on files and at the programs that it starts.

Repeated, it ends as if undisturbed.

A usual run takes some of the points of each command; `make test-long` takes all of most, and more than two thousand.
"""

import random
from collections.abc import Callable, Iterator, Sequence
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path

import pytest

from rarms_iac.providers import journaled
from rarms_iac.storage import disk
from tests.crashing import CrashingDisk
from tests.disturbing import ON_START, START, Disturbance, End, Fault, disturb, disturbances_of, end_after, end_of
from tests.effort import LONG
from tests.fake_powershell import program as powershell
from tests.fake_powershell.observing import host_from
from tests.files import copy_files, machines_on
from tests.fluid import without_scheduler
from tests.recorded_hosts import document
from tests.remote import pwsh
from tests.robots import CELL
from tests.unit.cli.running import rarms

__all__ = ["pwsh"]

pytestmark = pytest.mark.needs("posix")

POINTS, POINTS_OF_A_SEARCH = (300, 60) if LONG else (12, 12)
"""The most points of a command, evenly over all of its. A search takes seconds a run, and repeats the same effects."""
PAIRS, PAIRS_OF_A_SEARCH = (60, 12) if LONG else (6, 6)

FIXED = CELL.replace("reserve: measured", "reserve: 30 %")


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """A command, and what was run before it in a new folder."""

    words: tuple[str, ...]
    before: tuple[tuple[str, ...], ...] = ()
    manifest: str = FIXED
    searches: bool = False
    killed_at: float = 0.0  # its first run was killed there: a share of its effects; 0: there was none


APPLY = ("apply", "--auto-approve")
STOP = ("stop", "--auto-approve")
MEASURE = ("measure", "--samples", "60")
SCENARIOS = {
    "apply": Scenario(words=APPLY),
    "resume": Scenario(words=APPLY, killed_at=0.6),
    "undo": Scenario(words=("undo", "--auto-approve"), before=(APPLY,)),
    "destroy": Scenario(words=("destroy", "--auto-approve"), before=(APPLY,)),
    "stop": Scenario(words=STOP, before=(APPLY,)),
    "start": Scenario(words=("start", "--auto-approve"), before=(APPLY, STOP)),
    "release": Scenario(words=("release", "vision", "--auto-approve"), before=(APPLY,)),
    "import": Scenario(
        words=("import", "vision", "--id", "ID", "--auto-approve"),
        before=(APPLY, ("release", "vision", "--auto-approve")),
    ),
    "measure": Scenario(words=MEASURE, manifest=CELL, searches=True),
    "tune": Scenario(words=("tune", "--samples", "60"), before=(MEASURE,), manifest=CELL, searches=True),
}


def prepare(folder: Path, scenario: Scenario) -> tuple[str, ...]:
    """Run what comes before; the command's words, with the machine's id where they want it."""
    folder.mkdir()
    (folder / "rarms.yaml").write_text(scenario.manifest, encoding="utf-8", newline="\n")
    if scenario.manifest == HYPERV:
        powershell.save(folder, host_from(document("empty-host")))
    with chdir(folder), disk.use(CrashingDisk(0)):
        for words in scenario.before:
            assert rarms(*words).code == 0, words
    command = tuple(id_of(folder, "vision") if word == "ID" else word for word in scenario.words)
    if scenario.killed_at:
        _, effects = end_of(copy_files(folder, folder.with_name("whole")), command)
        disturb(folder, command, (round(scenario.killed_at * len(effects)), Disturbance.KILLED_AFTER))
    return command


def id_of(folder: Path, name: str) -> str:
    """The id of the machine with this name."""
    return next(str(machine["id"]) for machine in machines_on(folder) if machine["settings"]["name"] == name)


def all_points(effects: Sequence[str]) -> list[Fault]:
    """Every effect with every disturbance that it can meet."""
    return [(at, kind) for at, effect in enumerate(effects, 1) for kind in disturbances_of(effect)]


def points(scenario: Scenario, effects: Sequence[str]) -> list[list[Fault]]:
    """Which effects are disturbed, and how."""
    every, most = all_points(effects), POINTS_OF_A_SEARCH if scenario.searches else POINTS
    chosen = {number * (len(every) - 1) // (most - 1) for number in range(most)}
    return [[every[number]] for number in sorted(chosen)]


def half_way(_: Scenario, effects: Sequence[str]) -> list[list[Fault]]:
    """Every write, killed half-way through it."""
    return [[fault] for fault in all_points(effects) if fault[1] is Disturbance.KILLED_HALF_WAY]


def starts(_: Scenario, effects: Sequence[str]) -> list[list[Fault]]:
    """Every start of a program, with all that it can meet; in a usual run of the last alone, which changes the host."""
    every = [[fault] for fault in all_points(effects) if effects[fault[0] - 1].startswith(START)]
    assert every
    return every if LONG else every[-len(ON_START) :]


def pairs(scenario: Scenario, effects: Sequence[str]) -> list[list[Fault]]:
    """A fault, and a second one in the run after it, any two; the second run may be shorter than the first."""
    dice, every = random.Random(len(effects)), all_points(effects)
    early = [fault for fault in every if fault[0] <= len(effects) // 2]
    return [[dice.choice(every), dice.choice(early)] for _ in range(PAIRS_OF_A_SEARCH if scenario.searches else PAIRS)]


def bad_ends(
    tmp_path: Path, scenario: Scenario, choose: Callable[[Scenario, Sequence[str]], list[list[Fault]]] = points
) -> list[tuple[list[tuple[str, Disturbance]], list[str]]]:
    """The faults after which the command does not end as the undisturbed one."""
    start, work = tmp_path / "start", tmp_path / "cell"
    words = prepare(start, scenario)
    wanted, effects = end_of(copy_files(start, work), words)
    assert wanted.code == 0
    assert len(effects) >= 5
    bad = []
    for faults in choose(scenario, effects):
        clear(work)
        found = end_after(copy_files(start, work), words, faults, wanted)
        if found != wanted:
            bad.append(([(f"{at}: {effects[at - 1]}", kind) for at, kind in faults], differences(found, wanted)))
    return bad


@pytest.fixture(autouse=True)
def quick_simulation() -> Iterator[None]:
    with without_scheduler():
        yield


@pytest.mark.parametrize("name", SCENARIOS)
def test_disturbed_command_repeated_ends_as_undisturbed(tmp_path: Path, name: str) -> None:
    assert bad_ends(tmp_path, SCENARIOS[name]) == []


@pytest.mark.parametrize("name", SCENARIOS)
def test_twice_disturbed_command_ends_as_undisturbed(tmp_path: Path, name: str) -> None:
    assert bad_ends(tmp_path, SCENARIOS[name], pairs) == []


def test_writer_that_replaces_no_file_whole_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def write_in_place(path: Path, data: bytes) -> None:
        disk.current().write(path, data)

    monkeypatch.setattr(journaled, "replace", write_in_place)

    assert bad_ends(tmp_path, SCENARIOS["apply"], half_way)


HYPERV = """\
schema: rarms/v1
application: { name: cell }
policy: { interference: busy-loop }
hosts: { onboard: { provider: hyperv, logical_processors: 8, memory: 16 GiB } }
components: { vision: { criticality: 30, memory: 512 MiB, cpu: { reserve: 20 % } } }
"""
WAITING = ("--auto-approve", "--lock-timeout", "60s")  # for a script that outlives the rarms that started it


@pytest.mark.usefixtures("pwsh")
@pytest.mark.parametrize("name", ["apply", "undo"] if LONG else ["undo"])
def test_program_that_does_not_start_changes_no_end(tmp_path: Path, name: str) -> None:
    before = (("apply", *WAITING),) if name == "undo" else ()
    scenario = Scenario(words=(name, *WAITING), before=before, manifest=HYPERV)

    assert bad_ends(tmp_path, scenario, starts) == []


def clear(folder: Path) -> None:
    for path in sorted(folder.rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()


def differences(found: End, wanted: End) -> list[str]:
    """What differs, for the message of a failed test."""
    names = ["code", "host", "measured", "manifest", "files"]
    return [
        f"{name}: {getattr(found, name)} instead of {getattr(wanted, name)}"
        for name in names
        if getattr(found, name) != getattr(wanted, name)
    ]
