"""Pairs the messages of an input topic with those of an output topic that carry their stamps. Pure.

In: arrivals, in about the order in which they happened. Out: jobs, in the order of their inputs. A job without an
answer delays those after it, so that none of a setting's last jobs is left out because it is slow. Begin at
`MessagePairs`.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

EARLY_S = 1.0
"""How long an output waits for its input: a large input may come to the subscriber after the quick answer to it."""


@dataclass(slots=True, kw_only=True)
class MessageJob:
    """An input, and when its first output came; times are those of `time.perf_counter`."""

    began: float
    ended: float | None = None  # None: no output in time


@dataclass(slots=True, kw_only=True)
class MessagePairs:
    """The inputs whose jobs are not reported yet, by stamp.

    Nothing is a job before the first input that is answered: until then the component starts. A stamp may come again
    when its job is reported, as from a bag that is played in a loop.
    """

    timeout_s: float
    inputs: int = 0
    outputs: int = 0
    unmatched: int = 0  # outputs with the stamp of no input
    unstamped_inputs: int = 0  # with the stamp 0
    unstamped_outputs: int = 0
    has_begun: bool = False
    _open: dict[int, MessageJob] = field(default_factory=dict)  # the oldest first
    _early: dict[int, float] = field(default_factory=dict)
    _told: dict[int, float] = field(default_factory=dict)  # stamps of reported jobs, by the time of their inputs

    def take_input(self, stamp: int, at: float) -> None:
        """Take an input; an output that was quicker answers it at once."""
        self.inputs += 1
        self.unstamped_inputs += stamp == 0
        if stamp == 0 or stamp in self._open:
            return
        self._told.pop(stamp, None)
        self._open[stamp] = MessageJob(began=at)
        if self._early.pop(stamp, None) is not None:
            self._answer(stamp, at)

    def take_output(self, stamp: int, at: float) -> None:
        """Take an output; the first one answers its input."""
        self.outputs += 1
        self.unstamped_outputs += stamp == 0
        if stamp in self._open:
            self._answer(stamp, at)
        elif stamp != 0 and stamp not in self._told:
            self._early.setdefault(stamp, at)

    def jobs(self, now: float) -> Iterator[MessageJob]:
        """Yield the next jobs that are answered, or were not answered in time."""
        for stamp in [stamp for stamp, at in self._early.items() if at + EARLY_S < now]:
            del self._early[stamp]
            self.unmatched += 1
        for stamp in [stamp for stamp, at in self._told.items() if at + self.timeout_s + EARLY_S < now]:
            del self._told[stamp]
        for stamp, job in list(self._open.items()):
            if job.ended is None and job.began + self.timeout_s >= now:
                return
            del self._open[stamp]
            self._told[stamp] = job.began
            if self.has_begun:
                yield job

    def restart(self) -> None:
        """Forget all inputs: the component begins again."""
        self._open.clear()
        self._early.clear()
        self.has_begun = False

    def _answer(self, stamp: int, at: float) -> None:
        job = self._open[stamp]
        if job.ended is not None or at > job.began + self.timeout_s:
            return
        job.ended = at
        if not self.has_begun:
            self.has_begun = True
            for earlier in [earlier for earlier, each in self._open.items() if each.began < job.began]:
                del self._open[earlier]
