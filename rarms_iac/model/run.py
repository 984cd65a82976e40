"""How a component is started, for how long it runs, and how its samples are read."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Annotated, ClassVar, Literal

from rarms_iac.model.keys import Filled, Form, Key, Name, OneOrSeveral, PositiveTime, Time, Variable, Within
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
class Container:
    """A container that docker or podman runs in the component's partition."""

    image: Annotated[Filled[str], Key("The image; a folder, with podman and the option `--rootfs`.")]
    engine: Annotated[Literal["docker", "podman"], Key("The engine, `docker` or `podman`.")]
    command: Annotated[
        tuple[str, ...], Key("The program in the image and its arguments; absent: the default program of the image.")
    ] = ()
    options: Annotated[
        tuple[Filled[str], ...],
        Key(
            "Options of the engine's `run` before the image, each word an item: `--device=/dev/video0`. "
            "rarms adds name, parent control group, user, variables, signal and grace."
        ),
    ] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ServiceProperties:
    """Properties of systemd that a transient service may have."""

    environment: Annotated[
        OneOrSeveral[Filled[str]], Key("Environment variables, each as `NAME=VALUE`.", "Environment")
    ] = ()
    working_directory: Annotated[
        str, Form.ABSOLUTE_FOLDER, Key("The working folder; absent: `run.folder`.", "WorkingDirectory")
    ] = ""
    supplementary_groups: Annotated[
        OneOrSeveral[Filled[str]], Key("Groups in addition to `run.groups`.", "SupplementaryGroups")
    ] = ()
    limit_memlock: Annotated[
        Filled[str], Key("The memory in bytes that the service may lock: `64M`, `infinity`.", "LimitMEMLOCK")
    ] = ""
    restart: Annotated[
        Literal["no", "on-success", "on-failure", "on-abnormal", "on-watchdog", "on-abort", "always"],
        Key("The condition for a restart by systemd.", "Restart"),
    ] = "no"
    nice: Annotated[int | None, Within(-20, 19), Key("The nice level.", "Nice")] = None
    scheduling_policy: Annotated[
        Literal["other", "batch", "idle", "fifo", "rr"], Key("The scheduling policy.", "CPUSchedulingPolicy")
    ] = "other"
    scheduling_priority: Annotated[
        int | None, Within(1, 99), Key("The priority, with `fifo` and `rr`.", "CPUSchedulingPriority")
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Service:
    """A transient service of systemd in the slice of the component's partition."""

    exec: Annotated[Filled[tuple[str, ...]], Key("The program and its arguments, each word an item.")]
    properties: Annotated[ServiceProperties, Key("The properties of the systemd unit.")] = ServiceProperties()


@dataclass(frozen=True, slots=True, kw_only=True)
class AttachedService:
    """A running service of systemd."""

    service: Annotated[Filled[str], Key("Its unit: `nav2` or `nav2.service`.")]


@dataclass(frozen=True, slots=True, kw_only=True)
class AttachedContainer:
    """A running container."""

    container: Annotated[Filled[str], Key("Its name.")]
    engine: Annotated[Literal["docker", "podman"] | None, Key("The engine; absent: the installed engine.")] = None


Attached = AttachedService | AttachedContainer


@dataclass(frozen=True, slots=True, kw_only=True)
class FromEnvironment:
    """A value that rarms reads from its own environment. The secret is then not in git."""

    name: Annotated[Variable, Key("The name of the variable in rarms' own environment.", "from_env")]


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleCount:
    """The end of a setting, by number of samples."""

    samples: Annotated[int, Within(1, 10_000_000), Key("The number of samples.")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Elapsed:
    """The end of a setting, by time."""

    time: Annotated[PositiveTime, Key("The duration: `20 s`.", "elapsed")]


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
            (
                "The period: `33 ms`. rarms starts the jobs of `per_run` and `call` itself. A command "
                "that writes lines keeps the period itself. The variable RARMS_PERIOD_MS has the "
                "period."
            ),
            "every",
        ),
    ]


Arrival = Closed | Periodic


@dataclass(frozen=True, slots=True, kw_only=True)
class Stop:
    """Signal and grace for the end of a component."""

    signal: Annotated[Literal["TERM", "INT", "HUP", "QUIT", "USR1", "USR2", "KILL"], Key("The first signal.")] = "TERM"
    grace: Annotated[Time, Key("The time from the signal until a kill: `5 s`.")] = Milliseconds(Fraction(5000))


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """The field of a sample that has a value."""

    field: Annotated[
        Filled[str],
        Key("The key of the JSON object (`job.took` for a nested one), or the named group of the pattern."),
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeField(Field):
    """The field of a sample that has a time."""

    unit: Annotated[Literal["us", "ms", "s", "min", "h"], Key("The unit of the numbers.")]

    @property
    def in_ms(self) -> Fraction:
        """How many milliseconds one of its unit is."""
        return UNITS[Unit.TIME][self.unit]


OutputStream = Literal["stdout", "stderr"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
    """Rules for samples from a component's output."""

    source: Annotated[
        Literal["json_lines", "pattern", "per_run", "ros"],
        Key(
            (
                "The source of samples. `json_lines`: each JSON object on a line. `pattern`: each line that "
                "matches; other lines are counted. `per_run`: the time from start to exit; exit code 0 is "
                "success, another code a failed sample if the APT has no `success_rate`. `ros`: the time from a "
                "message of `input` to the message of `output` with the same stamp."
            ),
            "from",
        ),
    ] = "per_run"
    pattern: Annotated[Filled[str], Key("An RE2 pattern with named groups, for `from: pattern`.")] = ""
    input: Annotated[
        str,
        Form.TOPIC,
        Key("The topic of the input messages, for `from: ros`: `/camera/image_raw`. Each message is a job."),
    ] = ""
    output: Annotated[
        str, Form.TOPIC, Key("The topic of the answers. Their messages have the stamps of the input messages.")
    ] = ""
    stream: Annotated[
        OutputStream,
        Key("The output stream of a `command` with `from: json_lines` or `from: pattern`."),
    ] = "stdout"
    file: Annotated[
        Filled[str],
        Key(
            "A file to which the component appends lines, relative to the manifest. rarms then does "
            "not read its output stream."
        ),
    ] = ""
    socket: Annotated[
        Filled[str],
        Key("A Unix socket that rarms creates for the component's lines, relative to the manifest."),
    ] = ""
    process: Annotated[Filled[str], Key("The process in `processes` that writes the samples.")] = ""
    response_time: Annotated[
        TimeField | None, Key("The field with the job's response time; null means a job without an answer.")
    ] = None
    success: Annotated[Field | None, Key("The field with the success of the job (1 or 0, true or false).")] = None
    count: Annotated[Field | None, Key("The field with the amount of work (frames, bytes) for the throughput.")] = None

    @property
    def other_stream(self) -> OutputStream:
        """The stream whose lines are not read."""
        return "stdout" if self.stream == "stderr" else "stderr"


FROM_FILE = "from_file"
"""The key of `environment` that names a file with variables; no variable has this name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Process:
    """A process of a component, with command, folder and user."""

    command: Annotated[
        Filled[tuple[str, ...]],
        Key(
            "The program and its arguments, each word an item, without a shell. Files are relative to the "
            "file that contains this key."
        ),
    ] = ()
    container: Annotated[Container | None, Key("A docker or podman container, in the partition's group.")] = None
    service: Annotated[Service | None, Key("A transient service of systemd, in the partition's slice.")] = None
    folder: Annotated[Filled[str], Key("Its working folder, relative to the file that contains this key.")] = "."
    environment: Annotated[
        Mapping[Variable, str | FromEnvironment],
        Key(
            "Environment variables in addition to those of rarms: a text, or `{from_env: NAME}`. "
            "`from_file` is a file with a `NAME=VALUE` on each line; variables here have priority."
        ),
    ] = field(default_factory=dict)
    user: Annotated[
        Filled[str],
        Key(
            "The user of the process, by name or number; in a container, a user of the image. Absent: "
            "the user of rarms."
        ),
    ] = ""
    groups: Annotated[tuple[Filled[str], ...], Key("Groups in addition to those of its user: `video`.")] = ()
    setup: Annotated[
        tuple[Filled[str], ...],
        Key("Setup files that `bash` sources before the start, as this user: `/opt/ros/humble/setup.bash`."),
    ] = ()

    @property
    def start(self) -> "Start":
        """What is started."""
        return self.container or self.service or Command(words=self.command)

    @property
    def environment_file(self) -> str:
        """The file with variables, relative to the manifest; empty: none."""
        named = self.environment.get(FROM_FILE, "")
        return named if isinstance(named, str) else ""

    @property
    def variables(self) -> Mapping[str, str | FromEnvironment]:
        """The variables that are written in the manifest."""
        return {name: value for name, value in self.environment.items() if name != FROM_FILE}


@dataclass(frozen=True, slots=True, kw_only=True)
class Processes:
    """Several processes that start, run and end as one."""

    by_name: Mapping[str, Process]  # in the order in which they start


Start = Command | Call | Container | Service | AttachedService | AttachedContainer | Processes


@dataclass(frozen=True, slots=True, kw_only=True)
class Run(Process):
    """Start, input, samples and end of a component."""

    call: Annotated[str, Form.CALL, Key("A Python function, `module:function`, that rarms calls for each job.")] = ""
    processes: Annotated[
        Mapping[Name, Process],
        Key(
            "Several processes of one component, by name. rarms starts them in this order and ends "
            "all of them together. `samples.process` names the process with the samples."
        ),
    ] = field(default_factory=dict)
    attach: Annotated[
        Attached | None,
        Key(
            "A running service or container. rarms measures it, but neither starts nor ends it. Its "
            "samples come from its log, `samples.file` or `samples.socket`."
        ),
    ] = None
    files: Annotated[
        tuple[Filled[str], ...],
        Key("Globs of the component's files. After a change of a file, the measurements of the component are stale."),
    ] = ()
    arrival: Annotated[
        Arrival,
        Key(
            "`closed`: the next job starts when the last one ends. `{every: 33 ms}`: one job every period, "
            "measured from its scheduled start; a late job does not shift the schedule. Absent: closed."
        ),
    ] = Closed()
    deadline: Annotated[
        PositiveTime | None, Key("The response time from which a job is late; absent: the period, if it has one.")
    ] = None
    until: Annotated[SampleCount | Elapsed | None, Key("The end of a setting; absent: after 200 samples.")] = None
    timeout: Annotated[PositiveTime, Key("The time-out of a job: `60 s`. A longer job is a failed sample.")] = (
        Milliseconds(Fraction(60_000))
    )
    failures: Annotated[
        int,
        Within(0, 1_000_000),
        Key("The permitted number of failed samples in a setting. With more, the setting ends without a verdict."),
    ] = 0
    stop: Annotated[Stop, Key("The signal and the grace for its end; absent: TERM, and 5 s of grace.")] = Stop()
    samples: Annotated[Samples, Key("The rules for the samples; absent: one sample for each run.")] = Samples()
    success_within: Milliseconds | None = None  # on a simulated host, a job that answers later does not succeed
    rates_success: bool = True  # a threshold asks for the success rate; if not, a job's exit code is 0 or it has failed

    @property
    def start(self) -> Start:
        """What is started."""
        if self.call:
            module, _, function = self.call.partition(":")
            return Call(module=module, function=function)
        if self.processes:
            return Processes(by_name=self.processes)
        if self.attach is not None:
            return self.attach
        return self.container or self.service or Command(words=self.command)

    @property
    def each_process(self) -> Mapping[str, Process]:
        """Its processes by name, in the order of their start; the name of an only one is empty.

        One of several has the user, groups, folder, setup files and variables of `run` where it names none.
        """
        return {name: self._completed(process) for name, process in self.processes.items()} or {"": self}

    @property
    def own_variables(self) -> Iterator[tuple[tuple[str, ...], str, str | FromEnvironment]]:
        """The variables that are written in it and in its processes, each with its path below `run`."""
        for path, process in ((), self), *((("processes", name), process) for name, process in self.processes.items()):
            for name, value in process.variables.items():
                yield (*path, "environment", name), name, value

    def _completed(self, process: Process) -> Process:
        return replace(
            process,
            folder=self.folder if process.folder == "." else process.folder,
            environment={**self.environment, **process.environment},
            user=process.user or self.user,
            groups=process.groups or self.groups,
            setup=() if process.container is not None else process.setup or self.setup,
        )

    @property
    def has_lines(self) -> bool:
        """Whether it is a command whose lines are read."""
        return not self.call and self.samples.source in {"json_lines", "pattern"}

    @property
    def ends(self) -> SampleCount | Elapsed:
        """Where a setting ends that is not to become clear: `until`, or else after `USUAL_SAMPLES`."""
        return self.until or SampleCount(samples=USUAL_SAMPLES)


USUAL_SAMPLES = 200
"""Samples of a setting that is not to become clear, unless `run.until` says."""

SIMULATED_ONLY = Run()
"""How a component without `run` is run: on a simulated host, with usual values."""
