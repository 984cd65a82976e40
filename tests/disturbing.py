"""Disturbs a command at one of its effects on files, repeats it, and tells what is there in the end.

A disturbance is a kill (before, half-way through or after the effect; a process of its own, ended by SIGKILL), a disk
that is full, a disk that fails, or a write that stops half-way. `end_of` runs a command undisturbed, `end_after` runs
it disturbed and then as often as its user would.
"""

import errno
import json
import os
import signal
from collections.abc import Mapping, Sequence
from contextlib import chdir, suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, NoReturn

from rarms_iac.storage import disk
from tests.crashing import CrashingDisk, When
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


KILLS = {
    Disturbance.KILLED_BEFORE: When.BEFORE,
    Disturbance.KILLED_HALF_WAY: When.HALF,
    Disturbance.KILLED_AFTER: When.AFTER,
}
ERRORS = {
    Disturbance.DISK_FULL: (When.BEFORE, errno.ENOSPC),
    Disturbance.DISK_FAILED: (When.BEFORE, errno.EIO),
    Disturbance.SHORT_WRITE: (When.HALF, errno.ENOSPC),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class End:
    """What a user has when all is over: the host, what was measured, the manifest, and every other file's name."""

    code: int
    host: Mapping[str, Any]
    measured: Mapping[str, Any]
    manifest: str
    files: frozenset[str]


def end_of(folder: Path, words: Sequence[str]) -> tuple[End, int]:
    """Run a command undisturbed; what is there afterwards, and how many effects on files it had."""
    counting = CrashingDisk(0)
    with disk.use(counting):
        code = _run(folder, words)
    return _look(folder, code), len(counting.effects)


def end_after(folder: Path, words: Sequence[str], at: int, disturbance: Disturbance, wanted: End) -> End:
    """Run a command disturbed at the effect of this number, then again until it is as `wanted` or the user gives up."""
    if disturbance in KILLS:
        _run_killed(folder, words, at, KILLS[disturbance])
    else:
        when, number = ERRORS[disturbance]
        with disk.use(CrashingDisk(at, when, lambda: _fail(number))):
            _run(folder, words)
    found = None
    for _ in range(ATTEMPTS):
        with disk.use(CrashingDisk(0)):  # without flushes, which take long
            found = _look(folder, _run(folder, words))
        if found == wanted:
            break
    assert found is not None
    return found


def _fail(number: int) -> NoReturn:
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
        with suppress(BaseException), disk.use(CrashingDisk(at, when, _kill_this_process)):
            _run(folder, words)
        os._exit(0)
    os.waitpid(child, 0)


def _kill_this_process() -> NoReturn:
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError("nobody survives this")


def _look(folder: Path, code: int) -> End:
    names = frozenset(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
    logs = sorted(name for name in names if name.startswith("measurements") and name.endswith(".jsonl"))
    return End(
        code=code,
        host=_host(folder / ".rarms" / "hosts" / "onboard.json"),
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
    content = json.loads(text)["content"]
    machines = {
        machine["settings"]["name"]: {
            "settings": machine["settings"],
            "state": machine["state"],
            "notes": machine["notes"].replace(machine["id"][:8], "ID"),
        }
        for machine in content["machines"].values()
    }
    return {"machines": machines, "registries": content["registries"], "disks": content["disks"]}


TIMES = frozenset({"when", "provenance", "taken", "length", "checksum"})


def _untimed(record: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in record.items() if key not in TIMES}
