"""One process a job (`per_run`): the response is the wall time from start to exit, its exit code the success."""

import time
from collections.abc import Generator
from dataclasses import dataclass

from rarms_iac.model.measurement import Sample
from rarms_iac.model.quantities import show_milliseconds
from rarms_iac.running.deaths import death
from rarms_iac.running.kept import Ended, Kept, Started
from rarms_iac.running.record import Ending, Record, earliest


@dataclass(frozen=True, slots=True, kw_only=True)
class _Job:
    """A process that has ended."""

    began: float
    ended: Ended
    late: bool  # it was stopped, since it took longer than a job may


def samples_of_runs(kept: Kept, record: Record) -> Generator[Sample, None, None]:
    """Job after job; a periodic one counts from its scheduled start, and no overrun shifts the schedule."""
    kept.unheard()
    number = 0
    while record.ending is Ending.RUNNING:
        due = _due(record, number)
        job = _one_job(kept, record, due)
        if job is None or record.is_over(job.ended.at):
            return
        scheduled = job.began if due is None else due
        yield record.take(_sample(record, scheduled, job), job.ended.at)
        number += 1


def _due(record: Record, number: int) -> float | None:
    """When the job is to start; None: at once, and that is when it counts from."""
    if record.period is None or not record.has_begun:
        return None
    return record.begin(0.0) + number * record.period


def _one_job(kept: Kept, record: Record, due: float | None) -> _Job | None:
    """Start a job and wait for its end; None where the setting ends before."""
    now = time.perf_counter()
    kept.start(now if due is None else due)
    began, late = max(now, due or 0.0), False
    while True:
        event = kept.next(earliest(None if late else began + record.timeout, record.over))
        match event:
            case Started(at=at):
                began = at
                record.begin(at)
            case Ended():
                return _Job(began=began, ended=event, late=late)
            case None if record.is_over(time.perf_counter()):
                return None
            case None:
                late = True
                kept.stop()
            case _:
                pass  # its output is not heard


def _sample(record: Record, scheduled: float, job: _Job) -> Sample:
    if job.late:
        return record.failure(scheduled, f"no exit within {show_milliseconds(record.run.timeout)}")
    if job.ended.signal:
        return record.failure(scheduled, death(job.ended))
    return record.answered(scheduled, 1000 * (job.ended.at - scheduled), successful=job.ended.code == 0)
