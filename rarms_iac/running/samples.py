"""Makes samples of what a component does: a line a job, or a process a job; and says when there are enough."""

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from enum import StrEnum

from rarms_iac.model.run import Elapsed, Periodic, Run, SampleCount
from rarms_iac.model.series import HeardMessages, Sample, SkippedLines
from rarms_iac.running.events import (
    FLOOD,
    LONGEST_LINE,
    Event,
    OutputLine,
    OverlongLine,
    ProcessEnded,
    ProcessStarted,
    describe_death,
    describe_early_end,
    ended_by_itself,
    named_end,
)
from rarms_iac.running.orders import CannotStart
from rarms_iac.running.reading import (
    AnswerReader,
    JobAnswer,
    Unreadable,
    answer_reader,
    describe_no_sample,
    lines_that_match,
    skip_line,
)
from rarms_iac.running.supervisor import Supervisor
from rarms_iac.texts.quantities import show_milliseconds

FLOOD_SIZE = f"more than {FLOOD // 2**20} MiB"
LONG_LINE = Unreadable(message=f"a line of more than {LONGEST_LINE // 1024} KiB")


class SamplingEnd(StrEnum):
    """The reason for the end of the samples."""

    RUNNING = "running"  # they still do
    UNTIL = "until"  # measured enough, as the manifest says
    FAILURES = "failures"  # more failed samples than it allows: no verdict
    CLOSED = "closed"  # their reader has seen enough


class SampleRecord:
    """The samples of one run and its times, which are those of `time.perf_counter` in seconds."""

    def __init__(self, run: Run, hide: Callable[[str], str] = str) -> None:
        """Take `hide`, which removes from a failed sample's reason what must not be recorded."""
        self.run = run
        self._hide = hide
        self.samples: list[Sample] = []
        self.failed = 0
        self.skipped = SkippedLines()
        self.heard: Callable[[], HeardMessages] | None = None  # None: the samples do not come from messages
        self.waits: Callable[[str], None] = lambda _missing: None  # hears which messages do not come
        self.ending = SamplingEnd.RUNNING
        self._begun: float | None = None
        self._last: float | None = None

    def begin(self, at: float) -> float:
        """Return the setting begins, if it has not yet; answers with when it did."""
        if self._begun is None:
            self._begun = at
        return self._begun

    @property
    def has_begun(self) -> bool:
        """Whether the component has begun to do its jobs."""
        return self._begun is not None

    def take(self, sample: Sample, at: float) -> Sample:
        """Count a sample in that came at this time."""
        if sample.failure:
            sample = replace(sample, failure=self._hide(sample.failure))
        self.samples.append(sample)
        self.failed += bool(sample.failure)
        self._last = at
        if self.failed > self.run.failures:
            self.ending = SamplingEnd.FAILURES
        elif isinstance(self.run.ends, SampleCount) and len(self.samples) >= self.run.ends.samples:
            self.ending = SamplingEnd.UNTIL
        return sample

    def skip(self, line: str) -> None:
        """Count a line that is not a sample."""
        self.skipped = skip_line(self.skipped, self._hide(line))

    def is_over(self, at: float) -> bool:
        """Return whether the setting has lasted long enough at this time; it then ends."""
        over = self.over
        if over is None or at < over:
            return False
        self.ending, self._last = SamplingEnd.UNTIL, over
        return True

    @property
    def over(self) -> float | None:
        """When the setting ends; None where samples decide, or it has not begun."""
        match self.run.ends:
            case Elapsed(time=limit) if self._begun is not None:
                return self._begun + float(limit) / 1000
            case _:
                return None

    @property
    def elapsed_ms(self) -> float:
        """From its begin to its end, or to the last sample where nothing but samples can end it."""
        if self._begun is None:
            return 0.0
        return 1000 * max(0.0, (self._last if self._last is not None else time.perf_counter()) - self._begun)

    def answered(self, began: float, response_ms: float | None, *, successful: bool, count: float = 1.0) -> Sample:
        """Return a job's sample."""
        return Sample(began_ms=self._since(began), response_ms=response_ms, successful=successful, count=count)

    def failure(self, began: float, message: str) -> Sample:
        """Return a failed sample: unsuccessful, without response time, and why."""
        return Sample(began_ms=self._since(began), response_ms=None, successful=False, failure=message)

    @property
    def timeout(self) -> float:
        """How long a job may take, in seconds."""
        return float(self.run.timeout) / 1000

    @property
    def period(self) -> float | None:
        """The period of a periodic component, in seconds."""
        arrival = self.run.arrival
        return float(arrival.period) / 1000 if isinstance(arrival, Periodic) else None

    def _since(self, at: float) -> float:
        return 1000 * max(0.0, at - self.begin(at))


SampleSource = Callable[[Supervisor, SampleRecord], Generator[Sample, None, None]]
"""Makes the samples of a component until its record has an ending: of its lines, its processes, or messages.

It starts the component by its supervisor, again where it ended, and takes each sample into the record. Processes of its
own end when it is closed. It raises `CannotStart` where the component, or what the samples need, cannot be started.
"""


def earliest(*times: float | None) -> float | None:
    """Return the first of these times; None where there is none."""
    known = [time for time in times if time is not None]
    return min(known) if known else None


@dataclass(slots=True)
class _Process:
    """The process that runs now: its samples, and its output since the last one."""

    last: float  # when it began, or its last sample came
    samples: int = 0
    unread: int = 0  # bytes of skipped lines since then
    skipped: SkippedLines = SkippedLines()
    stopping: bool = False


def samples_of_lines(supervisor: Supervisor, record: SampleRecord) -> Generator[Sample, None, None]:
    """Make a sample of each line, and one for each death, time-out and unreadable line.

    A process that ends itself with exit code 0 after at least one sample has done its part and is started again; any
    other end is a failed sample, and it is started again too, as long as failed samples are allowed.

    Raises:
        CannotStart: it cannot be started, or its function not be loaded.
    """
    return _LineReader(supervisor, record).samples()


class _LineReader:
    def __init__(self, supervisor: Supervisor, record: SampleRecord) -> None:
        self._supervisor = supervisor
        self._record = record
        self._read_answer: AnswerReader = answer_reader(record.run)
        self._patience = record.timeout + (record.period or 0.0)
        self._now = _Process(last=time.perf_counter())

    def samples(self) -> Generator[Sample, None, None]:
        record = self._record
        self._supervisor.start()
        while record.ending is SamplingEnd.RUNNING:
            event = self._supervisor.next(earliest(self._impatient_at(), record.over))
            at = time.perf_counter() if event is None else event.at
            if record.is_over(at):
                return
            sample = self._sample(event, at)
            if sample is not None:
                yield record.take(sample, at)
            if isinstance(event, ProcessEnded):
                self._now = _Process(last=time.perf_counter())
                self._supervisor.start()

    def _impatient_at(self) -> float | None:
        return None if self._now.stopping else self._now.last + self._patience

    def _sample(self, event: Event | None, at: float) -> Sample | None:
        """Return the sample that this makes, if any."""
        if self._now.stopping:
            return None  # a line of a process that is being stopped belongs to no job
        match event:
            case ProcessStarted():
                self._now.last = at
                return None
            case OutputLine(text=text):
                answer = self._read_answer(text)
                return self._skip(event) if answer is None else self._of_line(answer, at)
            case OverlongLine(flood=True):
                return self._give_up(f"a line of {FLOOD_SIZE}")
            case OverlongLine():
                return self._of_line(LONG_LINE, at)
            case ProcessEnded():
                ended = named_end(event, self._record.run.samples.process)
                if ended_by_itself(ended) and self._now.samples > 0:
                    return None
                return self._record.failure(self._now.last, self._without_sample(describe_early_end(ended)))
            case None:
                timeout = show_milliseconds(self._record.run.timeout)
                return self._give_up(self._without_sample(f"no sample within {timeout}"))

    def _skip(self, line: OutputLine) -> Sample | None:
        self._record.skip(line.text)
        self._now.skipped = skip_line(self._now.skipped, line.text)
        self._now.unread += line.size
        if self._now.unread <= FLOOD:
            return None
        return self._give_up(self._without_sample(f"{FLOOD_SIZE} without a sample"))

    def _without_sample(self, message: str) -> str:
        """Add what the component wrote instead, as far as this process has not made a sample."""
        run = self._record.run
        if self._now.samples or not run.has_lines:
            return message
        elsewhere = lines_that_match(self._read_answer, self._supervisor.settled_tail())
        return describe_no_sample(message, run.samples, self._now.skipped, elsewhere)

    def _of_line(self, answer: JobAnswer | Unreadable, at: float) -> Sample | None:
        if isinstance(answer, JobAnswer) and answer.cannot:
            raise CannotStart(self._supervisor.name, answer.cannot)
        if isinstance(answer, JobAnswer) and answer.ready is not None:
            self._record.begin(answer.ready)
            self._now.last = at
            return None
        sample = self._of_job(answer, at)
        self._now.last, self._now.unread = at, 0
        self._now.samples += not sample.failure
        return sample

    def _of_job(self, answer: JobAnswer | Unreadable, at: float) -> Sample:
        if isinstance(answer, Unreadable):
            return self._record.failure(self._now.last, answer.message)
        if answer.failure:
            return self._record.failure(self._now.last if answer.began is None else answer.began, answer.failure)
        result = answer.reading
        took = (result.response_ms or 0.0) / 1000
        began = at - took if answer.began is None else answer.began
        if not self._record.has_begun:
            # The start of a program is not part of a job: the setting begins with the first job, as far as its
            # beginning can be known.
            known = took or self._record.period
            self._record.begin(self._now.last if known is None else at - known)
        return self._record.answered(began, result.response_ms, successful=result.successful, count=result.count)

    def _give_up(self, message: str) -> Sample:
        self._now.stopping = True
        self._supervisor.stop()
        return self._record.failure(self._now.last, message)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Job:
    """A process that has ended."""

    began: float
    ended: ProcessEnded
    late: bool  # it was stopped, since it took longer than a job may


def samples_of_runs(supervisor: Supervisor, record: SampleRecord) -> Generator[Sample, None, None]:
    """Yield job after job; a periodic one counts from its scheduled start, and no overrun shifts the schedule."""
    supervisor.ignore_output()
    number = 0
    while record.ending is SamplingEnd.RUNNING:
        due = _due(record, number)
        job = _one_job(supervisor, record, due)
        if job is None or record.is_over(job.ended.at):
            return
        scheduled = job.began if due is None else due
        yield record.take(_sample(record, scheduled, job), job.ended.at)
        number += 1


def _due(record: SampleRecord, number: int) -> float | None:
    """Return the start time of the job; None: at once, and its time counts from then."""
    if record.period is None or not record.has_begun:
        return None
    return record.begin(0.0) + number * record.period


def _one_job(supervisor: Supervisor, record: SampleRecord, due: float | None) -> _Job | None:
    """Start a job and wait for its end; None where the setting ends before."""
    now = time.perf_counter()
    supervisor.start(now if due is None else due)
    began, late = max(now, due or 0.0), False
    ends: float | None = None  # by when it has to; a job that has not started could not be stopped
    while True:
        event = supervisor.next(earliest(None if late else ends, record.over))
        match event:
            case ProcessStarted(at=at):
                began, ends = at, at + record.timeout
                record.begin(at)
            case ProcessEnded():
                return _Job(began=began, ended=event, late=late)
            case None if record.is_over(time.perf_counter()):
                return None
            case None:
                late = True
                supervisor.stop()
            case _:
                pass  # its output is not heard


def _sample(record: SampleRecord, scheduled: float, job: _Job) -> Sample:
    if job.late:
        return record.failure(scheduled, f"no exit within {show_milliseconds(record.run.timeout)}")
    named = named_end(job.ended, record.run.samples.process)
    if job.ended.signal:
        return record.failure(scheduled, describe_death(named))
    if job.ended.process or (job.ended.code and not record.run.rates_success):
        return record.failure(scheduled, describe_early_end(named))
    return record.answered(scheduled, 1000 * (job.ended.at - scheduled), successful=job.ended.code == 0)
