"""rarms on Linux, a real sshd, and at its other end PowerShell: the whole way, and SIGKILL of each program on it."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.effort import LONG
from tests.fake_powershell import measuring
from tests.fake_powershell.host import Entry, WindowsHost
from tests.fake_powershell.observing import CRYPTOGRAPHY, seen
from tests.real_powershell.engines import Engine
from tests.real_powershell.linux import LinuxHost, a_host, over_ssh
from tests.remote import Ended, Remote, descendants, finish
from tests.system.test_remote_host import an_empty_host

pytestmark = [pytest.mark.needs("powershell-linux", "ssh", "linux")]

MANIFEST = """\
schema: rarms/v1
application: { name: robot }
hosts:
  onboard:
    provider: hyperv
    connect: { ssh: cell, shell: pwsh }
    logical_processors: 8
    memory: 16 GiB
components:
  vision: { criticality: 50, memory: 1 GiB, processors: 2, cpu: { reserve: 20 % } }
  watcher: { criticality: 30, runs_on: host, task: Localization }
"""
MEASURED = measuring.MANIFEST.replace("provider: hyperv", "provider: hyperv\n    connect: { ssh: cell, shell: pwsh }")
MEASURE = ("measure", "--samples", "20", "--from", "40%", "--to", "40%")
APPLY = ("apply", "--auto-approve")
UNDO = ("undo", "--auto-approve")
EFFECTS = 84
"""What an apply of the manifest changes, about: kills are spread over it."""
POINTS = range(10)
"""Tenths of them, after which a program is killed."""


@contextmanager
def a_way(
    linux: Engine, folder: Path, host: WindowsHost | None = None, manifest: str = MANIFEST
) -> Iterator[tuple[LinuxHost, Remote]]:
    """A host, without machines if none is given, and the way to it."""
    (folder / "rarms.yaml").write_text(manifest, encoding="utf-8")
    with a_host(linux, host or an_empty_host(), folder) as there, over_ssh(there) as remote:
        yield there, remote


@contextmanager
def a_way_into_guests(linux: Engine, folder: Path) -> Iterator[tuple[LinuxHost, Remote]]:
    """A host that lets a measurement into its guests, and the way to it."""
    host = measuring.a_measurable_windows()
    host.guest_secret = bytes.fromhex(host.guest_secret).decode("utf-16-le")  # as PowerShell for Linux reads it
    for path in ("C:\\ProgramData\\rarms", "C:\\ProgramData\\rarms\\credentials"):
        host.write_file(path, None)
    with a_way(linux, folder, host, MEASURED) as (there, remote):
        yield there, remote


def is_as_wanted(remote: Remote) -> bool:
    planned = remote.rarms("plan")
    return planned.code == 0 and "No changes." in planned.out


def kill_pwsh(remote: Remote, rarms: int) -> None:
    kill(remote.pid, "pwsh")


def kill_ssh(remote: Remote, rarms: int) -> None:
    kill(rarms, "ssh")


def kill_rarms(remote: Remote, rarms: int) -> None:
    os.kill(rarms, signal.SIGKILL)


def kill(parent: int, name: str) -> None:
    """Kill those of its descendants that run this program."""
    found = [pid for pid in descendants(parent) if Path(f"/proc/{pid}/exe").resolve().name == name]
    assert found
    for pid in found:
        os.kill(pid, signal.SIGKILL)


def killed_at(
    there: LinuxHost, remote: Remote, words: tuple[str, ...], at: int, victim: Callable[[Remote, int], None]
) -> Ended:
    """How a command of rarms ends where, after so many effects on the host, some program is killed."""
    begun = len(there.host.effects)

    def watch(host: WindowsHost) -> None:
        if len(host.effects) == begun + at:
            victim(remote, running.pid)

    there.watch(watch)
    running = remote.start(*words)
    ended = finish(running)
    there.watch(None)
    return ended


def again(remote: Remote, *words: str) -> Ended:
    """Run the command until no other run holds the host: a script whose rarms is gone ends before its next step."""
    until = time.monotonic() + 60
    ended = remote.rarms(*words)
    while ended.code == 3 and time.monotonic() < until:
        time.sleep(0.5)
        ended = remote.rarms(*words)
    return ended


def test_whole_way_ends_where_it_began(linux: Engine, tmp_path: Path) -> None:
    with a_way(linux, tmp_path) as (there, remote):
        before = seen(there.host)

        assert remote.rarms("plan").code == 0
        assert seen(there.host) == before, "looking changes nothing"
        killed = killed_at(there, remote, APPLY, EFFECTS // 2, kill_ssh)
        assert killed.code != 0, killed
        applied = again(remote, *APPLY)
        assert applied.code == 0, applied
        assert is_as_wanted(remote)
        shown = remote.rarms("status")
        assert (shown.code, "vision" in shown.out) == (0, True), shown
        assert remote.rarms("drift").code == 0
        assert "apply" in remote.rarms("history").out
        undone = remote.rarms(*UNDO)
        assert undone.code == 0, undone
        assert seen(there.host) == before

        if LONG:
            assert remote.rarms(*APPLY).code == 0
            destroyed = remote.rarms("destroy", "--auto-approve")
            assert destroyed.code == 0, destroyed
            assert seen(there.host) == before
        assert scripts_left(there) == []


@pytest.mark.needs("long")
@pytest.mark.parametrize("point", POINTS)
@pytest.mark.parametrize("victim", [kill_pwsh, kill_ssh, kill_rarms])
def test_next_command_continues_after_a_kill(
    linux: Engine, tmp_path: Path, victim: Callable[[Remote, int], None], point: int
) -> None:
    with a_way(linux, tmp_path) as (there, remote):
        before = seen(there.host)

        ended = killed_at(there, remote, APPLY, EFFECTS * point // 10 + 1, victim)

        assert ended.code != 0, ended
        applied = again(remote, *APPLY)
        assert applied.code == 0, applied
        assert is_as_wanted(remote)
        assert [vm.name for vm in there.host.vms.values()] == ["vision"]
        undone = remote.rarms(*UNDO)
        assert undone.code == 0, undone
        assert seen(there.host) == before


TWO_HOSTS = """\
schema: rarms/v1
application: { name: robot }
hosts:
  onboard: { provider: hyperv, connect: { ssh: cell, shell: pwsh }, logical_processors: 8, memory: 16 GiB }
  aside: { provider: hyperv, connect: { ssh: aside, shell: pwsh }, logical_processors: 8, memory: 16 GiB }
components:
  vision: { criticality: 50, memory: 10 GiB, processors: 2, cpu: { reserve: 20 % } }
  speech: { criticality: 40, memory: 10 GiB, processors: 2, cpu: { reserve: 10 % } }
"""


def another_host() -> WindowsHost:
    host = an_empty_host()
    host.computer = "ASIDE"
    guid = "00000000-0000-4000-8000-00000000000b"
    host.add_key(CRYPTOGRAPHY).values["machineguid"] = Entry(name="MachineGuid", kind="String", data=guid)
    return host


@pytest.mark.needs("long")
def test_plan_of_two_hosts_is_applied_and_undone(linux: Engine, tmp_path: Path) -> None:
    (tmp_path / "aside").mkdir()
    with (
        a_way(linux, tmp_path, manifest=TWO_HOSTS) as (onboard, remote),
        a_host(linux, another_host(), tmp_path / "aside") as aside,
        over_ssh(aside),
    ):
        client = (aside.folder / "client").read_text(encoding="utf-8").replace("Host cell", "Host aside")
        with (onboard.folder / "client").open("a", encoding="utf-8") as both:
            both.write(client)

        applied = remote.rarms(*APPLY)
        there = [{vm.name for vm in host.host.vms.values()} for host in (onboard, aside)]
        undone = remote.rarms(*UNDO)

        assert (applied.code, undone.code) == (0, 0), (applied, undone)
        assert sorted(there, key=str) == [{"speech"}, {"vision"}]
        assert not onboard.host.vms
        assert not aside.host.vms


def kill_receiver(remote: Remote, rarms: int) -> None:
    """Kill what stands between ssh and the script."""
    first, *_ = (pid for pid in descendants(remote.pid) if Path(f"/proc/{pid}/exe").resolve().name == "pwsh")
    os.kill(first, signal.SIGKILL)


def nothing_measures(there: LinuxHost) -> bool:
    """Whether partitions and disks of a measurement are gone."""
    host = there.host
    return not host.vms and not any("rarms-p" in path for path in host.files)


def scripts_left(there: LinuxHost) -> list[Path]:
    """Folders into which a receiver put scripts; guests of the model have one of another name."""
    return list(there.here("C:\\Temp").glob("rarms-" + 32 * "?"))


def soon(happened: Callable[[], bool]) -> bool:
    until = time.monotonic() + 600
    while not happened() and time.monotonic() < until:
        time.sleep(0.5)
    return happened()


def test_short_measurement_leaves_nothing(linux: Engine, tmp_path: Path) -> None:
    with a_way_into_guests(linux, tmp_path) as (there, remote):
        out, err = remote.start(*MEASURE).communicate(timeout=600)

        assert b"1 component, 1 setting." in out, (out, err)
        assert "Set-VMProcessor rarms-p1 reserve" in there.host.effects
        assert soon(lambda: nothing_measures(there))
        assert scripts_left(there) == []


@pytest.mark.needs("long")
@pytest.mark.parametrize("victim", [kill_rarms, kill_ssh, kill_receiver])
def test_measurement_ends_with_who_asked_for_it(
    linux: Engine, tmp_path: Path, victim: Callable[[Remote, int], None]
) -> None:
    with a_way_into_guests(linux, tmp_path) as (there, remote):
        running = remote.start(*MEASURE)
        assert soon(lambda: "Set-VMProcessor rarms-p2 reserve" in there.host.effects)

        victim(remote, running.pid)

        running.communicate(timeout=600)
        assert soon(lambda: nothing_measures(there))
