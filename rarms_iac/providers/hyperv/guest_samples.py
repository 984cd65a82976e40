"""What a measuring script says, as samples: lines of guests on their own clocks, and what the hypervisor counted."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Literal

from rarms_iac.model.run import Run
from rarms_iac.model.series import Sample, SkippedLines
from rarms_iac.model.setting import SettingEvidence
from rarms_iac.model.system import run_of
from rarms_iac.providers.measuring import RemainingSamples, Work
from rarms_iac.running.reading import JobAnswer, Unreadable, answer_reader, describe_no_sample, skip_line
from rarms_iac.storage.codec import NotDecodable, decode
from rarms_iac.storage.json_text import parse_json
from rarms_iac.texts.quantities import show_milliseconds

TICKS_MS = 10_000.0
"""Of 100 ns, in which runners and the hypervisor count, to a millisecond."""

RUN_TIMES = ("% Total Run Time", "% Guest Run Time", "% Hypervisor Run Time")
"""The counters of a set, in the order in which the script writes them; a machine's waits and dispatches follow."""

_SEEN = re.compile(
    "begun|(loaded|started) [0-9]+|late [0-9]+ [0-9]+|ended [0-9]+ [0-9]+ -?[0-9]+|line [0-9]+ .*"
    "|counted [0-9]+( -?[0-9]+){3}(( -?[0-9]+){2})?",
    re.DOTALL,
)
"""What a script says that it saw; a guest may print more."""


@dataclass(slots=True, kw_only=True)
class GuestRun:
    """A `RunningWork` inside guests; times are milliseconds of the host's clock since the setting began."""

    next_line: Callable[[], str]  # of the script; raises a `HostError` where it does not go on
    setting: str
    work: Work
    _now: float = 0.0
    _remaining: RemainingSamples = field(init=False)
    _readers: dict[str, "_GuestReader"] = field(init=False)  # by component
    _counters: list["_Counters"] = field(default_factory=list)  # the first one, and those since `count_from_now`

    def __post_init__(self) -> None:
        self._readers = {
            component.name: _GuestReader(run_of(component))
            for part in self.work.partitions
            for component in part.components
        }

    def samples(self) -> Iterator[tuple[str, Sample]]:
        readers = self._readers
        self.count_from_now()
        while True:
            name, seen = self._next_seen()
            words = seen.split(" ")
            if words[0] == "counted":
                self._count(name, *map(int, words[1:]))
            elif name in readers and (sample := readers[name].sample(seen, self._now)) is not None:
                self._remaining.take(name)
                yield name, sample
                if self._remaining.are_over(self._now):
                    return

    def _next_seen(self) -> tuple[str, str]:
        """Return the next line about this setting: a component or machine, and what was seen of it."""
        while True:
            seen = read_seen(self.next_line())
            if seen is not None and seen.setting == self.setting:
                self._now = max(self._now, float(seen.at_ms))
                return seen.name, seen.seen

    def _count(self, counter_set: str, due: int, *ticks: int) -> None:
        if not self._counters or self._counters[-1].due != due:
            del self._counters[3:-1]  # the first two, and the newest
            self._counters.append(_Counters(due=due, at_ms=self._now))
        self._counters[-1].ticks[counter_set] = ticks

    def count_from_now(self) -> None:
        """Count from the newest counters on."""
        self._remaining = RemainingSamples(self.work, self._now)
        del self._counters[1:-1]

    def restart_load(self) -> bool:
        """Return False: a guest's runner starts the load once, and it goes on."""
        return False

    def elapsed_ms(self) -> float:
        return self._now

    def cpu_ms(self, component: str) -> float | None:
        """Return the time of the component's machine if it is alone there, drawn on from the last two counters."""
        alone = [
            _machine_set(part.partition)
            for part in self.work.partitions
            if [member.name for member in part.components] == [component] and part.load is None
        ]
        counted = [counters for counters in self._counters if alone and alone[0] in counters.ticks]
        if len(counted) < 2:
            return None
        first, before, last = (
            (counters.at_ms, counters.ticks[alone[0]][0] / TICKS_MS) for counters in (counted[0], *counted[-2:])
        )
        rate = (last[1] - before[1]) / max(1.0, last[0] - before[0])
        return last[1] - first[1] + rate * (self._now - last[0])

    def used_processors(self, partition: str) -> None:  # noqa: ARG002 - the protocol's
        """Return None: threads are not counted here yet."""
        return

    def evidence(self) -> SettingEvidence | None:
        """Return the hypervisor's counts of each machine (FACTS 8)."""
        if len(self._counters) < 2:
            return None
        before, last = self._counters[-2 if len(self._counters) == 2 else 1], self._counters[-1]
        machines = {_machine_set(part.partition): part.partition for part in self.work.partitions}
        gone = {
            name: [new - old for new, old in zip(ticks, before.ticks[name], strict=True)]
            for name, ticks in last.ticks.items()
            if name in before.ticks and (name in machines or "(" not in name)
        }
        counted = {machines[name]: ticks for name, ticks in gone.items() if name in machines}
        return SettingEvidence(
            skipped_lines={name: reader.skipped for name, reader in self._readers.items() if reader.skipped.count},
            elapsed_ms=last.at_ms - before.at_ms,
            cpu_ms={name: ticks[0] / TICKS_MS for name, ticks in counted.items()},
            dispatch_wait_ns={
                name: waited / dispatches for name, (*_, waited, dispatches) in counted.items() if dispatches
            },
            hypervisor_ms={
                f"{name}\\{counter}": ticks[at] / TICKS_MS
                for name, ticks in gone.items()
                for at, counter in enumerate(RUN_TIMES)
            },
        )


def _machine_set(partition: str) -> str:
    return f"Hyper-V Hypervisor Virtual Processor({partition})"


@dataclass(slots=True, kw_only=True)
class _Counters:
    """Counters of the hypervisor at a time, by set and machine: run times (100 ns), waits (ns), dispatches."""

    due: int  # ms of the host's clock: when it was to be read, the same for all sets
    at_ms: float
    ticks: dict[str, tuple[int, ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """A line of a measuring script about what it saw."""

    format: Literal["rarms-seen/1"]
    setting: str
    name: str
    seen: str
    at_ms: int


def read_seen(line: str) -> Seen | None:
    """Read a line of a measuring script; None where it is an event, or noise of the host or of a guest."""
    if not line.startswith("{"):
        return None
    try:
        seen = decode(Seen, parse_json(line))
    except NotDecodable:
        return None
    return seen if _SEEN.fullmatch(seen.seen) else None


class _GuestReader:
    """Makes samples of what the runner inside a guest says of one component."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._read = answer_reader(run)
        self._offset: float | None = None  # of the guest's clock, on the host's, in ms
        self._last = 0.0  # ms of the guest's clock: when the process began, or its last sample came
        self._samples = 0  # of this process
        self.skipped = SkippedLines()

    def sample(self, seen: str, now: float) -> Sample | None:
        """Return the sample that a line is, if any.

        Args:
            now: of the host's clock, in ms.
        """
        kind, _, rest = seen.partition(" ")
        first, _, text = rest.partition(" ")
        at = int(first) / TICKS_MS
        if self._offset is None:
            self._offset = now - at
        match kind:
            case "started":
                self._last, self._samples = at, 0
                return None
            case "line":
                answer = self._read(text)
                if answer is None:
                    self.skipped = skip_line(self.skipped, text)
                    return None
                return self._of_answer(answer, at)
            case "late":
                shown = show_milliseconds(self._run.timeout)
                if self._run.samples.source == "per_run":
                    return self._failed(at, f"no exit within {shown}")
                return self._failed(self._last, self._without_sample(f"no sample within {shown}"))
            case _:
                return self._of_end(at, *map(int, text.split(" ")))

    def _of_end(self, due: float, ended_ticks: int, code: int) -> Sample | None:
        is_per_run = self._run.samples.source == "per_run"
        if is_per_run and (code == 0 or self._run.rates_success):
            return self._answered(due, ended_ticks / TICKS_MS - due, successful=code == 0)
        if code == 0 and self._samples:
            return None
        message = f"it ended with exit code {code}"
        return self._failed(due, message) if is_per_run else self._failed(self._last, self._without_sample(message))

    def _without_sample(self, message: str) -> str:
        return message if self._samples else describe_no_sample(message, self._run.samples, self.skipped, 0)

    def _of_answer(self, answer: JobAnswer | Unreadable, at: float) -> Sample:
        began, self._last = self._last, at
        if isinstance(answer, Unreadable):
            return self._failed(began, answer.message)
        self._samples += 1
        reading = answer.reading
        return self._answered(
            at - (reading.response_ms or 0.0),
            reading.response_ms,
            successful=reading.successful,
            count=reading.count,
        )

    def _answered(self, began: float, response_ms: float | None, *, successful: bool, count: float = 1.0) -> Sample:
        return Sample(began_ms=self._on_host(began), response_ms=response_ms, successful=successful, count=count)

    def _failed(self, began: float, message: str) -> Sample:
        return Sample(began_ms=self._on_host(began), response_ms=None, successful=False, failure=message)

    def _on_host(self, at: float) -> float:
        return max(0.0, at + (self._offset or 0.0))
