"""Runs scripts of a host of the model on a real PowerShell: as `tests.fake_powershell.run.run` does on the stand-in."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Empty
from threading import Timer
from typing import Any

from tests.fake_powershell.host import Entry, Key, WindowsHost
from tests.fake_powershell.run import BETWEEN_RUNS_MS, FOLDER, Ran
from tests.fake_powershell.values import BEGINNING
from tests.real_powershell.bridge import Bridge, Conversation
from tests.real_powershell.cmdlets import manifests, source
from tests.real_powershell.disks import Disks
from tests.real_powershell.engines import CACHE, SECONDS, STARTS, Engine, kill

if sys.platform != "win32":
    import fcntl

HERE = Path(__file__).parent
TREES = (
    "SOFTWARE\\rarms",
    "SOFTWARE\\Microsoft\\Windows NT\\CurrentVersion\\Multimedia\\SystemProfile",
    "SOFTWARE\\Microsoft\\Virtual Machine\\Guest\\Parameters",
    "SYSTEM\\CurrentControlSet\\Services\\MMCSS",
)
"""Keys below HKLM that are the model's alone."""
VALUES = {
    "SOFTWARE\\Microsoft\\Cryptography": ["MachineGuid"],
    "SOFTWARE\\Microsoft\\Windows NT\\CurrentVersion": ["CurrentBuildNumber", "InstallationType", "ProductName"],
}
"""Of other keys the values that are."""
_LOOKED_AT: dict[str, Any] = {"trees": list(TREES), "values": VALUES}
MODULES = ["Microsoft.PowerShell.Management", "Microsoft.PowerShell.Utility", "RarmsModel"]
MOST_PARKED = 40
UNNOTICED = 10
"""Seconds after which a run of a dead process is over: wine's server misses some ends, and keeps the connection."""


class RealPowerShell:
    """A warm process of an engine under wine, which is started anew once too many killed scripts lie in it."""

    def __init__(self, engine: Engine) -> None:
        assert engine.prefix is not None
        self.engine, self.disks, self.modules = engine, Disks(engine.prefix), made_modules()
        self._bridge: Bridge | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._parked = 0

    def run(
        self, host: WindowsHost, name: str, *, parks: bool = True, strike_s: float | None = None, **how: Any
    ) -> Ran:
        """Run the script of this name that lies on the host.

        Args:
            parks: a script that is killed sleeps in its process, which takes a second less than to end that.
            strike_s: seconds after which the process gets SIGKILL, wherever it is then.
            how: as for the stand-in.
        """
        bridge = self._running()
        host.clock += BETWEEN_RUNS_MS
        self.disks.begin(host)
        talk = Conversation(
            host,
            self.disks,
            declined=how.get("declined", frozenset()),
            answers=how.get("answers", ""),
            unanswered=how.get("unanswered", False),
        )
        bridge.talk = talk
        bridge.order(_order(host, name, how, parks=parks))
        striking = Timer(strike_s or 0.0, self._strike)
        if strike_s is not None:
            striking.start()
        ended = self._wait(bridge)
        striking.cancel()
        bridge.talk = None
        self.disks.read_back(host)
        if talk.failed is not None:
            raise talk.failed
        assert "broken" not in ended, ended["broken"]
        if not ended:
            self._parked = MOST_PARKED
            _read_registry(host, self._look()["registry"])
            return Ran(code=None, lines=tuple(talk.lines), talk=tuple(talk.talk), prompts=talk.prompts)
        if "registry" in ended:
            _read_registry(host, ended["registry"])
        if "exit" not in ended:
            self._parked += 1
            return Ran(code=None, lines=tuple(talk.lines), talk=tuple(talk.talk), prompts=talk.prompts)
        assert not talk.jobs, "jobs are removed"
        return Ran(code=ended["exit"], lines=tuple(talk.lines), talk=tuple(talk.talk), prompts=talk.prompts)

    @contextmanager
    def answering(self, talk: Conversation) -> Iterator[tuple[int, threading.RLock]]:
        """Let programs that the tests do not start ask the model; yields the port, and the lock of the model."""
        bridge = self._running()
        bridge.talk = talk
        try:
            yield bridge.port, bridge.turn
        finally:
            bridge.talk = None

    def _strike(self) -> None:
        """End the process of the engine from outside."""
        if self._process is not None:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)

    def _look(self) -> dict[str, Any]:
        """Have another process read the registry that one which died has left."""
        bridge = self._running()
        bridge.order(_LOOKED_AT)
        return self._wait(bridge)

    def _wait(self, bridge: Bridge) -> dict[str, Any]:
        """How a run ended; {}: its process is gone."""
        until, looks_at_dead = time.monotonic() + SECONDS, 0
        while time.monotonic() < until:
            with suppress(Empty):
                return bridge.ended.get(timeout=1)
            looks_at_dead += self._process is not None and self._process.poll() is not None
            if looks_at_dead > UNNOTICED:
                return {}
        talk = bridge.talk
        self.close()
        raise AssertionError(f"it runs for more than {SECONDS} s: {talk.lines if talk else ''}")

    def _running(self) -> Bridge:
        if self._bridge is not None and self._parked < MOST_PARKED:
            return self._bridge
        self.close()
        bridge, self._parked = Bridge(), 0
        self._bridge = bridge
        with _one_at_a_time():  # the first of all compiles
            for _ in range(STARTS):
                said = self._start(bridge)
                if said is None:
                    return bridge
                assert not said, said
        raise AssertionError(f"{STARTS} starts ended without a word")

    def _start(self, bridge: Bridge) -> str | None:
        """Start a process; what it said where it does not come to run scripts, as `Engine.answer` has it."""
        folders = (self.modules.parent / "sources", self.modules)
        process = self.engine.start(
            *("-NoProfile", "-NonInteractive", "-File", self.engine.path(HERE / "csharp" / "serve.ps1")),
            *(self.engine.path(folder) for folder in folders),
            environment={"RARMS_TEST_MODEL": str(bridge.port)},
        )
        until = time.monotonic() + SECONDS
        while time.monotonic() < until and process.poll() is None:
            if bridge.wait_for_runner(1.0):
                self._process = process
                return None
        process.kill()
        out, err = process.communicate()
        return (out + err).decode("utf-8", "replace").strip()

    def close(self) -> None:
        """End the process."""
        if self._bridge is not None:
            self._bridge.close()
            self._bridge = None
        if self._process is not None:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(10)
            kill(self._process)
            self._process = None


@contextmanager
def _one_at_a_time() -> Iterator[None]:
    """No other process of tests starts a PowerShell meanwhile."""
    with (CACHE / "start.lock").open("w") as lock:
        if sys.platform != "win32":
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def made_modules(*, linux: bool = False) -> Path:
    """The folder of the compiled modules, by the texts that make them; the first process compiles it."""
    files = [*(HERE / "csharp").glob("*.cs"), *((HERE / "csharp" / "linux").glob("*.cs") if linux else ())]
    texts = {path.name: path.read_text("utf-8") for path in sorted(files)}
    texts["Cmdlets.made.cs"] = source()
    compiler = (HERE / "csharp" / "compile.ps1").read_text("utf-8")
    digest = hashlib.sha256(repr((texts, manifests(), compiler)).encode()).hexdigest()[:16]
    folder = CACHE / f"model-{digest}"
    if not folder.exists():
        CACHE.mkdir(parents=True, exist_ok=True)
        fresh = folder.with_name(f"{folder.name}.{os.getpid()}")
        (fresh / "sources").mkdir(parents=True)
        for name, text in texts.items():
            (fresh / "sources" / name).write_text(text, "utf-8")
        for module, text in manifests().items():
            (fresh / "modules" / module).mkdir(parents=True)
            (fresh / "modules" / module / f"{module}.psd1").write_text(text, "utf-8")
        try:
            fresh.rename(folder)
        except OSError:
            shutil.rmtree(fresh)
    return folder / "modules"


def _order(host: WindowsHost, name: str, how: dict[str, Any], *, parks: bool) -> dict[str, Any]:
    below = {key.path.removeprefix("HKLM:\\"): key for key in host.registry.values() if key.values or _is_own(key)}
    return {
        "script": f"{FOLDER}\\{name}",
        "arguments": _words(how),
        "form": "&" if how.get("at_prompt") else "." if how.get("dot_sourced") else "file",
        "first": _first(host),
        "environment": {"ProgramData": host.environment.get("programdata"), "OS": host.environment.get("os")},
        "modules": MODULES,
        "computer": host.computer,
        "user": host.user,
        "elevated": host.elevated,
        "hyperv_administrator": host.hyperv_administrator,
        "beginning": BEGINNING.strftime("%Y-%m-%dT%H:%M:%SZ"),
        "now": host.clock,
        "parks": parks,
        "held": [[one.path, _rights(one.access), _rights(one.share)] for one in host.opened],
        **_LOOKED_AT,
        "registry": {
            path: [[entry.name, entry.kind, entry.data] for entry in key.values.values()] for path, key in below.items()
        },
    }


def _first(host: WindowsHost) -> list[str]:
    """What a profile has done before the script runs."""
    aliases = [f"Set-Alias -Scope Global -Name '{name}' -Value '{meant}'" for name, meant in host.aliases.items()]
    shown = {name: "$true" if value is True else f"'{value}'" for name, value in host.defaults.items()}
    defaults = [f"$PSDefaultParameterValues['{name}'] = {value}" for name, value in shown.items()]
    return [*aliases, *defaults, *([host.profile] if host.profile else [])]


def _is_own(key: Key) -> bool:
    return any(key.path.lower().startswith(f"hklm:\\{tree}".lower()) for tree in TREES)


def _rights(rights: frozenset[str]) -> str:
    return {0: "None", 2: "ReadWrite"}.get(len(rights)) or next(iter(rights)).capitalize()


def _words(how: dict[str, Any]) -> list[str]:
    switches = {"as_json": "-AsJson", "abandon": "-Abandon", "force": "-Force", "test": "-Test", "verbose": "-Verbose"}
    switches |= {"what_if": "-WhatIf", "confirm": "-Confirm"}
    given = {"as_json": True} | how
    if how.get("declined") or how.get("answers"):
        given["confirm"] = True
    words = [word for option, word in switches.items() if given.get(option)]
    return words + (["-LockTimeout", str(how["lock_timeout"])] if how.get("lock_timeout") else [])


def _read_registry(host: WindowsHost, found: dict[str, list[list[Any]]]) -> None:
    for low in [low for low, key in host.registry.items() if _is_own(key)]:
        del host.registry[low]
    for path, values in found.items():
        if path in VALUES and not values and host.key(f"HKLM:\\{path}") is None:
            continue
        key = host.add_key(f"HKLM:\\{path}")
        key.values = {name.lower(): Entry(name=name, kind=kind, data=data) for name, kind, data in values}
