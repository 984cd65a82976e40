"""What happens to a component: lines of its output, and the start and end of its processes.

`LineCutter` makes events of a stream, `describe_death` and its relatives put an end into words.
"""

import json
import signal as signals
from dataclasses import dataclass, replace
from typing import Any

LONGEST_LINE = 64 * 1024
FLOOD = 16 * 1024 * 1024
"""So many bytes without a line end are no line any more."""

_LAST_SIGNAL = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputLine:
    """A line of the stream whose lines are read."""

    at: float  # time.perf_counter
    text: str
    size: int


@dataclass(frozen=True, slots=True, kw_only=True)
class OverlongLine:
    """A line that is too long to be one; `flood`: it goes on and on."""

    at: float
    flood: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessStarted:
    """The process is about to begin."""

    at: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessEnded:
    """The process has ended, and all that it started with it."""

    at: float  # when it ended itself
    code: int
    signal: int  # 0: it was not killed by one; on Windows the code of a crash
    process: str = ""  # of several, the one that ended first; empty: the only one, or the one with the samples


Event = OutputLine | OverlongLine | ProcessStarted | ProcessEnded


class LineCutter:
    """Cuts a stream into lines of a bearable length, and finds the supervisor's words between them."""

    def __init__(self, mark: bytes = b"") -> None:
        """Take the mark of the supervisor's own lines; empty: there are none."""
        self._mark = mark
        self._rest = b""
        self._skipped = 0  # bytes of the line that is too long; 0: none is

    def cut(self, piece: bytes, at: float) -> list[Event | dict[str, Any]]:
        """Return the events of the lines that this piece completes."""
        events: list[Event | dict[str, Any]] = []
        *lines, rest = (self._rest + piece).split(b"\n")
        for line in lines:
            if self._skipped:
                self._skipped = 0  # its end
            elif self._mark and line.startswith(self._mark):
                events.append(json.loads(line[len(self._mark) :]))
            elif len(line) > LONGEST_LINE:
                events.append(OverlongLine(at=at))
            elif line.strip():
                events.append(OutputLine(at=at, text=line.decode("utf-8", "replace").rstrip("\r"), size=len(line)))
        if self._skipped:
            before, self._skipped = self._skipped, self._skipped + len(rest)
            if before < FLOOD <= self._skipped:
                events.append(OverlongLine(at=at, flood=True))
            rest = b""
        elif len(rest) > LONGEST_LINE:
            events.append(OverlongLine(at=at))
            self._skipped, rest = len(rest), b""
        self._rest = rest
        return events


def named_end(ended: ProcessEnded, sampled: str) -> ProcessEnded:
    """Return an end with the name of the process also where it is the one with the samples, which is `sampled`."""
    return replace(ended, process=ended.process or sampled)


def ended_by_itself(ended: ProcessEnded) -> bool:
    """Return whether the only process of a component ended by itself with exit code 0."""
    return ended.code == 0 and ended.signal == 0 and not ended.process


def describe_early_end(ended: ProcessEnded) -> str:
    """Describe the end of a process that was to go on."""
    if ended.signal:
        return describe_death(ended)
    if ended.process:
        return f"its process {ended.process} ended with exit code {ended.code}"
    return "it ended without a sample" if ended.code == 0 else f"it ended with exit code {ended.code}"


def describe_death(ended: ProcessEnded) -> str:
    """Describe which signal killed it, or how it crashed."""
    who = f"its process {ended.process}" if ended.process else "it"
    if ended.signal > _LAST_SIGNAL:
        return f"{who} crashed with 0x{ended.signal:08X}"
    try:
        return f"{who} was killed by {signals.Signals(ended.signal).name}"
    except ValueError:
        return f"{who} was killed by signal {ended.signal}"
