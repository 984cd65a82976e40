"""How a component is started, for how long it runs, and how its samples are read."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Annotated, ClassVar, Literal

from rarms_iac.model.keys import Filled, Form, Key, PositiveTime, Time, Variable, Within
from rarms_iac.model.quantities import UNITS, Milliseconds, Unit


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
    """A value that rarms reads from its own environment, so that no secret is in git."""

    name: Annotated[Variable, Key("The name of the variable in rarms' own environment.", "from_env")]


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleCount:
    """A setting ends after so many samples."""

    samples: Annotated[int, Within(1, 10_000_000), Key("After so many samples.")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Elapsed:
    """A setting ends after so long."""

    time: Annotated[PositiveTime, Key("After so long: `20 s`.", "elapsed")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Closed:
    """The next job starts when the last one ended."""

    kind: ClassVar[str] = "closed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Periodic:
    """A periodic job: its response counts from its scheduled start."""

    period: Annotated[
        PositiveTime,
        Key(
            "The period: `33 ms`. rarms starts the jobs of `per_run` and of `call` itself; a command that writes lines "
            "paces itself and finds the period in the variable RARMS_PERIOD_MS.",
            "every",
        ),
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class Stop:
    """How a component is asked to end."""

    signal: Annotated[Literal["TERM", "INT", "HUP", "QUIT", "USR1", "USR2", "KILL"], Key("The signal it gets.")] = (
        "TERM"
    )
    grace: Annotated[Time, Key("How long it may take before it is killed: `5 s`.")] = Milliseconds(Fraction(5000))


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """The field of a sample that has a value."""

    field: Annotated[
        Filled[str],
        Key("The key of the JSON object (`job.took`: in an object below), or the named group of the pattern."),
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeField(Field):
    """The field of a sample that has a time."""

    unit: Annotated[Literal["us", "ms", "s", "min", "h"], Key("The unit of the numbers there.")]

    @property
    def in_ms(self) -> Fraction:
        """How many milliseconds one of its unit is."""
        return UNITS[Unit.TIME][self.unit]


OutputStream = Literal["stdout", "stderr"]
STREAM_NAMES: Mapping[OutputStream, str] = {"stdout": "standard output", "stderr": "standard error"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
    """How the component's output becomes samples."""

    source: Annotated[
        Literal["json_lines", "pattern", "per_run"],
        Key(
            "`json_lines`: a JSON object a line; `pattern`: a line that matches; other lines are skipped and counted; "
            "`per_run`: wall time from start to exit, exit code 0 is success (another is a failed sample where the APT "
            "has no `success_rate`).",
            "from",
        ),
    ] = "per_run"
    pattern: Annotated[Filled[str], Key("An RE2 pattern with named groups, for `from: pattern`.")] = ""
    stream: Annotated[
        OutputStream,
        Key("The stream whose lines are read, for a `command` with `from: json_lines` or `from: pattern`."),
    ] = "stdout"
    response_time: Annotated[
        TimeField | None, Key("The field with the job's response time; null there is a job without an answer.")
    ] = None
    success: Annotated[Field | None, Key("The field with the success of the job (1 or 0, true or false).")] = None
    count: Annotated[
        Field | None, Key("The field with the amount of work (frames, bytes), which throughput counts.")
    ] = None

    @property
    def other_stream(self) -> OutputStream:
        """The stream whose lines are not read."""
        return "stdout" if self.stream == "stderr" else "stderr"


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """How a component is started, fed, watched and ended."""

    command: Annotated[
        Filled[tuple[str, ...]],
        Key(
            "The program and its arguments, word by word; no shell reads them. "
            "Words that name files are relative to the file that contains them."
        ),
    ] = ()
    call: Annotated[str, Form.CALL, Key("A Python function, `module:function`, that a small runner drives.")] = ""
    folder: Annotated[Filled[str], Key("The folder it runs in, relative to the file that contains this key.")] = "."
    files: Annotated[
        tuple[Filled[str], ...],
        Key("Globs of files that belong to the component: when one changes, its measurements are stale."),
    ] = ()
    environment: Annotated[
        Mapping[Variable, str | FromEnvironment],
        Key("Environment variables besides those of rarms: a text, or `{from_env: NAME}`."),
    ] = field(default_factory=dict)
    arrival: Annotated[
        Closed | Periodic,
        Key(
            "`closed`: the next job starts when the last one ended; `{every: 33 ms}`: a job every period, counted from "
            "its scheduled start; an overrun does not shift the schedule. Absent: closed."
        ),
    ] = Closed()
    deadline: Annotated[
        PositiveTime | None, Key("When a job's answer is late; absent: the period, if it is periodic.")
    ] = None
    until: Annotated[
        SampleCount | Elapsed | None, Key("When a setting has been measured enough; absent: after 200 samples.")
    ] = None
    timeout: Annotated[PositiveTime, Key("A job that takes longer is a failed sample: `60 s`.")] = Milliseconds(
        Fraction(60_000)
    )
    failures: Annotated[
        int,
        Within(0, 1_000_000),
        Key("How many failed samples a setting may have before it ends without a verdict."),
    ] = 0
    stop: Annotated[Stop, Key("How it is asked to end; absent: TERM, and 5 s of grace.")] = Stop()
    samples: Annotated[Samples, Key("How its output becomes samples; absent: one a run.")] = Samples()
    success_within: Milliseconds | None = None  # on a simulated host, a job that answers later does not succeed
    rates_success: bool = True  # a threshold asks for the success rate; if not, a job's exit code is 0 or it has failed

    @property
    def start(self) -> Command | Call:
        """The program or the function that is started."""
        module, _, function = self.call.partition(":")
        return Call(module=module, function=function) if self.call else Command(words=self.command)

    @property
    def has_lines(self) -> bool:
        """Whether it is a command whose lines are read."""
        return not self.call and self.samples.source != "per_run"

    @property
    def ends(self) -> SampleCount | Elapsed:
        """Where a setting ends that is not to become clear: `until`, or else after `USUAL_SAMPLES`."""
        return self.until or SampleCount(samples=USUAL_SAMPLES)


USUAL_SAMPLES = 200
"""Samples of a setting that is not to become clear, unless `run.until` says."""

SIMULATED_ONLY = Run()
"""How a component without `run` is run: on a simulated host, with usual values."""
