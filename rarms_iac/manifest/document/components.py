"""`components`: the components of interest (CoIs), and those that are merely there."""

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Discriminator, Field, Tag

from rarms_iac.manifest.document.fields import Block, KeysLike, Maybe, exactly_one, needed, one_or_several, optional
from rarms_iac.manifest.document.quantities import (
    PositiveAmount,
    PositiveMemory,
    PositiveTime,
    Reserve,
    Share,
    Thresholds,
    Time,
)
from rarms_iac.manifest.document.text_forms import VARIABLE_PATTERN, CallTarget, Filled, Name, TaskName, Variable
from rarms_iac.model.system import RunsOn


class UntilBlock(Block):
    """When a setting has been measured enough."""

    model_config = ConfigDict(json_schema_extra=dict(exactly_one("samples", "elapsed")))

    samples: Maybe[Annotated[int, Field(ge=1, le=10_000_000)]] = optional("After so many samples.")
    elapsed: Maybe[PositiveTime] = optional("After so long: `20 s`.")


class StopBlock(Block):
    """How a component is asked to end."""

    signal: Literal["TERM", "INT", "HUP", "QUIT", "USR1", "USR2", "KILL"] = optional("The signal it gets.", "TERM")
    grace: Time = optional("How long it may take before it is killed: `5 s`.", "5 s")


class EveryBlock(Block):
    """A periodic job: its response counts from its scheduled start."""

    every: PositiveTime = needed(
        "The period: `33 ms`. rarms starts the jobs of `per_run` and of `call` itself; a command that writes lines "
        "paces itself and finds the period in the variable RARMS_PERIOD_MS."
    )


def _arrival_kind(value: Any) -> str:
    return "periodic" if isinstance(value, dict | EveryBlock) else "closed"


Arrival = Annotated[
    Annotated[Literal["closed"], Tag("closed")] | Annotated[EveryBlock, Tag("periodic")], Discriminator(_arrival_kind)
]


class FromEnvironmentBlock(Block):
    """A value that rarms reads from its own environment, so that no secret is in git."""

    from_env: Variable = needed("The name of the variable in rarms' own environment.")


def _variable_kind(value: Any) -> str:
    return "from_env" if isinstance(value, dict | FromEnvironmentBlock) else "text"


VariableValue = Annotated[
    Annotated[str, Tag("text")] | Annotated[FromEnvironmentBlock, Tag("from_env")], Discriminator(_variable_kind)
]


class TimeFieldBlock(Block):
    """The field of a sample that has a time."""

    field: Filled = needed(
        "The key of the JSON object (`job.took`: in an object below), or the named group of the pattern."
    )
    unit: Literal["us", "ms", "s", "min", "h"] = needed("The unit of the numbers there.")


class FieldBlock(Block):
    """The field of a sample that has a value."""

    field: Filled = needed(
        "The key of the JSON object (`job.frames`: in an object below), or the named group of the pattern."
    )


def _keys_only_where_they_are_read() -> dict[str, Any]:
    matches = {"properties": {"from": {"const": "pattern"}}, "required": ["from"]}
    has_lines = {"properties": {"from": {"enum": ["json_lines", "pattern"]}}, "required": ["from"]}
    return {
        "if": matches,
        "then": {"required": ["pattern"]},
        "else": {"not": {"required": ["pattern"]}},
        "anyOf": [has_lines, {"not": {"required": ["stream"]}}],
    }


class SamplesBlock(Block):
    """How the component's output becomes samples."""

    model_config = ConfigDict(json_schema_extra=_keys_only_where_they_are_read())

    source: Literal["json_lines", "pattern", "per_run"] = optional(
        "`json_lines`: a JSON object a line; `pattern`: a line that matches; other lines are skipped and counted; "
        "`per_run`: wall time from start to exit, exit code 0 is success (another is a failed sample where the APT "
        "has no `success_rate`).",
        "per_run",
        alias="from",
    )
    pattern: Maybe[Filled] = optional("An RE2 pattern with named groups, for `from: pattern`.")
    stream: Literal["stdout", "stderr"] = optional(
        "The stream whose lines are read, for a `command` with `from: json_lines` or `from: pattern`.", "stdout"
    )
    response_time: Maybe[TimeFieldBlock] = optional(
        "The field with the job's response time; null there is a job without an answer."
    )
    success: Maybe[FieldBlock] = optional("The field with the success of the job (1 or 0, true or false).")
    count: Maybe[FieldBlock] = optional("The field with the amount of work (frames, bytes), which throughput counts.")


class RunBlock(Block):
    """How a component is started, fed, watched and ended."""

    model_config = ConfigDict(json_schema_extra=dict(exactly_one("command", "call")))

    command: Maybe[Annotated[list[str], Field(min_length=1)]] = optional(
        "The program and its arguments, word by word; no shell reads them. "
        "Words that name files are relative to the file that contains them."
    )
    call: Maybe[CallTarget] = optional("A Python function, `module:function`, that a small runner drives.")
    folder: Filled = optional("The folder it runs in, relative to the file that contains this key.", ".")
    files: Maybe[list[Filled]] = optional(
        "Globs of files that belong to the component: when one changes, its measurements are stale."
    )
    environment: Maybe[Annotated[dict[Variable, VariableValue], KeysLike(VARIABLE_PATTERN)]] = optional(
        "Environment variables beside rarms' own: a text, or `{from_env: NAME}`."
    )
    arrival: Maybe[Arrival] = optional(
        "`closed`: the next job starts when the last one ended; `{every: 33 ms}`: a job every period, counted from its "
        "scheduled start; an overrun does not shift the schedule. Absent: closed."
    )
    deadline: Maybe[PositiveTime] = optional("When a job's answer is late; absent: the period, if it is periodic.")
    until: Maybe[UntilBlock] = optional("When a setting has been measured enough; absent: after 200 samples.")
    timeout: PositiveTime = optional("A job that takes longer is a failed sample: `60 s`.", "60 s")
    failures: int = optional(
        "How many failed samples a setting may have before it ends without a verdict.", 0, ge=0, le=1_000_000
    )
    stop: Maybe[StopBlock] = optional("How it is asked to end; absent: TERM, and 5 s of grace.")
    samples: Maybe[SamplesBlock] = optional("How its output becomes samples; absent: one a run.")


Weight = Annotated[int, Field(ge=1, le=10_000)]


class CpuBlock(Block):
    """What is fixed of the CPU; the rest is left to the planner."""

    reserve: Maybe[Reserve] = optional(
        "What is guaranteed: `measured` (the least that meets the thresholds, from the data log), "
        "a share of the host `70 %`, or processors `1.4 LP`. "
        "Absent: measured for a component with thresholds (apt), else nothing."
    )
    limit: Maybe[PositiveAmount] = optional(
        "The most that it may use: `60 %` or `1.2 LP`. Absent: the planner chooses."
    )
    weight: Maybe[Weight] = optional("Its relative share of what is not reserved: 1 to 10000, usually 100.")


class SimulationBlock(Block):
    """What a job demands on a simulated host."""

    work: PositiveTime = needed("Processor time of a job: `61.6 ms`.")
    blocked: Time = optional("Time a job waits without the processor: `26.4 ms`.", "0 ms")
    varies: Share = optional("How much the work varies: its standard deviation over its mean, `5 %`.", "0 %")
    threads: int = optional("How many threads share the work.", 1, ge=1, le=4096)
    success_within: Maybe[PositiveTime] = optional("A job succeeds if it answers within this time; absent: always.")


class ComponentBlock(Block):
    """A component."""

    criticality: int = needed("How bad it is when it misses its thresholds; larger is worse.", ge=0, le=1_000_000)
    apt: Maybe[Thresholds] = optional(
        "Acceptable performance thresholds: what is good enough, by performance index. Absent: it has none."
    )
    run: Maybe[RunBlock] = optional("How it is started and measured; absent: rarms does not run it.")
    interference: Maybe[one_or_several(Name)] = optional(  # type: ignore[valid-type]  # a type that a function makes
        "The load, or loads, that its reservation must stand up to; absent: the policy's."
    )
    memory: PositiveMemory = optional("The memory it needs: `512 MiB`.", "512 MiB")
    processors: Maybe[Annotated[int, Field(ge=1, le=2048)]] = optional(
        "Virtual processors of its partition; absent: as many as it was seen to use at once, else the host's."
    )
    task: Maybe[TaskName] = optional("Its robotic task class (RC SS): what kind of work it does, never a priority.")
    cpu: Maybe[CpuBlock] = optional("What is fixed of its CPU: reserve, limit, weight.")
    together: Maybe[list[Name]] = optional("Components that must share its partition.")
    apart: Maybe[list[Name]] = optional("Components that must never share its partition.")
    dedicated: bool = optional("Whether it is alone in its partition.", False)
    hosts: Maybe[Annotated[list[Name], Field(min_length=1)]] = optional(
        "Hosts it may run on; absent: any whose platform has its measurements, or all where its reserve is fixed."
    )
    runs_on: Annotated[RunsOn, Field(strict=False)] = optional(
        "`partition`, or `host`: in the host's own operating system, with a task class but without a reserve.",
        "partition",
    )
    simulation: Maybe[SimulationBlock] = optional("What a job demands on a simulated host.")
    new: bool = optional("In an overlay: the manifest has no component of this name.", False)
