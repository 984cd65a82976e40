"""Disturbs a command at one of its effects on files, repeats it, and tells what is there in the end.

A disturbance is a kill (before, half-way through or after the effect; a process of its own, ended by SIGKILL), a disk
that is full, a disk that fails, a write that stops half-way, or a program that cannot be started. Disturbed are the
effects of `storage.disk` (making, writing, flushing, renaming, removing), every opening of a file of the folder, for
reading and as a lock, and every start of a program. `end_of` runs a command undisturbed, `end_after` runs it disturbed
and then as often as its user would.
"""

import errno
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir, contextmanager, suppress
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

import pytest

from rarms_iac.storage import disk
from rarms_iac.storage.writing import hold
from tests.crashing import CrashingDisk, When
from tests.fake_powershell import program as powershell
from tests.unit.cli.running import rarms

ATTEMPTS = 4
"""How often a user repeats a command that was disturbed; a stale plan or a finished run takes one of them."""


class Disturbance(StrEnum):
    KILLED_BEFORE = "killed before it"
    KILLED_HALF_WAY = "killed half-way through it"
    KILLED_AFTER = "killed after it"
    DISK_FULL = "no space is left on the disk"
    DISK_FAILED = "the disk fails"
    SHORT_WRITE = "the disk fills up half-way through it"
    NO_PROCESS = "the system starts no further process"


KILLS = {
    Disturbance.KILLED_BEFORE: When.BEFORE,
    Disturbance.KILLED_HALF_WAY: When.HALF,
    Disturbance.KILLED_AFTER: When.AFTER,
}
ERRORS = {
    Disturbance.DISK_FULL: (When.BEFORE, errno.ENOSPC),
    Disturbance.DISK_FAILED: (When.BEFORE, errno.EIO),
    Disturbance.SHORT_WRITE: (When.HALF, errno.ENOSPC),
    Disturbance.NO_PROCESS: (When.BEFORE, errno.EAGAIN),
}


WRITES = frozenset({"write", "append"})
OPEN, START = "open", "start"
ON_WRITE = [*KILLS, Disturbance.DISK_FULL, Disturbance.DISK_FAILED, Disturbance.SHORT_WRITE]
ON_START = [Disturbance.KILLED_BEFORE, Disturbance.KILLED_AFTER, Disturbance.NO_PROCESS]


Fault = tuple[int, Disturbance]
"""The effect, from 1, and what becomes of it."""


def disturbances_of(effect: str) -> Sequence[Disturbance]:
    """The disturbances that an effect can meet, each of which leaves something else behind."""
    verb = effect.partition(" ")[0]
    if verb in WRITES:
        return ON_WRITE
    if verb == START:
        return ON_START
    if verb == OPEN:
        return [Disturbance.KILLED_BEFORE, Disturbance.DISK_FAILED]
    return [Disturbance.KILLED_AFTER, Disturbance.DISK_FULL, Disturbance.DISK_FAILED]


_watched: list[tuple[CrashingDisk, Path]] = []
"""The disk whose effects openings are now, and the folder whose files count; at most one."""


@cache
def _watch_openings() -> None:
    """Have openings counted from now on; Python cannot take such a hook back, so it does nothing while none counts."""

    def hear(event: str, arguments: tuple[Any, ...]) -> None:
        if event != OPEN or not _watched or not isinstance(arguments[0], str | Path):
            return
        disk_in_use, folder = _watched[-1]
        path = Path(arguments[0]).absolute()
        if path.is_relative_to(folder) and not path.is_dir():
            disk_in_use.meet(f"{OPEN} {path.name}")

    sys.addaudithook(hear)


@contextmanager
def _disturbing(folder: Path, disk_in_use: CrashingDisk) -> Iterator[None]:
    start = subprocess.Popen.__init__

    def counted_start(process: "subprocess.Popen[bytes]", words: Sequence[str], **options: Any) -> None:
        name = Path(words[0]).name
        disk_in_use.meet(f"{START} {name}", lambda: start(process, words, **options))

    _watch_openings()
    _watched.append((disk_in_use, folder.absolute()))
    try:
        with disk.use(disk_in_use), pytest.MonkeyPatch.context() as patch:
            patch.setattr(subprocess.Popen, "__init__", counted_start)
            yield
    finally:
        _watched.pop()


@dataclass(frozen=True, slots=True, kw_only=True)
class End:
    """What a user has when all is over: the host, what was measured, the manifest, and every other file's name."""

    code: int
    host: Mapping[str, Any]
    measured: Mapping[str, Any]
    manifest: str
    files: frozenset[str]


def end_of(folder: Path, words: Sequence[str]) -> tuple[End, Sequence[str]]:
    """Run a command undisturbed; what is there afterwards, and the effects on files that it had."""
    counting = CrashingDisk(0)
    with _disturbing(folder, counting):
        code = _run(folder, words)
    return look(folder, code), counting.effects


def end_after(folder: Path, words: Sequence[str], faults: Sequence[Fault], wanted: End) -> End:
    """Run a command with one fault after the other, then again until it is as `wanted` or the user gives up."""
    for fault in faults:
        disturb(folder, words, fault)
    found = None
    for _ in range(ATTEMPTS):
        with disk.use(CrashingDisk(0)):  # without flushes, which take long
            found = look(folder, _run(folder, words))
        if found == wanted:
            break
    assert found is not None
    return found


def disturb(folder: Path, words: Sequence[str], fault: Fault) -> None:
    """Run a command with a fault, if it comes as far as that."""
    at, disturbance = fault
    if disturbance in KILLS:
        _run_killed(folder, words, at, KILLS[disturbance])
        return
    when, number = ERRORS[disturbance]
    with _disturbing(folder, CrashingDisk(at, when, lambda: fail(number))):
        _run(folder, words)


def fail(number: int) -> NoReturn:
    """Have a call fail with this number of `errno`."""
    raise OSError(number, os.strerror(number))


def _run(folder: Path, words: Sequence[str]) -> int:
    with chdir(folder):
        answer = rarms(*words)
    assert "RARMS199" not in answer.err, answer.err
    return answer.code


def _run_killed(folder: Path, words: Sequence[str], at: int, when: When) -> None:
    """In a process of its own: SIGKILL lets nothing clean up, and gives back every lock."""
    child = os.fork()
    if not child:
        with suppress(BaseException), _disturbing(folder, CrashingDisk(at, when, _kill_this_process)):
            _run(folder, words)
        os._exit(0)
    os.waitpid(child, 0)


def _kill_this_process() -> NoReturn:
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError("nobody survives this")


def look(folder: Path, code: int) -> End:
    """What is there after a command that ended so."""
    names = frozenset(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
    logs = sorted(name for name in names if name.startswith("measurements") and name.endswith(".jsonl"))
    return End(
        code=code,
        host=_host_behind_pwsh(folder) or _host(folder / ".rarms" / "hosts" / "onboard.json"),
        measured={name: [_untimed(json.loads(line)) for line in _lines(folder / name)] for name in logs},
        manifest=(folder / "rarms.yaml").read_text(encoding="utf-8"),
        files=names,
    )


def _lines(file: Path) -> list[str]:
    return file.read_text(encoding="utf-8").splitlines()


def _host(file: Path) -> Mapping[str, Any]:
    """The machines by name and the task classes, without what tells one run from another."""
    if not file.exists():
        return {}
    text = file.read_text(encoding="utf-8")
    if not text.endswith("}\n"):
        return {"damaged": text}
    content = json.loads(text)
    machines = {
        machine["settings"]["name"]: {
            "settings": machine["settings"],
            "state": machine["state"],
            "notes": machine["notes"].replace(machine["id"][:8], "ID"),
        }
        for machine in content["machines"].values()
    }
    return {"machines": machines, "registries": content["registries"], "disks": content["disks"]}


def _host_behind_pwsh(folder: Path) -> Mapping[str, Any]:
    """What is on the stand-in of a Hyper-V host, where the folder has one; once no script runs there any more."""
    if not (folder / powershell.STATE).exists():
        return {}
    with hold(folder / powershell.LOCK, "a test", 60_000):
        machines = powershell.load(folder).vms.values()
    return {vm.name: {"state": vm.state, "reserve": vm.reserve, "memory": vm.memory} for vm in machines}


TIMES = frozenset({"when", "begun", "provenance", "taken", "wall_seconds", "length", "checksum"})


def _untimed(record: Mapping[str, Any]) -> dict[str, Any]:
    return {
        key: _untimed(value) if isinstance(value, dict) else value for key, value in record.items() if key not in TIMES
    }
