"""Small builders of model values for tests: each gives a whole, valid value, and takes by name what a test is about.

Quantities are written as in the manifest: `a_host(memory="4 GiB")`, `a_component(reserve="70 %")`.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction

from rarms_iac.model.capacity import Capacity
from rarms_iac.model.claims import ANY_THREAD, CoreSharing
from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.model.host import (
    Connect,
    Host,
    HostSettings,
    HypervHost,
    KeepForHost,
    LinuxHost,
    ProviderKind,
    SimulatedHost,
)
from rarms_iac.model.journal import RunOrigin
from rarms_iac.model.loads import BUSY_LOOP, LOADS_WITHOUT_ENTRY, Browser, BusyLoop, Interference
from rarms_iac.model.quantities import (
    Bytes,
    CpuAmount,
    LogicalProcessors,
    Milliseconds,
    Percent,
    ProcessorTime,
    ShareOfHost,
    Unit,
    parse_quantity,
)
from rarms_iac.model.run import Closed, Elapsed, FromEnvironment, Periodic, Run, SampleCount, Samples
from rarms_iac.model.state import ID_DIGITS, Mark
from rarms_iac.model.system import (
    Application,
    AtLeast,
    AtMost,
    Component,
    CpuRequest,
    Guest,
    HypervPartition,
    Measured,
    PartitionRequest,
    Policy,
    RunsOn,
    Simulation,
    StartMode,
    StartRequest,
    System,
    TaskCategory,
    TaskRequest,
    ThreadsTask,
    Threshold,
)

ORIGIN = RunOrigin(by="ann@lab, process 7", at="2026-01-31 12:00:00 UTC")
"""Who starts runs in tests, and when."""


def cpu_amount(text: str) -> CpuAmount:
    """`70 %` or `1.4 LP` as an amount."""
    kind, value = parse_quantity(text, Unit.SHARE, Unit.PROCESSORS)
    return ShareOfHost(Percent(value)) if kind is Unit.SHARE else ProcessorTime(LogicalProcessors(value))


def milliseconds(text: str) -> Milliseconds:
    """`88 ms`, `2 s`."""
    return Milliseconds(parse_quantity(text, Unit.TIME)[1])


def memory(text: str) -> Bytes:
    """`512 MiB`."""
    return Bytes(int(parse_quantity(text, Unit.MEMORY)[1]))


def percent(text: str) -> Percent:
    """`5 %`."""
    return Percent(parse_quantity(text, Unit.SHARE)[1])


def at_most(value: float | str | Fraction) -> AtMost:
    """A threshold in the index's own unit (ms for response times), from above."""
    return AtMost(value=Fraction(value))


def at_least(value: float | str | Fraction) -> AtLeast:
    """A threshold in the index's own unit, from below."""
    return AtLeast(value=Fraction(value))


def a_cpu(
    *,
    reserve: str | None = "20 %",
    limit: str | None = None,
    weight: int | None = None,
    starting: tuple[str, str] | None = None,
) -> CpuRequest:
    """What is fixed of the CPU; `reserve="measured"` leaves it to the data log, `None` to the planner.

    `starting` is the reserve for the time of a start, and that time.
    """
    return CpuRequest(
        reserve=Measured.MEASURED if reserve == "measured" else None if reserve is None else cpu_amount(reserve),
        limit=None if limit is None else cpu_amount(limit),
        weight=weight,
        starting=None
        if starting is None
        else StartRequest(reserve=cpu_amount(starting[0]), time=milliseconds(starting[1])),
    )


def a_run(
    *,
    command: Iterable[str] = ("job",),
    environment: Mapping[str, str | FromEnvironment] | None = None,
    until: SampleCount | Elapsed | None = None,
    timeout: str = "1 min",
    every: str | None = None,
    samples: Samples | None = None,
    deadline: str | None = None,
    failures: int = 0,
) -> Run:
    """A command whose runs are its samples, job after job; `every` makes it periodic, with its period as deadline."""
    limit = every if deadline is None else deadline
    return Run(
        command=tuple(command),
        environment=environment or {},
        until=until,
        timeout=milliseconds(timeout),
        arrival=Closed() if every is None else Periodic(period=milliseconds(every)),
        samples=samples or Samples(),
        deadline=None if limit is None else milliseconds(limit),
        failures=failures,
    )


def a_component(
    name: str = "vision",
    *,
    criticality: int = 10,
    apt: Mapping[str, Threshold] | None = None,
    run: Run | None = None,
    memory: str = "512 MiB",
    processors: int | None = None,
    reserve: str | None = "20 %",
    limit: str | None = None,
    weight: int | None = None,
    together: Iterable[str] = (),
    apart: Iterable[str] = (),
    dedicated: bool = False,
    task: str | ThreadsTask | None = None,
    hosts: Iterable[str] | None = None,
    runs_on: RunsOn = RunsOn.PARTITION,
    interference: Iterable[str] = (),
    simulation: Simulation | None = None,
) -> Component:
    """A component with a fixed reserve of 20 %; one that runs on the host has no reserve unless it is given."""
    on_host = runs_on is RunsOn.HOST and reserve == "20 %"
    return Component(
        name=name,
        criticality=criticality,
        apt=apt or {},
        run=run,
        memory=_bytes(memory),
        processors=processors,
        cpu=a_cpu(reserve=None if on_host else reserve, limit=limit, weight=weight),
        together=tuple(together),
        apart=tuple(apart),
        dedicated=dedicated,
        task=task,
        hosts=None if hosts is None else tuple(hosts),
        runs_on=runs_on,
        interference=tuple(interference),
        simulation=simulation,
    )


def a_simulation(
    *, work: str = "10 ms", blocked: str = "0 ms", varies: str = "0 %", threads: int = 1, within: str | None = None
) -> Simulation:
    """A demand of 10 ms of processor time a job, in one thread."""
    return Simulation(
        work=milliseconds(work),
        blocked=milliseconds(blocked),
        varies=percent(varies),
        threads=threads,
        success_within=None if within is None else milliseconds(within),
    )


def a_host(
    name: str = "onboard",
    *,
    provider: ProviderKind = ProviderKind.SIMULATED,
    logical_processors: int = 2,
    memory: str = "4 GiB",
    keep_processor: str = "0 %",
    keep_memory: str = "0 B",
    platform: str | None = None,
    connect: Connect | None = None,
    settings: HostSettings | None = None,
    system_responsiveness: int | None = None,
) -> Host:
    """A simulated host with two processors and 4 GiB, nothing kept; the settings are its provider's own."""
    return Host(
        name=name,
        provider=provider,
        logical_processors=logical_processors,
        memory=_bytes(memory),
        keep_for_host=KeepForHost(processor=cpu_amount(keep_processor), memory=_bytes(keep_memory)),
        platform=platform or name,
        connect=connect,
        simulated=settings if isinstance(settings, SimulatedHost) else SimulatedHost(),
        hyperv=settings if isinstance(settings, HypervHost) else HypervHost(),
        linux=settings if isinstance(settings, LinuxHost) else LinuxHost(),
        system_responsiveness=system_responsiveness,
    )


def a_capacity(logical_processors: int, sharing: CoreSharing = ANY_THREAD) -> Capacity:
    """All of so many logical processors, and no memory to speak of."""
    whole = LogicalProcessors(Fraction(logical_processors))
    return Capacity(logical_processors=logical_processors, processors=whole, memory=Bytes(100), sharing=sharing)


def a_partition(
    name: str = "vision",
    *,
    components: Iterable[str] | None = None,
    processors: int | None = None,
    memory: str | None = None,
    cpu: CpuRequest | None = None,
    protect: bool = False,
    start: StartMode = StartMode.AUTOMATIC,
    hyperv: HypervPartition | None = None,
    guest: Guest | None = None,
) -> PartitionRequest:
    """A partition of the component of its own name, unless `components` says which."""
    return PartitionRequest(
        name=name,
        components=(name,) if components is None else tuple(components),
        processors=processors,
        memory=None if memory is None else _bytes(memory),
        cpu=cpu or CpuRequest(),
        protect=protect,
        start=start,
        hyperv=hyperv or HypervPartition(),
        guest=guest or Guest(),
    )


def a_task(
    name: str = "ObjectIdentification",
    *,
    category: TaskCategory | None = None,
    priority: int | None = None,
    background_priority: int | None = None,
    replace_shipped: bool = False,
) -> TaskRequest:
    """A task class of which nothing is fixed."""
    return TaskRequest(
        name=name,
        category=category,
        priority=priority,
        background_priority=background_priority,
        replace_shipped=replace_shipped,
    )


def a_system(
    *,
    application: str = "robot",
    hosts: Iterable[Host] | None = None,
    components: Iterable[Component] | None = None,
    partitions: Iterable[PartitionRequest] = (),
    interference: Mapping[str, Interference] | None = None,
    tasks: Iterable[TaskRequest] = (),
    policy: Policy | None = None,
    moved: Mapping[str, str] | None = None,
) -> System:
    """One host, one component, measured beside the busy loop: a system without a finding."""
    return System(
        schema="rarms/v1",
        application=Application(name=application),
        hosts={host.name: host for host in ((a_host(),) if hosts is None else hosts)},
        components={
            component.name: component for component in ((a_component(),) if components is None else components)
        },
        partitions={partition.name: partition for partition in partitions},
        interference=LOADS_WITHOUT_ENTRY if interference is None else interference,
        tasks={task.name: task for task in tasks},
        policy=policy or Policy(interference=(BUSY_LOOP,)),
        moved=moved or {},
    )


def the_delivery_robot() -> System:
    """The paper's four components on their two processors, with the reserves that the shipped example fixes."""
    return a_system(
        application="delivery-robot",
        hosts=[a_host(platform="two-core-atom", keep_memory="1 GiB")],
        components=[
            a_component("face-detection", criticality=40, reserve="40 %", task="ObjectIdentification"),
            a_component(
                "speech-recognition",
                criticality=30,
                reserve="30 %",
                task="SpeechRecognition",
                apart=["video-streaming"],
            ),
            a_component("path-planning", criticality=20, reserve="20 %", limit="60 %", memory="256 MiB"),
            a_component("video-streaming", criticality=10, reserve="10 %", memory="256 MiB"),
        ],
        interference={"busy-loop": BusyLoop(), "browsers": Browser(instances=5)},
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PathPlaces:
    """Places for systems that were not read from a file: each says its path, all on line 1."""

    file: str = "rarms.yaml"

    def value(self, *path: str | int) -> Place:
        """A place that carries the path and lies on line 1."""
        return Place(file=self.file, line=1, column=1, path=".".join(map(str, path)))

    def key(self, *path: str | int) -> Place:
        """As `value`: there is no text in which they could differ."""
        return self.value(*path)

    def text(self, *path: str | int) -> str:
        """There is no text."""
        return ""


def a_mark(machine: str, application: str, name: str, digest: str) -> Mark:
    """The mark that makes the machine of this id the application's partition."""
    return Mark(application=application, name=name, machine=machine[:ID_DIGITS].lower(), set=digest)


def codes(diagnostics: Iterable[Diagnostic]) -> list[str]:
    """The codes of the findings, in their order."""
    return [diagnostic.code for diagnostic in diagnostics]


_bytes = memory
