"""Many jobs a process: a line each, of a command's output or of what the runner tells of a function.

A process that ends itself with exit code 0 after at least one sample has done its part and is started again; any
other end is a failed sample, and it is started again too, as long as failed samples are allowed.
"""

import time
from collections.abc import Generator
from dataclasses import dataclass

from rarms_iac.model.measurement import Sample
from rarms_iac.model.quantities import show_milliseconds
from rarms_iac.running.answers import Answer, Listens, listener
from rarms_iac.running.deaths import ended_well, too_early
from rarms_iac.running.errors import CannotStart
from rarms_iac.running.kept import FLOOD, LONGEST_LINE, Ended, Event, Kept, Line, Started, TooLong
from rarms_iac.running.reading import Unreadable
from rarms_iac.running.record import Ending, Record, earliest

FLOOD_SAYS = f"more than {FLOOD // 2**20} MiB"
LONG_LINE = Unreadable(says=f"a line of more than {LONGEST_LINE // 1024} KiB")


@dataclass(slots=True)
class _Process:
    """What is known of the process that runs now."""

    last: float  # when it began, or its last sample came
    samples: int = 0
    unread: int = 0  # bytes since then that were no sample
    stopping: bool = False


def samples_of_lines(component: str, kept: Kept, record: Record) -> Generator[Sample, None, None]:
    """A sample a line, and one for each death, time-out and unreadable line.

    Raises:
        CannotStart: it cannot be started, or its function not be loaded.
    """
    return _Lines(component, kept, record).samples()


class _Lines:
    def __init__(self, component: str, kept: Kept, record: Record) -> None:
        self._component = component
        self._kept = kept
        self._record = record
        self._listens: Listens = listener(record.run)
        self._patience = record.timeout + (record.period or 0.0)
        self._now = _Process(last=time.perf_counter())

    def samples(self) -> Generator[Sample, None, None]:
        record = self._record
        self._kept.start()
        while record.ending is Ending.RUNNING:
            event = self._kept.next(earliest(self._impatient_at(), record.over))
            at = time.perf_counter() if event is None else event.at
            if record.is_over(at):
                return
            sample = self._sample(event, at)
            if sample is not None:
                yield record.take(sample, at)
            if isinstance(event, Ended):
                self._now = _Process(last=time.perf_counter())
                self._kept.start()

    def _impatient_at(self) -> float | None:
        return None if self._now.stopping else self._now.last + self._patience

    def _sample(self, event: Event | None, at: float) -> Sample | None:
        """The sample that this makes, if any."""
        if self._now.stopping:
            return None  # what it says while it is stopped belongs to no job
        match event:
            case Started():
                self._now.last = at
                return None
            case Line(text=text, size=size):
                return self._of_line(self._listens(text, at), size, at)
            case TooLong(flood=True):
                return self._give_up(f"a line of {FLOOD_SAYS}")
            case TooLong():
                return self._of_line(LONG_LINE, 0, at)
            case Ended():
                well = ended_well(event) and self._now.samples > 0
                return None if well else self._record.failure(self._now.last, too_early(event))
            case None:
                return self._give_up(f"no sample within {show_milliseconds(self._record.run.timeout)}")

    def _of_line(self, answer: Answer | Unreadable | None, size: int, at: float) -> Sample | None:
        if answer is None:
            self._now.unread += size
            return self._give_up(f"{FLOOD_SAYS} without a sample") if self._now.unread > FLOOD else None
        if isinstance(answer, Answer) and answer.cannot:
            raise CannotStart(self._component, answer.cannot)
        if isinstance(answer, Answer) and answer.ready is not None:
            self._record.begin(answer.ready)
            self._now.last = at
            return None
        sample = self._of_job(answer, at)
        self._now.last, self._now.unread = at, 0
        self._now.samples += not sample.failure
        return sample

    def _of_job(self, answer: Answer | Unreadable, at: float) -> Sample:
        if isinstance(answer, Unreadable):
            return self._record.failure(self._now.last, answer.says)
        if answer.failure:
            return self._record.failure(self._now.last if answer.began is None else answer.began, answer.failure)
        told = answer.reading
        took = (told.response_ms or 0.0) / 1000
        began = at - took if answer.began is None else answer.began
        if not self._record.has_begun:
            # How long a program takes to start is no job's time: the setting begins with the first job, as far as
            # its beginning can be told.
            known = took or self._record.period
            self._record.begin(self._now.last if known is None else at - known)
        return self._record.answered(began, told.response_ms, successful=told.successful, count=told.count)

    def _give_up(self, says: str) -> Sample:
        self._now.stopping = True
        self._kept.stop()
        return self._record.failure(self._now.last, says)
