"""What rarms reads and does on a Linux host: files, groups of the kernel, and programs."""

import errno
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path

from rarms_iac.providers.interface import HostDamaged
from rarms_iac.providers.journaled import LocalFiles
from rarms_iac.running.kernel_files import kernel_text, whole_number
from rarms_iac.storage import disk
from rarms_iac.storage.records import Record
from rarms_iac.texts.messages import last_words

LOOK_SECONDS = 0.005
_WAIT_SECONDS = 10.0
_BUDGET_SECONDS = 2.0
_RUN_SECONDS = 120.0
"""More than systemd lets any unit take by itself (DefaultTimeoutStopSec)."""


class LinuxEffects(LocalFiles):
    """This machine with its files of rarms. An OSError is the answer of its kernel."""

    def read(self, path: Path) -> str:
        """Return the text of a file of the kernel without its line end. Raises FileNotFoundError."""
        with _missing_when_removed(path):
            return path.read_text(encoding="utf-8", errors="replace").strip()

    def has_file(self, path: Path) -> bool:
        """Return whether there is such a file."""
        return path.is_file()

    def age_s(self, path: Path) -> float:
        """Return how long ago a file was written; 0: it is gone."""
        with suppress(FileNotFoundError):
            return time.time() - path.stat().st_mtime
        return 0.0

    def has_folder(self, path: Path) -> bool:
        """Return whether there is such a folder."""
        return path.is_dir()

    def is_writable(self, folder: Path) -> bool:
        """Return whether groups can be made in a folder."""
        return os.access(folder, os.W_OK)

    def is_private(self, folder: Path) -> bool:
        """Return whether only root may write to a folder that is there."""
        status = folder.stat()
        return status.st_uid in {0, os.geteuid()} and not status.st_mode & 0o022

    def folders(self, folder: Path) -> tuple[str, ...]:
        """Return the names of the folders in a folder, sorted; none where it is not there."""
        with suppress(FileNotFoundError, NotADirectoryError):
            return tuple(sorted(entry.name for entry in folder.iterdir() if entry.is_dir()))
        return ()

    def files(self, folder: Path) -> tuple[str, ...]:
        """Return the names of the files in a folder that rarms keeps, sorted."""
        return tuple(sorted(entry.name for entry in folder.glob("*")))

    def processes(self) -> Callable[[Path], str]:
        """Return a reader of the processes' `stat` and `cmdline`; it answers with an empty text where one is gone."""
        return kernel_text

    @contextmanager
    def hold(self, lock: Path, owner: str, timeout_ms: int) -> Iterator[None]:
        """Hold the host by the system's lock, which ends with this process."""
        with _for_root_alone():
            disk.make_folders(lock.parent)
            os.close(disk.open_to_write(lock, os.O_CREAT))
        with super().hold(lock, owner, timeout_ms):
            if self.is_private(lock.parent):
                lock.parent.chmod(0o700)
                for leftover in lock.parent.glob(".*.new"):
                    leftover.unlink(missing_ok=True)
            yield

    def holder(self, lock: Path) -> str:
        with suppress(OSError):  # what only root may see
            return super().holder(lock)
        return ""

    def replace(self, path: Path, data: bytes) -> None:
        """Make a file exactly these bytes, for root alone."""
        with _for_root_alone():
            super().replace(path, data)

    def append(self, path: Path, record: Record) -> None:
        """Add a record to a log, for root alone."""
        with _for_root_alone():
            super().append(path, record)

    def delete(self, path: Path) -> None:
        """Remove a file, durably; it may be gone. Raises OSError."""
        disk.current().remove(path)
        disk.current().flush_folder(path.parent)

    def write(self, path: Path, text: str) -> None:
        """Write a file of the kernel in one call, which takes or refuses the whole value. Raises OSError."""
        with _missing_when_removed(path):
            handle = os.open(path, os.O_WRONLY)
            try:
                os.write(handle, text.encode("ascii"))
            finally:
                os.close(handle)

    def write_budget(self, path: Path, text: str) -> None:
        """Write a real-time budget. Raises OSError: after 2 s the kernel still refuses it.

        The kernel counts the budget of a removed group for some 20 ms longer, and refuses a new one until then.
        """
        until = time.monotonic() + _BUDGET_SECONDS
        while True:
            try:
                return self.write(path, text)
            except OSError as problem:
                if problem.errno != errno.EINVAL or time.monotonic() > until:
                    raise
            time.sleep(LOOK_SECONDS)

    def make(self, group: Path) -> None:
        """Make a group in one that exists; what is there stays. Raises OSError."""
        with _for_all_to_read():
            group.mkdir(exist_ok=True)

    def remove(self, group: Path) -> None:
        """Remove a group without processes; it may be gone. Raises OSError: something keeps it for 10 s."""
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
        """Remove a group unless another is in it."""
        with suppress(OSError):
            group.rmdir()

    def ask_to_end(self, groups: Iterable[Path], grace_ms: int) -> None:
        """Ask the processes in and below groups to end (SIGTERM); return when they did, or the grace is over."""
        below, until = tuple(groups), time.monotonic() + grace_ms / 1000
        _signal(processes_in(self, below), signal.SIGTERM)
        while time.monotonic() < until and processes_in(self, below):
            time.sleep(LOOK_SECONDS)

    def end_processes(self, groups: Iterable[Path]) -> None:
        """End the processes in and below groups at once. Raises OSError: they do not end within 10 s."""
        below, until = tuple(groups), time.monotonic() + _WAIT_SECONDS
        while running := processes_in(self, below):
            _signal(running, signal.SIGKILL)
            _wait(until, f"{below[0].name}: {len(running)} processes do not end")

    def run(self, *words: str, may_fail: bool = False) -> None:
        """Run a program. Raises OSError with what it said, unless it may fail."""
        try:
            self.output(*words)
        except TimeoutError:
            raise
        except OSError:
            if not may_fail:
                raise

    def output(self, *words: str) -> str:
        """Return what a program prints, without white space around it. Raises OSError with what it said."""
        try:
            done = subprocess.run(
                words, capture_output=True, text=True, errors="replace", check=False, timeout=_RUN_SECONDS
            )
        except subprocess.TimeoutExpired as problem:
            raise TimeoutError(errno.ETIMEDOUT, str(problem)) from None
        if done.returncode:
            raise OSError(errno.EIO, f"{' '.join(words)}: {last_words(done.stderr, done.returncode)}")
        return done.stdout.strip()

    def await_text(self, path: Path, pattern: str) -> None:
        """Return once a file of the kernel has such a text (`*`: anything). Raises OSError after 10 s."""
        until, text = time.monotonic() + _WAIT_SECONDS, ""
        while True:
            with suppress(FileNotFoundError):  # the controller is not on yet
                text = self.read(path)
                if fnmatchcase(text, pattern):
                    return
            _wait(until, f"{path} has {text}, not {pattern}")

    def await_removal(self, group: Path) -> None:
        """Return once a group is gone. Raises OSError after 10 s."""
        until = time.monotonic() + _WAIT_SECONDS
        while group.is_dir():
            _wait(until, f"{group} cannot be removed")


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
                file = below / "cgroup.procs"
                found.update(whole_number(file, word) for word in effects.read(file).split())
    return tuple(sorted(found))


@contextmanager
def _with_umask(mask: int) -> Iterator[None]:
    """Give these rights to what is made inside, whatever mask the caller has.

    No user owns the folder of a host.
    """
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
        f"users other than root may write to {folder.as_posix()}, so rarms does not use its files",
        f"Check the files there, then `chown -R root {folder.as_posix()}` and `chmod 700 {folder.as_posix()}`.",
    )


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
