"""What has been seen of a component so far: when it began, its samples, and whether that is enough."""

import time
from enum import StrEnum

from rarms_iac.model.measurement import Sample
from rarms_iac.model.system import Elapsed, Periodic, Run, SampleCount


class Ending(StrEnum):
    """Why no more samples come."""

    RUNNING = "running"  # they still do
    UNTIL = "until"  # measured enough, as the manifest says
    FAILURES = "failures"  # more failed samples than it allows: no verdict
    CLOSED = "closed"  # whoever reads them has seen enough


class Record:
    """The samples of one run and its times, which are those of `time.perf_counter` in seconds."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.samples: list[Sample] = []
        self.failed = 0
        self.ending = Ending.RUNNING
        self._begun: float | None = None
        self._last: float | None = None

    def begin(self, at: float) -> float:
        """The setting begins, if it has not yet; answers with when it did."""
        if self._begun is None:
            self._begun = at
        return self._begun

    @property
    def has_begun(self) -> bool:
        """Whether the component has begun to do its jobs."""
        return self._begun is not None

    def take(self, sample: Sample, at: float) -> Sample:
        """Count a sample in that came at this time."""
        self.samples.append(sample)
        self.failed += bool(sample.failure)
        self._last = at
        if self.failed > self.run.failures:
            self.ending = Ending.FAILURES
        elif isinstance(self.run.until, SampleCount) and len(self.samples) >= self.run.until.samples:
            self.ending = Ending.UNTIL
        return sample

    def is_over(self, at: float) -> bool:
        """Whether the setting has lasted long enough at this time; it then ends."""
        over = self.over
        if over is None or at < over:
            return False
        self.ending, self._last = Ending.UNTIL, over
        return True

    @property
    def over(self) -> float | None:
        """When the setting ends; None where samples decide, or it has not begun."""
        match self.run.until:
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
        """A job's sample."""
        return Sample(began_ms=self._since(began), response_ms=response_ms, successful=successful, count=count)

    def failure(self, began: float, says: str) -> Sample:
        """A failed sample: unsuccessful, without response time, and why."""
        return Sample(began_ms=self._since(began), response_ms=None, successful=False, failure=says)

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


def earliest(*times: float | None) -> float | None:
    """The first of these times; None where there is none."""
    known = [time for time in times if time is not None]
    return min(known) if known else None
