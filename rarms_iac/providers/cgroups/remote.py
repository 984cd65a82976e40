"""A Linux host through a channel: effects go there in batches, each with a look at the host behind it.

A batch is a fixed program, `templates/shell/effects.sh`, and its calls. It needs a POSIX `sh`, coreutils, findutils,
`sed` and `flock` there. The changes that were asked for since the last answer are laid over what it showed, until the
next answer.
"""

import errno
import shlex
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path, PurePosixPath

from rarms_iac.model.host import Connect, Host, LinuxHost
from rarms_iac.providers.cgroups.effects import has_ended, open_folder, run_token
from rarms_iac.providers.cgroups.find_tree import CONTROL_GROUPS, SYSTEMD_FOLDER
from rarms_iac.providers.cgroups.machine import MACHINE_FILES, LinuxMachine
from rarms_iac.providers.cgroups.provider import STATE_FOLDER, LinuxHostProvider
from rarms_iac.providers.cgroups.systemd import UNITS, slice_unit
from rarms_iac.providers.channel import SSH_FAILED, CommandChannel, CommandResult, ssh_channel
from rarms_iac.providers.interface import HostError, HostFailed, HostLocked, HostTakenOver, HostUnreachable
from rarms_iac.storage.append import Record, sealed_line, sound_size
from rarms_iac.storage.shipped import shipped_text

COMMAND = (
    """sh -c 'user=$(id -u); echo "rarms: user $user"; """
    """if [ "$user" = 0 ]; then exec sh; else exec sudo -n sh; fi'"""
)
"""What a channel runs: the shell of root, for every shell that a user may have there."""

ANSWER_SECONDS = 60.0
"""How long a batch may say nothing, beside what its effects wait for."""

_GROUP_FILES = (
    *("cgroup.procs", "cgroup.controllers", "cpu.shares", "cpu.cfs_quota_us", "cpu.cfs_period_us", "cpuset.cpus"),
    *("cpuset.mems", "memory.limit_in_bytes", "cgroup.subtree_control", "cpu.weight", "cpu.max"),
    *("cpuset.cpus.effective", "memory.max", "memory.stat"),
)
_ROOTS = ("", "unified", "cpuset", "memory", "cpuacct", "cpu")
_POLL_SECONDS = 1.0
FRESH_SECONDS = 0.5
"""How long an answer counts as a look at a host that this run holds."""


@dataclass(slots=True, kw_only=True)
class _View:
    """What a host showed, with the changes that were asked for since."""

    files: dict[str, bytes] = field(default_factory=dict)
    folders: set[str] = field(default_factory=set)
    writable: set[str] = field(default_factory=set)
    made: set[str] = field(default_factory=set)  # folders whose files are not known yet
    is_private: bool = True


class RemoteEffects:
    """The `LinuxEffects` of a host behind a channel."""

    def __init__(self, host: Host, channel: CommandChannel, state_folder: Path = STATE_FOLDER) -> None:
        """Prepare; nothing is sent before the first look.

        Args:
            host: as the manifest describes it.
            channel: to the host.
            state_folder: as of `LinuxHostProvider`, there.
        """
        settings = host.settings if isinstance(host.settings, LinuxHost) else LinuxHost()
        self._host = host.name
        self._channel = channel
        self._folder = state_folder / settings.slice
        self._slice = settings.slice
        self._view = _View()
        self._seen = 0.0  # when the host showed it, by `time.monotonic`
        self._calls: list[str] = []
        self._seconds = 0.0  # that these calls may wait
        self._is_gathering = False  # effects of several steps, for one batch
        self._lease: tuple[str, str] | None = None  # while this run holds the host: its owner and token

    def look(self) -> None:
        """While this run holds the host, what the last answer showed counts for `FRESH_SECONDS`."""
        self.commit()
        if self._lease is None or time.monotonic() - self._seen > FRESH_SECONDS:
            self._send((), 0.0)

    def content(self, path: Path) -> bytes | None:
        return self._view.files.get(path.as_posix())

    def read(self, path: Path) -> str:
        data = self.content(path)
        if data is None:
            raise FileNotFoundError(errno.ENOENT, "the host shows no such file", path.as_posix())
        return data.decode("ascii").strip()

    def has_file(self, path: Path) -> bool:
        return path.as_posix() in self._view.files

    def has_folder(self, path: Path) -> bool:
        return path.as_posix() in self._view.folders

    def is_writable(self, folder: Path) -> bool:
        return folder.as_posix() in self._view.writable

    def is_private(self, folder: Path) -> bool:  # noqa: ARG002 - it is that of this host
        return self._view.is_private

    def folders(self, folder: Path) -> tuple[str, ...]:
        return _names_in(folder, self._view.folders)

    def files(self, folder: Path) -> tuple[str, ...]:
        return _names_in(folder, self._view.files)

    def processes(self) -> Callable[[Path], str]:
        seen = self._answer(["show_processes"], 0.0)
        return lambda path: seen.files.get(path.as_posix(), b"").decode("utf-8", "replace")

    @contextmanager
    def hold(self, lock: Path, owner: str, timeout_ms: int) -> Iterator[None]:  # noqa: ARG002 - it lies in the folder
        """By a lease, which every batch renews and which keeps others out until the next one."""
        with run_token() as token:
            self._take(owner, token, timeout_ms)
            self._lease = owner, token
            try:
                yield
                self.commit()
            finally:
                self._drop_calls()
                try:
                    with suppress(HostError):  # it ends by itself, too
                        self._answer(["release"], 0.0)
                finally:
                    self._lease = None

    def holder(self, lock: Path) -> str:  # noqa: ARG002 - it lies in the folder
        """A look shows no lock: only this run itself is known."""
        return self._lease[0] if self._lease else ""

    def _take(self, owner: str, token: str, timeout_ms: int) -> None:
        until = time.monotonic() + timeout_ms / 1000
        ended = ""
        while True:
            remaining = max(0, round(until - time.monotonic()))
            hold = _call("hold", "take", owner, token, str(remaining), ended)
            try:
                self._see([hold], remaining)
            except _Held as held:
                if held.token and held.token != ended and has_ended(held.token):
                    ended = held.token  # the run that had this lease, on this computer, is no more
                elif time.monotonic() >= until:
                    raise
                else:
                    time.sleep(_POLL_SECONDS)
            else:
                return

    def replace(self, path: Path, data: bytes) -> None:
        self._view.files[path.as_posix()] = data
        self._do("replace", path, data.decode("utf-8"))

    def append(self, path: Path, record: Record) -> None:
        """A record that says that a step is done may wait for the next batch."""
        line = sealed_line(record)
        before = self.content(path)
        if before is None:
            self.replace(path, line)
            return
        sound = before[: sound_size(before, path)]
        if sound != before:
            self.replace(path, sound)
        self._view.files[path.as_posix()] = sound + line
        self._do("append", path, line.decode("ascii"))

    def delete(self, path: Path) -> None:
        self._view.files.pop(path.as_posix(), None)
        self._do("delete", path)

    def write(self, path: Path, text: str) -> None:
        if path.parent.as_posix() not in self._view.made:
            self.read(path)
        self._view.files[path.as_posix()] = text.encode("ascii")
        self._do("write", path, text)

    def make(self, group: Path) -> None:
        name = group.as_posix()
        if name not in self._view.folders:
            self._view.made.add(name)
            self._view.folders.add(name)
        self._do("make", group)

    def remove(self, group: Path) -> None:
        self._forget(group)
        self._do("remove", group, seconds=10)

    def remove_empty(self, group: Path) -> None:
        if not self.folders(group):
            self._forget(group)
        self._do("remove_empty", group)

    def ask_to_end(self, groups: Iterable[Path], grace_ms: int) -> None:
        self._do("ask_to_end", str(-(-grace_ms // 100)), *groups, seconds=grace_ms / 1000)

    def end_processes(self, groups: Iterable[Path]) -> None:
        self._do("end_processes", *groups, seconds=10)

    def run(self, *words: str, may_fail: bool = False) -> None:
        self._do("try" if may_fail else "run", *words, seconds=120)

    def await_text(self, path: Path, pattern: str) -> None:
        self._view.folders |= {path.parent.as_posix(), path.parent.parent.as_posix()}
        self._view.files[path.as_posix()] = pattern.encode("ascii")
        self._do("await", path, pattern, seconds=10)

    def await_removal(self, group: Path) -> None:
        self._forget(group)
        self._do("await_removal", group, seconds=10)

    @contextmanager
    def in_one_batch(self) -> Iterator[None]:
        self._is_gathering = True
        try:
            yield
            self._is_gathering = False
            self.commit()
        except BaseException:
            self._drop_calls()
            self._view = _View()  # it shows what was asked for, and how much of that was done is not known
            raise
        finally:
            self._is_gathering = False

    def commit(self) -> None:
        if self._calls and not self._is_gathering:
            calls, seconds = tuple(self._calls), self._seconds
            self._drop_calls()
            self._send(calls, seconds)

    def _drop_calls(self) -> None:
        self._calls.clear()
        self._seconds = 0.0

    def _do(self, effect: str, *words: Path | str, seconds: float = 0.0) -> None:
        self._calls.append(
            _call("effect", effect, *(word if isinstance(word, str) else word.as_posix() for word in words))
        )
        self._seconds += seconds

    def _forget(self, group: Path) -> None:
        name = group.as_posix()
        self._view.folders.discard(name)
        self._view.made.discard(name)
        for file in [file for file in self._view.files if file.startswith(f"{name}/")]:
            del self._view.files[file]

    def _send(self, calls: Sequence[str], seconds: float) -> None:
        """Have a batch of effects done, and see what the host shows then."""
        if calls and self._lease is None:
            calls = [_call("hold", "take", "a run of one batch", "one batch", "0", ""), *calls, "release"]
        self._see(calls, seconds)

    def _see(self, calls: Sequence[str], seconds: float) -> None:
        self._view = self._answer([*calls, *self._looks()], seconds)
        self._seen = time.monotonic()

    def _answer(self, calls: Sequence[str], seconds: float) -> _View:
        """Send a batch, and return what it shows.

        Raises:
            HostError: the host was not reached or not understood, another run holds it, or this run has lost it.
            OSError: an effect failed; the message is that of the host.
        """
        if self._lease is not None:
            owner, token = self._lease
            calls = [_call("hold", "keep", owner, token, "10", ""), *calls]
        settings = f"FOLDER={quote(self._folder.as_posix())}"
        program = shipped_text("templates/shell/effects.sh")
        batch = "\n".join([settings, program, "batch() {", *calls, "echo end", "}", "batch", ""])
        result = self._channel.run(COMMAND, batch.encode("utf-8"), ANSWER_SECONDS + seconds)
        return self._understood(result)

    def _understood(self, result: CommandResult) -> _View:
        before, ready, answer = result.output.partition("rarms: ready\n")
        if not ready:
            raise self._not_reached(before, result)
        lines = answer.split("\n")
        view = _View()
        shown: list[bytes] = []
        name = ""
        for number, line in enumerate(lines):
            kind, _, text = line.partition(" ")
            if line.startswith(" "):
                shown.append(text.encode() + b"\n")
            elif line == "+":
                shown[-1:] = [text.removesuffix(b"\n") for text in shown[-1:]]
            elif name and kind in {"d", "w", "f", "ok", "no", "end", "open"}:
                view.files[name], name, shown = b"".join(shown), "", []
            match kind:
                case "d" | "w":
                    view.folders.add(self._checked(text))
                    if kind == "w":
                        view.writable.add(text)
                case "f":
                    name = self._checked(text)
                case "no":
                    raise OSError(errno.EIO, text.strip()[-500:])
                case "held":
                    raise _Held(self._host, text or "another process", lines[number + 1])
                case "lost":
                    raise HostTakenOver(self._host, text or "a run that has ended")
                case "open":
                    view.is_private = False
                case "end":
                    return view
                case _:
                    pass  # an effect is done, or a line was printed by none
        if not view.is_private:
            raise open_folder(self._host, self._folder)
        message = f"the connection to {self._channel.target} broke: {_last_line(result.error)}".rstrip(".")
        raise HostFailed(self._host, message, "Run the same command again once the host is up.")

    def _not_reached(self, before: str, result: CommandResult) -> HostFailed:
        target, error = self._channel.target, _last_line(result.error)
        user = next((line for line in before.split("\n") if line.startswith("rarms: user ")), "")
        if user:
            message = f"{target} is not root there, and `sudo -n sh` is refused: {error}"
            advice = "Connect as root, or let that user run `sudo -n sh` without a password (docs/linux.md)."
        elif result.code == SSH_FAILED:
            message = f"ssh does not reach {target}: {error}".rstrip(".")
            advice = f"Try it by hand, as rarms does, without questions: `ssh -o BatchMode=yes {target}`."
            return HostUnreachable(self._host, message, advice)
        else:
            message = f"`sh` does not start on {target}: {error}"
            advice = "Connect to a Linux host, as a user who may log in there."
        return HostFailed(self._host, message, advice)

    def _checked(self, text: str) -> str:
        path = PurePosixPath(text)
        if not path.is_absolute() or ".." in path.parts:
            message = f"what {self._channel.target} shows cannot be read: a file has the impossible name {text[:100]!r}"
            raise HostFailed(self._host, message, "Look at the host by hand.")
        return text

    def _looks(self) -> Iterator[str]:
        """Yield the calls that show all that is read."""
        unit = slice_unit(self._slice)
        yield _call("show_whole", *MACHINE_FILES)
        yield _call("show_group", f"/{SYSTEMD_FOLDER}")
        for root in _ROOTS:
            folder = (CONTROL_GROUPS / root).as_posix()
            yield _call("show_group", folder, *_GROUP_FILES)
            for name in (self._slice, unit):
                yield _call("show_groups", f"{folder}/{name}", *_GROUP_FILES)
        yield _call("show_files", UNITS.as_posix(), ".slice")
        yield _call("show_files", self._folder.as_posix(), ".json", ".jsonl")


class _Held(HostLocked):
    """Another run holds the host; its token, where it holds it by a lease."""

    def __init__(self, host: str, owner: str, token: str) -> None:
        super().__init__(host, owner)
        self.token = token


def open_remote(host: Host, connect: Connect) -> LinuxHostProvider:
    """Open a Linux host over the system's ssh.

    Args:
        host: as the manifest describes it.
        connect: how it is reached.
    """
    return through_channel(host, ssh_channel(host.name, connect))


def through_channel(
    host: Host, channel: CommandChannel, state_folder: Path = STATE_FOLDER, machine: LinuxMachine | None = None
) -> LinuxHostProvider:
    """Open a Linux host through any channel.

    Args:
        host: as the manifest describes it.
        channel: to the host.
        state_folder: as of `LinuxHostProvider`, there.
        machine: None: as it shows itself.
    """
    return LinuxHostProvider(host, state_folder, machine=machine, effects=RemoteEffects(host, channel, state_folder))


def quote(text: str) -> str:
    """Return the text as a word of a shell, in ASCII; characters that are not printable are written by their bytes.

    Args:
        text: of any length; empty gives an empty word.

    Raises:
        ValueError: it holds a NUL or half a surrogate pair, which no word can.
    """
    if "\0" in text:
        raise ValueError("a word of a shell has no NUL")
    runs = ((plain, "".join(run)) for plain, run in groupby(text, key=_is_plain))
    return "".join(shlex.quote(run) if plain else _printed(run) for plain, run in runs) or "''"


def _is_plain(character: str) -> bool:
    return character == "\n" or (character.isascii() and character.isprintable())


def _printed(run: str) -> str:
    return "\"$(printf '" + "".join(f"\\{byte:03o}" for byte in run.encode()) + "')\""


def _call(*words: str) -> str:
    return " ".join(map(quote, words))


def _names_in(folder: Path, paths: Iterable[str]) -> tuple[str, ...]:
    start = f"{folder.as_posix()}/"
    names = (path.removeprefix(start) for path in paths if path.startswith(start))
    return tuple(sorted(name for name in names if "/" not in name))


def _last_line(text: str) -> str:
    return next((line.strip() for line in reversed(text.split("\n")) if line.strip()), "it said nothing")
