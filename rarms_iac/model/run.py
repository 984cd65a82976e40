"""How a component is started, for how long it runs, and how its samples are read."""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

from rarms_iac.model.quantities import Milliseconds


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """A program of the component's own: no shell reads it."""

    words: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Call:
    """A Python function, driven by a small runner."""

    module: str
    function: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FromEnvironment:
    """A value read from rarms' own environment when the component starts, so that no secret stands in git."""

    name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleCount:
    """A setting ends after so many samples."""

    samples: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Elapsed:
    """A setting ends after so long."""

    time: Milliseconds


@dataclass(frozen=True, slots=True, kw_only=True)
class Closed:
    """The next job starts when the last one ended."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Periodic:
    """A job starts every period; its response counts from its scheduled start."""

    period: Milliseconds


@dataclass(frozen=True, slots=True, kw_only=True)
class Stop:
    """How a component is asked to end, and how long it may take."""

    signal: str = "TERM"
    grace: Milliseconds = Milliseconds(Fraction(5000))


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """Where in a sample a value stands, and its unit as a factor to ours (1 for counts)."""

    name: str
    factor: Fraction = Fraction(1)


OutputStream = Literal["stdout", "stderr"]
STREAM_NAMES: Mapping[OutputStream, str] = {"stdout": "standard output", "stderr": "standard error"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
    """How the component's output becomes samples: `json_lines`, `pattern` (RE2) or `per_run`."""

    source: str
    stream: OutputStream = "stdout"  # of a command that writes lines
    pattern: str = ""
    response_time: Field | None = None
    success: Field | None = None
    count: Field | None = None

    @property
    def other_stream(self) -> OutputStream:
        """The stream whose lines are not read."""
        return "stdout" if self.stream == "stderr" else "stderr"


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """How a component is started, fed, watched and ended."""

    start: Command | Call
    files: tuple[str, ...]
    environment: Mapping[str, str | FromEnvironment]
    folder: str  # as written; relative to the file that says it
    until: SampleCount | Elapsed | None  # where a setting begins to be judged; None: rarms chooses
    timeout: Milliseconds
    stop: Stop
    arrival: Closed | Periodic
    samples: Samples
    deadline: Milliseconds | None  # None: no deadline
    failures: int  # failed samples a setting may have
    success_within: Milliseconds | None = None  # on a simulated host, a job that answers later does not succeed
    rates_success: bool = True  # a threshold asks for the success rate; if not, a job's exit code is 0 or it has failed

    @property
    def has_lines(self) -> bool:
        """Whether it is a command whose lines are read."""
        return isinstance(self.start, Command) and self.samples.source != "per_run"

    @property
    def ends(self) -> SampleCount | Elapsed:
        """Where a setting ends that is not to become clear: `until`, or else after `USUAL_SAMPLES`."""
        return self.until or SampleCount(samples=USUAL_SAMPLES)


USUAL_SAMPLES = 200
"""Samples of a setting that is not to become clear, unless `run.until` says."""

SIMULATED_ONLY = Run(
    start=Command(words=()),
    files=(),
    environment={},
    folder=".",
    until=None,
    timeout=Milliseconds(Fraction(60_000)),
    stop=Stop(),
    arrival=Closed(),
    samples=Samples(source="per_run"),
    deadline=None,
    failures=0,
)
"""How a component without `run` is run: on a simulated host, with usual values."""
