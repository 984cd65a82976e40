"""A way to a host that is a fake in this very process: scripts go there as files, and what they print comes back."""

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from queue import SimpleQueue

from rarms_iac.providers.channel import no_look
from rarms_iac.providers.hyperv.transport import Listener
from rarms_iac.providers.interface import HostFailed, ScriptBundle, ScriptExited, ScriptLost
from tests.fake_powershell.host import WindowsHost
from tests.fake_powershell.run import FOLDER, Ran, put, run
from tests.fake_powershell.values import Value, text


@dataclass(slots=True)
class FakePowerShellTransport:
    """Runs on this host; what is printed `before` and `after` is not the script's. A host of None is out of reach."""

    host: WindowsHost | None
    before: str = ""
    after: str = ""

    def run(
        self, script: ScriptBundle, arguments: Sequence[str], silence_s: float, listener: Listener
    ) -> ScriptExited | ScriptLost:
        """As the protocol says; every line is heard before the script's end is."""
        if self.host is None:
            raise HostFailed("onboard", "nobody answers", "Plug it in.")
        put(self.host, {name: text.encode("ascii") for name, text in script.files.items()})
        ran = run(self.host, script.runs, as_json="-AsJson" in arguments, abandon="-Abandon" in arguments)
        for line in (self.before, *ran.lines, self.after):
            listener.line(line)
        return ScriptLost(why="it was killed") if ran.code is None else ScriptExited(code=ran.code, last_lines=ran.talk)

    def in_windows_powershell(self) -> "FakePowerShellTransport":
        """A process of 5.1, which loads Hyper-V itself on every Windows."""
        assert self.host is not None
        self.host.loads_hyperv, self.host.powershell = True, {"version": "5.1.14393.1", "edition": "Desktop"}
        return self

    @contextmanager
    def session(self, script: ScriptBundle, arguments: Sequence[str]) -> Iterator["FakeConversation"]:
        """As the protocol says; the script runs only while a reader waits for its next line."""
        assert self.host is not None
        put(self.host, {name: text.encode("ascii") for name, text in script.files.items()})
        talk = FakeConversation(self.host, script.runs)
        try:
            yield talk
        finally:
            talk.lay(".stop", "s")
            while talk.next_line(0.0, no_look) is not None:
                continue
            talk.sweep()


class FakeConversation:
    """A script of the fake in a thread, which waits after every line until the next one is asked for."""

    def __init__(self, host: WindowsHost, name: str) -> None:
        self.host, self.name = host, name
        self.ran: Ran | None = None
        self._error: BaseException | None = None
        self._lines: SimpleQueue[str | None] = SimpleQueue()
        self._go = threading.Semaphore(0)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        self._go.acquire()
        try:
            self.ran = run(self.host, self.name, output=_HandedOver(self._lines, self._go))
        except BaseException as error:  # noqa: BLE001 - raised again, to who asks for lines
            self._error = error
        self._lines.put(None)

    def lay(self, suffix: str, data: str) -> None:
        """Put a file beside the script."""
        self.host.write_file(f"{FOLDER}\\{self.name}{suffix}", data.encode("ascii"))

    def sweep(self) -> None:
        """Remove what lies beside the script, as the bootstrap does."""
        for suffix in (".stop", ".next"):
            self.host.files.pop(f"{FOLDER}\\{self.name}{suffix}".lower(), None)

    def next_line(self, silence_s: float, look: Callable[[], None]) -> str | None:
        if not self._thread.is_alive() and self._lines.empty():
            return None
        self._go.release()
        line = self._lines.get(timeout=60)
        if self._error is not None:
            raise self._error
        return line

    def send(self, data: bytes) -> None:
        self.lay(".next" if data.endswith(b".") else ".stop", data.decode("ascii"))

    def close(self) -> None:
        """Its input has no end."""

    def code(self) -> int | None:
        self._thread.join()
        return None if self.ran is None else self.ran.code

    @property
    def error_lines(self) -> tuple[str, ...]:
        return () if self.ran is None else self.ran.talk


class _HandedOver(list[Value]):
    """Lines of a script, each of which waits for who reads it."""

    def __init__(self, lines: SimpleQueue[str | None], go: threading.Semaphore) -> None:
        super().__init__()
        self._handed, self._go = lines, go

    def append(self, value: Value) -> None:
        self._handed.put(text(value))
        self._go.acquire()

    def extend(self, values: object) -> None:
        for value in values:  # type: ignore[attr-defined]  # what the interpreter gives is a list
            self.append(value)
