"""A Linux host over the system's ssh: a shell of root there does what rarms asks, one call after the other.

Everything that rarms reads comes in one answer and is laid out in a folder here as it lies there, so that the same code
reads it; what rarms changes, functions of the shell script change (`templates/shell/runtime.sh` and `remote.sh`). The
shell holds the host's lock, so the lock ends with the connection.
"""

import errno
import re
import shlex
import shutil
import tempfile
import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path, PurePosixPath

from rarms_iac.model.host import Connect, Host
from rarms_iac.model.journal import Journal, JournalRecord, RunStarted
from rarms_iac.model.operations import Operation
from rarms_iac.model.plan import Scope
from rarms_iac.model.state import State
from rarms_iac.providers.cgroups.content import GroupDefinition, write_definition
from rarms_iac.providers.cgroups.find_tree import CONTROL_GROUPS, MissingFeatures, find_tree
from rarms_iac.providers.cgroups.groups import GroupEffects, GroupTree, GroupValues
from rarms_iac.providers.cgroups.machine import LinuxMachine, read_machine
from rarms_iac.providers.cgroups.processes import orphans
from rarms_iac.providers.cgroups.run import STATE_FOLDER, LinuxHostProvider
from rarms_iac.providers.channel import Channel, SilenceTimeout, await_line, last_of, open_channel, ssh_words
from rarms_iac.providers.interface import HostFailed, HostLocked, ObservedHost
from rarms_iac.providers.journaled import record_line
from rarms_iac.storage.reading import STATE_LIMIT
from rarms_iac.storage.shipped import shipped_text

SHELL = ("sh",)
ANSWER_SECONDS = 60.0
"""How long a call may take, beside what it was told to wait for."""

_READY = "rarms: user "
_SAY_USER = f'echo "{_READY}$(id -u)"'
_END = re.compile(r"end ([0-9]{1,3})")


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


class RemoteShell:
    """A shell of root on a host."""

    def __init__(self, host: str, target: str, channel: Channel) -> None:
        """Take a channel to a shell that has just started.

        Args:
            host: its name in the manifest.
            target: what ssh connects to.
            channel: of ssh.
        """
        self._host = host
        self._target = target
        self._channel = channel
        self._lost = ""  # why no answer can be expected any more

    def become_root(self, preamble: str) -> None:
        """Have root's shell there, with the functions that are called then.

        Args:
            preamble: what the shell reads first; nothing of it prints.

        Raises:
            HostFailed: the host cannot be reached, has no `sh`, or lets this user do nothing as root.
        """
        user = self._user(_SAY_USER)
        if user is None:
            message = f"`sh` does not start on {self._target}: {last_of(self._channel.error_lines)}"
            raise HostFailed(self._host, message, "Connect to a Linux host, as a user who may log in there.")
        # NOTE: one line, because a shell that reads in blocks takes what follows `exec` with it.
        if user != "0" and self._user(f"exec sudo -n sh -c '{_SAY_USER}; exec sh'") != "0":
            message = f"{self._target} is not root there, and `sudo -n sh` is refused: "
            message += last_of(self._channel.error_lines)
            advice = "Connect as root, or let that user run `sudo -n sh` without a password (docs/linux.md)."
            raise HostFailed(self._host, message, advice)
        self._channel.send(preamble.encode("ascii"))

    def _user(self, command: str) -> str | None:
        """Return the number of the user that a command tells; None: the shell has ended."""
        self._channel.send(f"{command}\n".encode("ascii"))
        line = await_line(self._channel, self._host, self._target, lambda line: line.startswith(_READY))
        return None if line is None else line.removeprefix(_READY)

    def ask(self, *words: str, seconds: float = 0.0) -> tuple[int, tuple[str, ...]]:
        """Call a function of the shell.

        Args:
            words: its name and arguments, any text.
            seconds: what it may take beside `ANSWER_SECONDS`.

        Returns:
            The exit code, and the lines of the answer.

        Raises:
            HostFailed: the connection broke, or the answer does not end: it may have been done or not.
        """
        if self._lost:  # a late answer would be taken for that to this call
            raise self._broken(self._lost)
        # NOTE: braces, because a shell does the part of a line that comes before its input ends.
        self._channel.send(f"{{\n{' '.join(map(quote, words))}\n}}\n".encode("ascii"))
        lines: list[str] = []
        size = 0
        try:
            while (line := self._channel.next_line(ANSWER_SECONDS + seconds, lambda: None)) is not None:
                if ended := _END.fullmatch(line):
                    return int(ended[1]), tuple(lines)
                lines.append(line)
                size += len(line)
                if size > STATE_LIMIT:
                    raise self._broken(f"its answer has more than {STATE_LIMIT:,} bytes")
        except SilenceTimeout:
            raise self._broken(f"it said nothing for {ANSWER_SECONDS + seconds:.0f} s") from None
        raise self._broken(last_of(self._channel.error_lines))

    def do(self, *words: str, seconds: float = 0.0) -> None:
        """Call a function that changes something.

        Args:
            words: as of `ask`.
            seconds: as of `ask`.

        Raises:
            OSError: it was refused; the message is that of the host.
            HostFailed: as of `ask`.
        """
        code, lines = self.ask("answer", *words, seconds=seconds)
        if code:
            raise OSError(errno.EIO, text_of(lines) or f"{words[0]} ended with exit code {code}")

    def end(self) -> None:
        """Let the shell end, and with it the lock, before anybody else asks for it."""
        self._channel.close()
        self._channel.code()

    def _broken(self, message: str) -> HostFailed:
        self._lost = message
        message = f"the connection to {self._target} broke: {message}".rstrip(".")
        return HostFailed(self._host, message, "Run the same command again once the host is up.")


def text_of(lines: Sequence[str]) -> str:
    """Return what an answer says, on one line and no longer than a finding may be."""
    return " ".join(line.removeprefix("m ") for line in lines)[-500:].strip()


class _RemoteGroups:
    """The effects on control groups of a host."""

    def __init__(self, shell: RemoteShell, tree: GroupTree) -> None:
        self._shell = shell
        self._tree = tree

    def make(self, name: str) -> None:
        """See `GroupTree.make`."""
        self._do(name, "make_group")

    def write(self, name: str, values: GroupValues) -> None:
        """See `GroupTree.write`."""
        shown = self._tree.as_kernel_shows(values)
        shares = round(shown.shares_percent * (10 if self._tree.version == "v1" else 1))
        quota = -1 if shown.quota_percent is None else round(shown.quota_percent * shown.period_us / 100)
        self._do(name, "write_values", shares, quota, shown.period_us, shown.memory or 0)

    def start_with_machine(self, name: str, starts: bool) -> None:
        """See `GroupTree.start_with_machine`."""
        self._do(name, "start_if", int(starts))

    def limit_slice(self, percent: int | None) -> None:
        """See `GroupTree.limit_slice`."""
        self._do("", "set_slice_limit", -1 if percent is None else percent)

    def ask_to_end(self, name: str, grace_ms: int) -> None:
        """See `GroupTree.ask_to_end`."""
        self._do(name, "ask_to_end", -(-grace_ms // 100), seconds=grace_ms / 1000)

    def remove(self, name: str) -> None:
        """See `GroupTree.remove`."""
        self._do(name, "remove_group")

    def _do(self, name: str, function: str, *numbers: int, seconds: float = 0.0) -> None:
        self._shell.do("in_group", self._tree.version, name, function, *map(str, numbers), seconds=seconds)


class RemoteLinuxHost(LinuxHostProvider):
    """A `StepwiseHost` whose partitions are control groups of another machine."""

    def __init__(
        self,
        host: Host,
        connect: Connect,
        state_folder: Path = STATE_FOLDER,
        machine: LinuxMachine | None = None,
        words: Sequence[str] = (),
    ) -> None:
        """Prepare; nothing is connected before the first call.

        Args:
            host: as the manifest describes it.
            connect: how it is reached.
            state_folder: as of `LinuxHostProvider`, there.
            machine: None: as it shows itself.
            words: the program that leads to a shell there; empty: ssh.
        """
        temporary = tempfile.mkdtemp(prefix="rarms-")  # nobody else may look into it
        weakref.finalize(self, shutil.rmtree, temporary, ignore_errors=True)
        self._copy = Path(temporary, "host")
        super().__init__(host, self._here(state_folder), machine=machine)
        self._shown_folder = state_folder / self._folder.name
        self._target = connect.ssh
        self._words = words or ssh_words(connect.ssh, SHELL)
        self._shell: RemoteShell | None = None
        self._described_machine = machine
        self._facts: Mapping[str, str] = {}

    def examined(self) -> ObservedHost:
        """See `LinuxHostProvider.examined`."""
        with self._connection():
            return super().examined()

    def journal(self) -> Journal | None:
        """See the interface."""
        self._refresh()
        return super().journal()

    def unfinished(self) -> Journal | None:
        """See the interface."""
        self._refresh()
        return super().unfinished()

    def execute(self, operation: Operation, scope: Scope) -> None:
        """See the interface."""
        with self._connection():
            super().execute(operation, scope)

    @contextmanager
    def lock(self, owner: str, timeout_ms: int = 0) -> Iterator[None]:
        """See the interface: it is held until the connection ends."""
        with self._connection() as shell:
            self._refresh()
            self._refuse_writable_folder()
            code, lines = shell.ask("hold", owner, str(-(-timeout_ms // 1000)), seconds=timeout_ms / 1000)
            if code:
                raise HostLocked(self.name, text_of(lines) or "another process")
            self._refresh()
            self._recover()
            yield

    def start_run(self, started: RunStarted) -> None:
        """See the interface."""
        self._change_file("replace_by", self._journal_path, record_line(started))

    def record(self, record: JournalRecord) -> None:
        """See the interface."""
        self._change_file("append_to", self._journal_path, record_line(record))

    def _save(self, definition: GroupDefinition) -> None:
        self._change_file("replace_by", self._file(definition), write_definition(definition))

    def _forget(self, definition: GroupDefinition) -> None:
        self._change_file("remove_file", self._file(definition))

    def _change_file(self, function: str, path: Path, *data: bytes) -> None:
        there = (self._shown_folder / path.name).as_posix()
        with self._report_failure(path), self._connection() as shell:
            shell.do(function, there, *(text.decode("ascii") for text in data))

    @contextmanager
    def _report_damage(self, path: Path) -> Iterator[None]:
        with super()._report_damage(self._shown_folder / path.name):
            yield

    @contextmanager
    def _report_failure(self, path: Path) -> Iterator[None]:
        with super()._report_failure(self._shown_folder / path.name):
            yield

    def _is_folder_private(self) -> bool:
        return "open" not in self._facts

    def _look(self) -> tuple[State, Mapping[str, GroupDefinition]]:
        self._refresh()
        try:
            return super()._look()
        except (ArithmeticError, LookupError, OSError, StopIteration, ValueError) as problem:
            raise self._unreadable(f"{type(problem).__name__}: {problem}") from problem

    def _make_group(self, name: str) -> None:
        super()._make_group(name)
        self._refresh()  # it is there from now on

    @property
    def _effects(self) -> GroupEffects:
        assert self._shell is not None, "who changes something holds the connection"
        return _RemoteGroups(self._shell, self.tree)

    def _orphans(self, group: str) -> tuple[tuple[int, str], ...]:
        processes = self.tree.processes(group)
        with self._connection() as shell:
            _, lines = shell.ask("show_processes", *map(str, processes))
        self._lay_out(lines)
        return orphans(processes, self._here(PurePosixPath("/proc")))

    def _find_tree(self) -> GroupTree | MissingFeatures:
        if not self._facts:
            self._refresh()
        found = find_tree(self._settings.slice, self._settings.control_groups, self._here(CONTROL_GROUPS))
        if isinstance(found, MissingFeatures):
            return MissingFeatures(names=tuple(name.replace(str(self._copy), "") for name in found.names))
        found.page_bytes = self._fact("page")
        return found

    def _read_machine(self) -> LinuxMachine:
        if not self._facts:
            self._refresh()
        memory = self._fact("pages") * self._fact("page")
        return read_machine(self._copy, self._facts["computer"], self._fact("processors"), memory)

    def _fact(self, name: str) -> int:
        """Return a number that the host said of itself.

        Raises:
            HostFailed: it said none.
        """
        value = self._facts.get(name, "")
        if not (value.isascii() and value.isdecimal() and len(value) < 20):
            raise self._unreadable(f"{name} is {value[:100]!r}, and no number")
        return int(value)

    @contextmanager
    def _connection(self) -> Iterator[RemoteShell]:
        """Open a connection, unless this call is part of one that has opened it."""
        if self._shell is not None:
            yield self._shell
            return
        with open_channel(self.name, self._words) as channel:
            self._shell = RemoteShell(self.name, self._target, channel)
            try:
                self._shell.become_root(self._preamble())
                yield self._shell
                self._shell.end()
            finally:
                self._shell = None

    def _preamble(self) -> str:
        folder = quote(self._shown_folder.as_posix())
        settings = (
            "set -eu",
            "umask 077",
            "export LC_ALL=C",
            "PATH=$PATH:/usr/sbin:/sbin",
            "NEWLINE='\n'",
            f"HOST={quote(self.name)} FOLDER={folder} JOURNAL={folder}/{self._journal_path.name}",
            f"SLICE={quote(self._settings.slice)} CONTROL_GROUPS={self._settings.control_groups}",
        )
        files = (shipped_text(f"templates/shell/{name}.sh") for name in ("runtime", "remote"))
        return "\n".join([*settings, *files])

    def _refresh(self) -> None:
        """Lay out what the host shows now."""
        with self._connection() as shell:
            _, lines = shell.ask("look")
        shutil.rmtree(self._copy, ignore_errors=True)
        self._facts = self._lay_out(lines)
        self._known_tree, self._known_machine = None, self._described_machine

    def _lay_out(self, lines: Sequence[str]) -> dict[str, str]:
        """Make the folders and files of an answer below the folder here, and return its facts.

        Raises:
            HostFailed: it cannot be that of a Linux host.
        """
        folders: list[str] = []
        files: dict[str, list[str]] = {}
        shown: list[str] = []
        facts: dict[str, str] = {}
        for line in lines:
            kind, _, text = line.partition(" ")
            if line.startswith(" "):
                shown.append(text)
            elif kind == "d":
                folders.append(text)
            elif kind == "f":
                shown = files[text] = []  # also of one that was shown before
            elif kind == "v":
                name, _, described = text.partition(" ")
                facts[name] = described
        try:
            for folder in folders:
                self._checked(folder).mkdir(parents=True, exist_ok=True)
            for file, content in files.items():
                path = self._checked(file)
                path.parent.mkdir(parents=True, exist_ok=True)
                is_whole = "torn" not in facts or path.name != self._journal_path.name
                path.write_bytes("\n".join([*content, ""] if is_whole and content else content).encode())
        except (OSError, ValueError) as problem:
            raise self._unreadable(str(problem)) from problem
        return facts

    def _checked(self, text: str) -> Path:
        path = PurePosixPath(text)
        if not path.is_absolute() or ".." in path.parts:
            raise ValueError(f"a file has the impossible name {text[:100]!r}")
        return self._here(path)

    def _unreadable(self, message: str) -> HostFailed:
        return HostFailed(
            self.name, f"what {self._target} shows cannot be read: {message[:300]}", "Look at the host by hand."
        )

    def _here(self, path: Path | PurePosixPath) -> Path:
        """Return where a file of the host lies in the folder here."""
        return self._copy.joinpath(*path.parts[1:])
