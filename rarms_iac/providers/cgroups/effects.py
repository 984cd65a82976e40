"""What rarms reads and does on a Linux host: files, groups of the kernel, and programs. `LocalEffects` is this machine.

`remote.py` has the same over a channel, in batches. There a change is done when `commit` returns, and what is read is
what the last answer showed with the changes since: so the same code serves both.
"""

import errno
import os
import signal
import subprocess
import time
import uuid
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Protocol

from rarms_iac.providers.interface import HostDamaged
from rarms_iac.providers.journaled import HostFiles, LocalFiles
from rarms_iac.storage import disk
from rarms_iac.storage.append import Record
from rarms_iac.storage.lock import Locked
from rarms_iac.storage.replace import is_alive

LEASE_SECONDS = 60
"""A run on another machine of which no batch came for so long has lost the host; `templates/shell/effects.sh` too."""

LOOK_SECONDS = 0.005
_WAIT_SECONDS = 10.0
_RUN_SECONDS = 120.0
"""More than systemd lets any unit take by itself (DefaultTimeoutStopSec)."""


class LinuxEffects(HostFiles, Protocol):
    """A Linux host with its files of rarms. An OSError is the answer of its kernel; paths are those of the host."""

    def look(self) -> None:
        """Look at the host as it is now, not as it was seen before."""

    def read(self, path: Path) -> str:
        """Return the text of a file of the kernel without its line end. Raises FileNotFoundError."""

    def has_file(self, path: Path) -> bool:
        """Return whether there is such a file."""

    def has_folder(self, path: Path) -> bool:
        """Return whether there is such a folder."""

    def is_writable(self, folder: Path) -> bool:
        """Return whether groups can be made in a folder."""

    def is_private(self, folder: Path) -> bool:
        """Return whether only root may write to a folder that is there."""

    def folders(self, folder: Path) -> tuple[str, ...]:
        """Return the names of the folders in a folder, sorted; none where it is not there."""

    def files(self, folder: Path) -> tuple[str, ...]:
        """Return the names of the files in a folder that rarms keeps, sorted."""

    def processes(self) -> Callable[[Path], str]:
        """Return a reader of the processes' `stat` and `cmdline`; it answers with an empty text where one is gone."""

    def delete(self, path: Path) -> None:
        """Remove a file, durably; it may be gone. Raises OSError."""

    def write(self, path: Path, text: str) -> None:
        """Write a file of the kernel in one call, which takes or refuses the whole value. Raises OSError."""

    def make(self, group: Path) -> None:
        """Make a group in one that exists; what is there stays. Raises OSError."""

    def remove(self, group: Path) -> None:
        """Remove a group without processes; it may be gone. Raises OSError: something keeps it for 10 s."""

    def remove_empty(self, group: Path) -> None:
        """Remove a group unless another is in it."""

    def ask_to_end(self, groups: Iterable[Path], grace_ms: int) -> None:
        """Ask the processes in and below groups to end (SIGTERM); return when they did, or the grace is over."""

    def end_processes(self, groups: Iterable[Path]) -> None:
        """End the processes in and below groups at once. Raises OSError: they do not end within 10 s."""

    def run(self, *words: str, may_fail: bool = False) -> None:
        """Run a program. Raises OSError with what it said, unless it may fail."""

    def await_text(self, path: Path, pattern: str) -> None:
        """Return once a file of the kernel has such a text (`*`: anything). Raises OSError after 10 s."""

    def await_removal(self, group: Path) -> None:
        """Return once a group is gone. Raises OSError after 10 s."""

    def commit(self) -> None:
        """Return when all is done that was asked for. Raises OSError: what came before the failure is done."""

    def in_one_batch(self) -> AbstractContextManager[None]:
        """Inside, `commit` waits for the end of the context, where it is done once and may raise."""


class LocalEffects(LocalFiles):
    """This machine: each call does its work at once."""

    def look(self) -> None:
        """Nothing is to be done: what is read is always as it is now."""

    def read(self, path: Path) -> str:
        with _missing_when_removed(path):
            return path.read_text(encoding="ascii").strip()

    def has_file(self, path: Path) -> bool:
        return path.is_file()

    def has_folder(self, path: Path) -> bool:
        return path.is_dir()

    def is_writable(self, folder: Path) -> bool:
        return os.access(folder, os.W_OK)

    def is_private(self, folder: Path) -> bool:
        status = folder.stat()
        return status.st_uid in {0, os.geteuid()} and not status.st_mode & 0o022

    def folders(self, folder: Path) -> tuple[str, ...]:
        with suppress(FileNotFoundError, NotADirectoryError):
            return tuple(sorted(entry.name for entry in folder.iterdir() if entry.is_dir()))
        return ()

    def files(self, folder: Path) -> tuple[str, ...]:
        return tuple(sorted(entry.name for entry in folder.glob("*")))

    def processes(self) -> Callable[[Path], str]:
        return kernel_text

    @contextmanager
    def hold(self, lock: Path, owner: str, timeout_ms: int) -> Iterator[None]:
        """By the system's lock, which ends with this process. The lease is another machine's."""
        lease = lock.with_name("lease")
        until = time.monotonic() + timeout_ms / 1000
        while True:
            remaining_ms = max(0, round(1000 * (until - time.monotonic())))
            with _for_root_alone():
                disk.make_folders(lock.parent)
                os.close(disk.open_to_write(lock, os.O_CREAT))
            with super().hold(lock, owner, remaining_ms):
                holder = _holder(lease)
                if not holder:
                    if self.is_private(lock.parent):
                        lock.parent.chmod(0o700)
                        for leftover in (lease, *sorted(lock.parent.glob(".*.new"))):
                            leftover.unlink(missing_ok=True)
                    yield
                    return
            if time.monotonic() >= until:
                raise Locked(lock, holder)
            time.sleep(1)

    def holder(self, lock: Path) -> str:
        with suppress(OSError):  # what only root may see
            return super().holder(lock) or _holder(lock.with_name("lease"))
        return ""

    def replace(self, path: Path, data: bytes) -> None:
        with _for_root_alone():
            super().replace(path, data)

    def append(self, path: Path, record: Record) -> None:
        with _for_root_alone():
            super().append(path, record)

    def delete(self, path: Path) -> None:
        disk.current().remove(path)
        disk.current().flush_folder(path.parent)

    def write(self, path: Path, text: str) -> None:
        with _missing_when_removed(path):
            handle = os.open(path, os.O_WRONLY)
            try:
                os.write(handle, text.encode("ascii"))
            finally:
                os.close(handle)

    def make(self, group: Path) -> None:
        with _for_all_to_read():
            group.mkdir(exist_ok=True)

    def remove(self, group: Path) -> None:
        until = time.monotonic() + _WAIT_SECONDS
        while True:
            try:
                group.rmdir()
            except FileNotFoundError:
                return
            except OSError:
                _wait(until, f"{group} cannot be removed")
            else:
                return

    def remove_empty(self, group: Path) -> None:
        with suppress(OSError):
            group.rmdir()

    def ask_to_end(self, groups: Iterable[Path], grace_ms: int) -> None:
        below, until = tuple(groups), time.monotonic() + grace_ms / 1000
        _signal(processes_in(self, below), signal.SIGTERM)
        while time.monotonic() < until and processes_in(self, below):
            time.sleep(LOOK_SECONDS)

    def end_processes(self, groups: Iterable[Path]) -> None:
        below, until = tuple(groups), time.monotonic() + _WAIT_SECONDS
        while running := processes_in(self, below):
            _signal(running, signal.SIGKILL)
            _wait(until, f"{below[0].name}: {len(running)} processes do not end")

    def run(self, *words: str, may_fail: bool = False) -> None:
        try:
            done = subprocess.run(
                words, capture_output=True, text=True, errors="replace", check=False, timeout=_RUN_SECONDS
            )
        except subprocess.TimeoutExpired as problem:
            raise TimeoutError(errno.ETIMEDOUT, str(problem)) from None
        if done.returncode and not may_fail:
            raise OSError(errno.EIO, f"{' '.join(words)}: {done.stderr.strip()}")

    def await_text(self, path: Path, pattern: str) -> None:
        until, text = time.monotonic() + _WAIT_SECONDS, ""
        while True:
            with suppress(FileNotFoundError):  # the controller is not on yet
                text = self.read(path)
                if fnmatchcase(text, pattern):
                    return
            _wait(until, f"{path} has {text}, not {pattern}")

    def await_removal(self, group: Path) -> None:
        until = time.monotonic() + _WAIT_SECONDS
        while group.is_dir():
            _wait(until, f"{group} cannot be removed")

    def commit(self) -> None:
        pass

    def in_one_batch(self) -> AbstractContextManager[None]:
        return nullcontext()


def below_first(effects: LinuxEffects, group: Path) -> Iterator[Path]:
    """Yield the folders of a group and of those below it, the innermost first; none where the group is not there."""
    if effects.has_folder(group):
        for name in effects.folders(group):
            yield from below_first(effects, group / name)
        yield group


def processes_in(effects: LinuxEffects, groups: Iterable[Path]) -> tuple[int, ...]:
    """Return the ids of the processes in groups and below them, ascending."""
    found: set[int] = set()
    for group in groups:
        for below in below_first(effects, group):
            with suppress(FileNotFoundError):
                found.update(int(word) for word in effects.read(below / "cgroup.procs").split())
    return tuple(sorted(found))


def kernel_text(file: Path) -> str:
    """Return a file of the kernel; empty where the process is gone, or this kernel has no such file.

    Args:
        file: below `/proc`.
    """
    try:
        return file.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


@contextmanager
def _with_umask(mask: int) -> Iterator[None]:
    """What is made inside gets these rights, also under another mask of the caller: a host is no user's folder."""
    before = os.umask(mask)
    try:
        yield
    finally:
        os.umask(before)


_for_root_alone = partial(_with_umask, 0o077)
_for_all_to_read = partial(_with_umask, 0o022)


def open_folder(host: str, folder: Path) -> HostDamaged:
    """Make the error for a folder of rarms' own files that others than root may write to."""
    return HostDamaged(
        host,
        f"others than root may write to {folder.as_posix()}, so rarms does not trust the files in it",
        f"Check the files there, then `chown -R root {folder.as_posix()}` and `chmod 700 {folder.as_posix()}`.",
    )


_living: set[str] = set()
_ELSEWHERE = uuid.uuid4().hex


def this_computer() -> str:
    """Return what names this start of this machine, as its process ids mean it; off Linux, this process alone."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
        return f"{boot}/{Path('/proc/self/ns/pid').readlink()}"  # each container has process ids of its own
    except OSError:
        return _ELSEWHERE


@contextmanager
def run_token() -> Iterator[str]:
    """Name a run that holds a host over a channel while the context lasts: computer, process, and a number.

    Yields:
        The name.
    """
    token = f"{this_computer()} {os.getpid()} {uuid.uuid4().hex}"
    _living.add(token)
    try:
        yield token
    finally:
        _living.remove(token)


def has_ended(token: str) -> bool:
    """Return whether the run of a token has ended, as far as this computer can tell."""
    computer, _, rest = token.partition(" ")
    process = rest.partition(" ")[0]
    if computer != this_computer() or not process.isdecimal():
        return False
    return token not in _living if int(process) == os.getpid() else not is_alive(int(process))


def _holder(lease: Path) -> str:
    """Return the owner of a lease that has not run out and whose process may go on; empty: there is none."""
    try:
        owner, token = lease.read_text(encoding="utf-8", errors="replace").splitlines()
        age = time.time() - lease.stat().st_mtime
        if age < 0:  # the host's clock went back: it counts from now on
            os.utime(lease)
    except (FileNotFoundError, ValueError):
        return ""
    return owner if age < LEASE_SECONDS and not has_ended(token) else ""


def _signal(processes: Iterable[int], number: signal.Signals) -> None:
    for process in processes:
        with suppress(ProcessLookupError):
            os.kill(process, number)


def _wait(until: float, message: str) -> None:
    """Wait for `LOOK_SECONDS`, in a loop.

    Raises:
        TimeoutError: that time (`time.monotonic`) is over.
    """
    if time.monotonic() > until:
        raise TimeoutError(errno.ETIMEDOUT, message)
    time.sleep(LOOK_SECONDS)


@contextmanager
def _missing_when_removed(file: Path) -> Iterator[None]:
    """Turn ENODEV, the kernel's answer where a group was removed after its file was opened, into FileNotFoundError."""
    try:
        yield
    except OSError as problem:
        if problem.errno != errno.ENODEV:
            raise
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(file)) from None
