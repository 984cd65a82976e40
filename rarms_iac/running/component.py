"""Runs a component, or several at once, on this machine: started, watched and ended, with samples as they happen."""

import queue
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

from rarms_iac.model.run import Call, Run
from rarms_iac.model.series import HeardMessages, Sample, Series, SkippedLines
from rarms_iac.model.setting import ThreadsSeen
from rarms_iac.running.environment import file_variables
from rarms_iac.running.kernel_files import entry_of, kernel_text
from rarms_iac.running.message_samples import samples_of_messages, subscriber_order
from rarms_iac.running.orders import StartContext, StartOrder
from rarms_iac.running.samples import SampleRecord, SampleSource, SamplingEnd, samples_of_lines, samples_of_runs
from rarms_iac.running.secrets import hide_secrets
from rarms_iac.running.start import order_of
from rarms_iac.running.supervisor import ReadingInterrupted, Supervisor
from rarms_iac.running.work_places import ComponentPlace

WAITING_SAMPLES = 256
"""So many samples of parallel runs wait to be read; a component that is faster waits for its reader."""


class ComponentRun:
    """Yields each sample as it happens, failed ones too; leaves no process behind when it is closed.

    A context manager, and an iterator of samples; nothing is started before the first sample is asked for.

    Raises:
        CannotStart: a folder, a program or a variable is not there. Iterating raises it, too, and `SupervisorLost`.

    The setting begins with the first job (docs/running.md). The samples end as `ending` says: after `run.until`, with
    more failed ones than `run.failures`, or when it is closed, at any moment.
    """

    def __init__(self, component: str, run: Run, context: StartContext) -> None:
        self.component = component
        self._order = order_of(component, run, context)
        self._source = source_of(component, run, self._order)
        self._inside = context.inside
        self._is_attached = run.attach is not None
        self._killed_before = _killed_for_memory(context.inside.memory_events)
        self._before_end: Callable[[], None] = lambda: None
        self._hide = hide_secrets(run, context.environment, _of_files(component, run, context))
        self._record = SampleRecord(run, self._hide)
        self._supervisor: Supervisor | None = None
        self._interrupted = False
        self._samples = self._begin()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __iter__(self) -> Iterator[Sample]:
        return self

    def __next__(self) -> Sample:
        return next(self._samples)

    def interrupt(self) -> None:
        """Have the thread that reads the samples see no more of them; it is the one to close."""
        self._interrupted = True
        if self._supervisor is not None:
            self._supervisor.interrupt()

    def close(self) -> None:
        """Stop it by its `stop`, and wait until nothing of it is left; may be called twice."""
        if self._record.ending is SamplingEnd.RUNNING:
            self._record.ending = SamplingEnd.CLOSED
        self._samples.close()

    def series(self) -> Series:
        """Return all samples so far; after closing, with the processor time of all of the component's processes."""
        return Series(
            component=self.component,
            samples=tuple(self._record.samples),
            elapsed_ms=self._record.elapsed_ms,
            cpu_ms=self._supervisor.cpu_ms if self._supervisor and self.has_own_time else None,
        )

    @property
    def began(self) -> float:
        """When the setting began, on the clock of `time.perf_counter`: `Sample.began_ms` counts from then."""
        return self._record.begin(time.perf_counter())

    @property
    def process(self) -> int | None:
        """The id of its supervisor, below which all of its processes are; None: nothing was started yet."""
        return self._supervisor.process if self._supervisor else None

    @property
    def has_own_time(self) -> bool:
        """Whether the processor time below its supervisor is its own; that of a service is its unit's alone."""
        endings = (process.ending for process in self._order.processes)
        return not self._is_attached and all(ending is None or ending.is_below for ending in endings)

    @property
    def place(self) -> ComponentPlace:
        """Where its processes belong."""
        supervisor = None if self._is_attached else self.process  # below it is what reads the log
        has_own_group = any(process.ending is not None for process in self._order.processes)
        groups = self._inside.groups
        return ComponentPlace(
            component=self.component, supervisor=supervisor, groups=groups, has_own_group=has_own_group
        )

    @property
    def killed_for_memory(self) -> int:
        """How many processes of its control group the kernel killed since the start because of the group's memory."""
        return _killed_for_memory(self._inside.memory_events) - self._killed_before

    @property
    def threads(self) -> ThreadsSeen:
        """What was seen of the threads that are to have a task class by their names."""
        return self._supervisor.threads if self._supervisor else ThreadsSeen()

    def call_before_end(self, look: Callable[[], None]) -> None:
        """Have this called when no more samples come, while its processes are still there."""
        self._before_end = look

    def call_while_waiting(self, say: Callable[[str], None]) -> None:
        """Have this called, by the thread that reads the samples, with the messages that do not come."""
        self._record.waits = say

    @property
    def ending(self) -> SamplingEnd:
        """Why no more samples come."""
        return self._record.ending

    @property
    def skipped(self) -> SkippedLines:
        """The lines so far that were not samples."""
        return self._record.skipped

    @property
    def heard(self) -> HeardMessages | None:
        """The messages so far; None: its samples do not come from messages."""
        return self._record.heard() if self._record.heard else None

    @property
    def tail(self) -> str:
        """The last text of standard error, or of standard output where samples are read from standard error.

        At most 4 KiB.
        """
        return self._hide(self._supervisor.tail) if self._supervisor else ""

    def _begin(self) -> Generator[Sample, None, None]:
        supervisor = self._supervisor = Supervisor(self._order)
        if self._interrupted:
            supervisor.interrupt()
        try:
            yield from self._source(supervisor, self._record)
        except ReadingInterrupted:
            self._record.ending = SamplingEnd.CLOSED
        finally:
            try:
                self._before_end()
            finally:
                supervisor.close()


def source_of(component: str, run: Run, order: StartOrder) -> SampleSource:
    """Return the source of a component's samples, as `run.samples` says.

    Args:
        order: The component's own.

    Raises:
        CannotStart: What the samples need is not there.
    """
    subscriber = subscriber_order(component, run, order)
    if subscriber is not None:
        return samples_of_messages(subscriber)
    return samples_of_lines if isinstance(run.start, Call) or run.has_lines else samples_of_runs


def _of_files(component: str, run: Run, context: StartContext) -> dict[str, str]:
    found: dict[str, str] = {}
    for process in run.each_process.values():
        found |= file_variables(component, process, context.base)
    return found


def _killed_for_memory(events: Path | None) -> int:
    return 0 if events is None else entry_of(events, kernel_text(events), "oom_kill")


_Message = tuple[str, Sample | BaseException | None]
"""A component's name with a sample, with the exception that ended its run, or with None when it has ended."""


@contextmanager
def run_in_parallel(runs: Sequence[ComponentRun]) -> Iterator[Iterator[tuple[str, Sample]]]:
    """Run several components at once and read their samples, each with the component's name, as they happen.

    Each run ends as its own `until` says; leaving the `with` ends all of them, at any moment, and closes them.

    Raises:
        CannotStart, SupervisorLost: raised to the reader of the samples, of any run.
    """
    messages: queue.Queue[_Message] = queue.Queue(WAITING_SAMPLES)
    threads = [threading.Thread(target=_read_run, args=(run, messages), daemon=True) for run in runs]
    for thread in threads:
        thread.start()
    try:
        yield _read_samples(messages, len(threads))
    finally:
        for run in runs:
            run.interrupt()
        while any(thread.is_alive() for thread in threads):
            try:
                messages.get(timeout=0.02)  # a thread may wait for room in the queue
            except queue.Empty:
                continue


def _read_samples(messages: queue.Queue[_Message], running: int) -> Iterator[tuple[str, Sample]]:
    while running:
        try:
            component, message = messages.get(timeout=0.5)  # in pieces: on Windows an endless wait hears no Ctrl-C
        except queue.Empty:
            continue
        if isinstance(message, BaseException):
            raise message
        if message is None:
            running -= 1
        else:
            yield component, message


def _read_run(run: ComponentRun, messages: queue.Queue[_Message]) -> None:
    """Read one component's samples and close it; runs in a thread."""
    last: BaseException | None = None
    try:
        with run:
            for sample in run:
                messages.put((run.component, sample))
    except BaseException as error:  # noqa: BLE001 - raised again, to the reader of the samples
        last = error
    messages.put((run.component, last))
