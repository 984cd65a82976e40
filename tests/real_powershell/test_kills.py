"""Runs that are killed on the real PowerShell: run again they are finished, and undone they leave nothing."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import pytest

from tests.effort import LONG
from tests.fake_powershell.cell import apply_script, files_of, undo_script
from tests.fake_powershell.cells import Prepared, everything, fresh
from tests.fake_powershell.host import WindowsHost
from tests.fake_powershell.hyperv import settle
from tests.fake_powershell.observing import JOURNAL, seen
from tests.fake_powershell.run import Ran, put
from tests.real_powershell.both import Seen, seen_of
from tests.real_powershell.engines import Engine
from tests.real_powershell.runner import RealPowerShell

pytestmark = pytest.mark.needs("powershell-windows", "wine")

FOLDER = JOURNAL.rpartition("\\")[0]
KEPT = {FOLDER.lower(), JOURNAL.lower()}
"""All that an undone run leaves, beside its result."""
OFTEN = {JOURNAL.lower() + ".old"}
"""The journal before it, which is there if there was one."""
LEFT = ("files", "owners", "registry", "machines")
"""What stays when a process is gone. The event log is not among it: a run writes there between two effects."""

CELLS = {"creation": fresh, "change": everything}
EFFECTS = {"creation": 62, "change": 97}
"""What their scripts change: cmdlets, files, values of the registry. A change has a stop and task classes."""
PLACES = [(name, at) for name, last in EFFECTS.items() for at in range(last + 1)] if LONG else [("creation", 31)]
"""Before, between and after the effects."""
STRIKES = [(name, (at + 0.5) / 10) for name in CELLS for at in range(10)] if LONG else [("creation", 0.5)]


@dataclass(frozen=True, slots=True)
class Undisturbed:
    """What a run changes, what it makes of the host, what is there without it, and how long it takes."""

    prepared: Prepared
    effects: list[str]
    before: WindowsHost
    done: WindowsHost
    seconds: float

    @classmethod
    def of(cls, real: RealPowerShell, victim: RealPowerShell, name: str) -> Undisturbed:
        """Preview the plan, so that the registry is as Windows has it, then do it in either process."""
        prepared = CELLS[name]()
        script = apply_script(prepared.plan)
        before, done, again = (furnished(prepared) for _ in range(3))
        assert real.run(before, script, what_if=True).code == 0
        assert real.run(done, script).code == 0
        begun = time.monotonic()
        assert victim.run(again, script).code == 0
        return cls(prepared, list(done.effects), before, done.copy(), time.monotonic() - begun)


def furnished(prepared: Prepared, **faults: object) -> WindowsHost:
    """A host with the scripts and the folder for machines, calm but for these faults."""
    host = prepared.copy(**faults)
    host.write_file("D:\\vms", None)
    put(host, files_of(prepared.plan))
    return host


def run(real: RealPowerShell, host: WindowsHost, script: str, where: str) -> None:
    """Run a script, which comes to its end."""
    ran = real.run(host, script)
    assert ran.code == 0, f"{where}\n{ran.says}"


def same(host: WindowsHost, other: WindowsHost) -> bool:
    """Whether machines, disks and the registry are alike; the order in which a key has its values is not asked."""
    mine, theirs = ({name: probe for name, probe in seen(one).items() if name != "tasks"} for one in (host, other))
    assert mine == theirs
    assert host.registry == other.registry
    return True


def finish_and_undo(real: RealPowerShell, whole: Undisturbed, killed: WindowsHost, where: str) -> None:
    """Run the script again, which ends as an undisturbed run does, then its undo, after which nothing is left."""
    plan, host = whole.prepared.plan, killed.copy()

    run(real, host, apply_script(plan), where)
    assert same(host, whole.done), where
    assert host.files.keys() - OFTEN == whole.done.files.keys() - OFTEN, where
    assert host.files[FOLDER.lower()].protected, where
    last = json.loads(host.data(JOURNAL).splitlines()[-1])
    assert (last["kind"], last["closing"]) == ("run_closed", "done"), where

    run(real, host, undo_script(plan), where)
    assert same(host, whole.before), where
    results = {f"c:\\run\\{script}.result.json" for script in (apply_script(plan), undo_script(plan))}
    assert host.files.keys() - OFTEN == (whole.before.files.keys() | KEPT | results) - OFTEN, where
    assert not host.opened, where


@pytest.fixture(scope="module")
def victim(windows: Engine) -> Iterator[RealPowerShell]:
    """A process that is killed: the other one stays warm."""
    running = RealPowerShell(windows)
    yield running
    running.close()


@pytest.fixture(scope="module")
def undisturbed(real: RealPowerShell, victim: RealPowerShell) -> Callable[[str], Undisturbed]:
    """What the script of a cell of this name makes of it; run once."""
    return cache(lambda name: Undisturbed.of(real, victim, name))


def left(host: WindowsHost, ran: Ran) -> Seen:
    """What a killed run leaves behind, an hour later: guests that were asked to shut down are off."""
    later = host.copy()
    later.clock += 3_600_000
    settle(later)
    return {key: found for key, found in seen_of(later, ran).items() if key in LEFT}


@pytest.mark.parametrize(("cell", "at"), PLACES)
def test_killed_run_is_finished_and_undone(
    real: RealPowerShell, victim: RealPowerShell, undisturbed: Callable[[str], Undisturbed], cell: str, at: int
) -> None:
    """A kill after an effect and one before the next find the same host: by turns one is SIGKILL, the other parks."""
    whole = undisturbed(cell)
    script, last = apply_script(whole.prepared.plan), len(whole.effects)
    kills = [{"kill_after": at - 1}] * (at > 0) + [{"kill_before": at}] * (at < last)
    faults, *others = kills if at % 2 else kills[::-1]
    host = furnished(whole.prepared, **faults)

    ran = victim.run(host, script, parks=False)

    where = f"{faults}, in {host.effects[-1:]}, exit code {ran.code}"
    assert ran.code is None, f"{where}\n{ran.says}"
    for other in others:
        parked = furnished(whole.prepared, **other)
        assert left(parked, real.run(parked, script)) == left(host, ran), where
    finish_and_undo(real, whole, host, where)
    assert EFFECTS[cell] == last


@pytest.mark.parametrize(("cell", "part"), STRIKES)
def test_run_struck_from_outside_is_finished(
    real: RealPowerShell, victim: RealPowerShell, undisturbed: Callable[[str], Undisturbed], cell: str, part: float
) -> None:
    """SIGKILL after a part of the time that a run takes."""
    whole = undisturbed(cell)
    host = furnished(whole.prepared)

    ran = victim.run(host, apply_script(whole.prepared.plan), strike_s=whole.seconds * part)

    assert ran.code in {None, 0}, ran.says  # killed, or just done
    finish_and_undo(real, whole, host, f"struck at {part} in {host.effects[-1:]}, exit code {ran.code}")
