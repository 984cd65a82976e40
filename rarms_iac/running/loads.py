"""Interfering loads as real processes: busy loops, bursts, browsers that stream video, stress-ng, any other program."""

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self, assert_never

from rarms_iac.model.loads import Browser, Bursts, BusyLoop, CommandLoad, Interference, Stress
from rarms_iac.running.events import OutputLine, ProcessEnded
from rarms_iac.running.orders import CannotStart, RunningError, StartContext
from rarms_iac.running.start import order_of_words
from rarms_iac.running.supervisor import Supervisor
from rarms_iac.texts.quantities import show_milliseconds

HERE = Path(__file__).resolve().parent
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
BUSY_LOOP = """\
import os
if hasattr(os, "sched_setaffinity"):
    processors = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, [processors[{n} % len(processors)]])
while True: pass
"""
"""A loop that never waits, one of a busy-loop program's (BLP), on a processor of its own as long as there are enough:
were they moved about, a component would have a processor to itself for half a second, and then again would not."""

STREAMS = "rarms streams"
"""What `stream.html` writes to the browser's console when its video plays."""

FLAGS = (
    "--headless",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-background-timer-throttling",
    "--autoplay-policy=no-user-gesture-required",
    "--enable-logging=stderr",
)
STRESS_NG = "stress-ng"
STRESSING = "dispatching hogs"
"""What stress-ng writes to standard error when its workers begin."""

STRESSING_TIME = "365d"
"""Longer than anything is measured. 0 is not an end for most stressors, but `timer` ends then after some seconds."""

SETTLING_S = 60.0
"""How long all instances may take to be running: ten browsers at once are slow to start."""


class LoadEnded(RunningError):
    """An interfering load ended while it was to go on: what was measured since then does not count."""

    def __init__(self, load: str, message: str) -> None:
        super().__init__(f"{load}: {message}")
        self.load = load
        self.message = message


class InterferingLoad:
    """An interfering load that runs until it is closed; nothing of it stays.

    Raises:
        CannotStart: a program is not there, or it does not get to run.
    """

    def __init__(
        self,
        name: str,
        load: Interference,
        context: StartContext,
        *,
        processors: int | None = None,
        reserve: float | None = None,
    ) -> None:
        """Start it, and wait until it runs.

        Args:
            processors: the LPs to keep busy, where the load does not say how many; None: this machine's.
            reserve: per cent of each processor that its partition reserves; None: it has no partition.
        """
        self.name = name
        self._scratch = Path(tempfile.mkdtemp(prefix="rarms-load-"))
        try:
            words = load_words(name, load, self._scratch, processors or logical_processors(), reserve)
            self._supervisor = Supervisor(order_of_words(name, words, context))
            try:
                self._wait()
            except BaseException:
                self._supervisor.close()
                raise
        except BaseException:
            shutil.rmtree(self._scratch, ignore_errors=True)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def check(self) -> None:
        """Look whether it still runs.

        Raises:
            LoadEnded: it does not.
        """
        while (event := self._supervisor.next(until=0.0)) is not None:
            if isinstance(event, ProcessEnded):
                raise LoadEnded(self.name, self._last_words())

    def close(self) -> None:
        """End it; may be called twice."""
        self._supervisor.close()
        shutil.rmtree(self._scratch, ignore_errors=True)

    @property
    def cpu_ms(self) -> float | None:
        """The processor time that it took, once closed; None where it is not known."""
        return self._supervisor.cpu_ms

    def _wait(self) -> None:
        until = time.perf_counter() + SETTLING_S
        self._supervisor.start()
        while True:
            match self._supervisor.next(until):
                case OutputLine(text="running"):
                    return
                case ProcessEnded():
                    raise CannotStart(self.name, self._last_words())
                case None:
                    waited = show_milliseconds(int(1000 * SETTLING_S))
                    raise CannotStart(self.name, f"it did not start within {waited}: {self._last_words()}")
                case _:
                    pass

    def _last_words(self) -> str:
        lines = [line.strip()[-200:] for line in self._supervisor.tail.splitlines() if line.strip()]
        return "; ".join(lines[-2:]) or "it ended"


def load_words(name: str, load: Interference, scratch: Path, processors: int, reserve: float | None) -> tuple[str, ...]:
    """Return the program that is the load, as words.

    Raises:
        CannotStart: no browser, or no stress-ng, on this machine; or bursts are to take what a partition
            reserves, and there is none.
    """
    python = (sys.executable, "-I", "-S")
    several = (*python, str(HERE / "instances.py"))
    match load:
        case BusyLoop(threads=threads):
            return (*several, str(threads or processors), "", *python, "-c", BUSY_LOOP)
        case Bursts(duty=None) if reserve is None:
            raise CannotStart(name, "without a partition, the load needs a `duty`")
        case Bursts(threads=threads):
            cycle = load.cycle(reserve or 0.0)
            times = (str(round(1e6 * cycle.burst_ms)), str(round(1e6 * cycle.gap_ms)))
            return (*python, str(HERE / "bursts.py"), str(threads or processors), *times)
        case Browser(instances=instances):
            profile = f"--user-data-dir={scratch / 'profile-{n}'}"
            page = (HERE / "stream.html").as_uri()
            browser = find_program(name, "browser", BROWSERS)
            return (*several, str(instances), STREAMS, browser, *FLAGS, *_sandbox(), profile, page)
        case Stress(stressor=stressor, workers=workers):
            program = find_program(name, STRESS_NG, (STRESS_NG,))
            count = str(workers or processors)
            own = (f"--{stressor}", count, "--timeout", STRESSING_TIME, "--temp-path", str(scratch))
            return (*several, "1", STRESSING, program, *own)
        case CommandLoad(command=command, instances=instances):
            return (*several, str(instances), "", *command)
        case _:
            assert_never(load)


def check_load(name: str, load: Interference, context: StartContext) -> None:
    """Look whether this machine has the program that is the load.

    Raises:
        CannotStart: it has not.
    """
    if isinstance(load, CommandLoad):
        order_of_words(name, load.command, context)
    else:
        load_words(name, load, context.base, 1, 0.0)


def find_program(name: str, kind: str, programs: Sequence[str]) -> str:
    """Return the first of these programs that this machine has, for the load of this name.

    Raises:
        CannotStart: it has none.
    """
    for program in programs:
        if path := shutil.which(program):
            return path
    raise CannotStart(name, f"{kind} was not found on the PATH: {', '.join(programs)}")


def logical_processors() -> int:
    """Return the LPs that this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _sandbox() -> tuple[str, ...]:
    """Disable the sandbox for root: Chromium does not start with it. It shows our own page only."""
    return ("--no-sandbox",) if hasattr(os, "geteuid") and os.geteuid() == 0 else ()
