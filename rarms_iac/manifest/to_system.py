"""ManifestDocument -> System: defaults filled in, nothing judged (that is what the checks are for)."""

from collections.abc import Callable, Mapping
from typing import TypeVar, assert_never

from rarms_iac.manifest.document.components import (
    ComponentBlock,
    CpuBlock,
    EveryBlock,
    FieldBlock,
    FromEnvironmentBlock,
    RunBlock,
    SamplesBlock,
    SimulationBlock,
    StopBlock,
    TimeFieldBlock,
    UntilBlock,
)
from rarms_iac.manifest.document.hosts import (
    ConnectBlock,
    FaultBlock,
    HostBlock,
    HypervHostBlock,
    KeepForHostBlock,
    LinuxBlock,
    SimulatedBlock,
)
from rarms_iac.manifest.document.manifest import (
    AcceptanceBlock,
    BrowserBlock,
    BusyLoopBlock,
    CommandLoadBlock,
    GuestBlock,
    HypervPartitionBlock,
    ManifestDocument,
    PartitionBlock,
    PartitionStopBlock,
    PolicyBlock,
    TaskBlock,
)
from rarms_iac.model.quantities import UNITS, Unit
from rarms_iac.model.system import (
    Acceptance,
    Application,
    Browser,
    BusyLoop,
    Call,
    Closed,
    Command,
    CommandLoad,
    Component,
    Connect,
    CpuRequest,
    Elapsed,
    Fault,
    Field,
    FromEnvironment,
    Guest,
    Host,
    HostSettings,
    HypervHost,
    HypervPartition,
    Interference,
    KeepForHost,
    LinuxHost,
    Measured,
    PartitionRequest,
    Periodic,
    Policy,
    ProviderKind,
    Run,
    RunsOn,
    SampleCount,
    Samples,
    SimulatedHost,
    Simulation,
    Stop,
    System,
    TaskRequest,
)


def to_host(name: str, block: HostBlock) -> Host:
    """A host with its defaults; its platform is its own name by default."""
    keep = block.keep_for_host or KeepForHostBlock()
    return Host(
        name=name,
        provider=block.provider,
        logical_processors=block.logical_processors,
        memory=block.memory,
        keep_for_host=KeepForHost(processor=keep.processor, memory=keep.memory),
        platform=block.platform or name,
        connect=to_connect(block.connect) if block.connect else None,
        settings=_settings(block),
        system_responsiveness=block.system_responsiveness,
    )


def to_connect(block: ConnectBlock) -> Connect:
    """How a remote system is reached."""
    return Connect(ssh=block.ssh, shell=block.shell)


def _settings(block: HostBlock) -> HostSettings:
    match block.provider:
        case ProviderKind.SIMULATED:
            return _simulated(block.simulated or SimulatedBlock())
        case ProviderKind.HYPERV:
            hyperv = block.hyperv or HypervHostBlock()
            return HypervHost(
                switch=hyperv.switch, image=hyperv.image, vm_path=hyperv.vm_path, generation=hyperv.generation
            )
        case ProviderKind.LINUX:
            linux = block.linux or LinuxBlock()
            return LinuxHost(slice=linux.slice, control_groups=linux.control_groups)
        case _:
            assert_never(block.provider)


def _simulated(block: SimulatedBlock) -> SimulatedHost:
    return SimulatedHost(
        windows_build=block.windows_build,
        guest_windows_build=block.guest_windows_build,
        client=block.client,
        scheduler=block.scheduler,
        smt=block.smt,
        administrator=block.administrator,
        faults={name: _fault(fault) for name, fault in (block.faults or {}).items()},
    )


def _fault(block: FaultBlock) -> Fault:
    return Fault(operation=block.operation, at=block.at, effect=block.effect, delay=block.delay, times=block.times)


_CLOSED = Closed()
_PER_RUN = Samples(source="per_run")
_STOP = Stop()
_UNTIL = SampleCount(samples=200)


def to_run(block: RunBlock) -> Run:
    """How a component is run; the deadline of a periodic job is its period by default."""
    arrival = _arrival(block.arrival)
    deadline = block.deadline
    if deadline is None and isinstance(arrival, Periodic):
        deadline = arrival.period
    return Run(
        start=_start(block),
        files=tuple(block.files or ()),
        environment={name: _variable(value) for name, value in (block.environment or {}).items()},
        folder=block.folder,
        until=_until(block.until) if block.until else _UNTIL,
        timeout=block.timeout,
        stop=_stop(block.stop) if block.stop else _STOP,
        arrival=arrival,
        samples=_samples(block.samples) if block.samples else _PER_RUN,
        deadline=deadline,
        failures=block.failures,
    )


def _start(block: RunBlock) -> Command | Call:
    if block.call is None:
        return Command(words=tuple(block.command or ()))
    module, _, function = block.call.partition(":")
    return Call(module=module, function=function)


def _variable(value: str | FromEnvironmentBlock) -> str | FromEnvironment:
    return value if isinstance(value, str) else FromEnvironment(name=value.from_env)


def _until(block: UntilBlock) -> SampleCount | Elapsed:
    if block.elapsed is not None:
        return Elapsed(time=block.elapsed)
    return _UNTIL if block.samples is None else SampleCount(samples=block.samples)


def _stop(block: StopBlock) -> Stop:
    return Stop(signal=block.signal, grace=block.grace)


def _arrival(value: str | EveryBlock | None) -> Closed | Periodic:
    return Periodic(period=value.every) if isinstance(value, EveryBlock) else _CLOSED


def _samples(block: SamplesBlock) -> Samples:
    return Samples(
        source=block.source,
        pattern=block.pattern or "",
        response_time=_time_field(block.response_time),
        success=_field(block.success),
        count=_field(block.count),
    )


def _time_field(block: TimeFieldBlock | None) -> Field | None:
    return None if block is None else Field(name=block.field, factor=UNITS[Unit.TIME][block.unit])


def _field(block: FieldBlock | None) -> Field | None:
    return None if block is None else Field(name=block.field)


B = TypeVar("B")
V = TypeVar("V")

_NOTHING_FIXED = CpuRequest()
_BUILT_IN: Mapping[str, Interference] = {"busy-loop": BusyLoop()}


def to_system(document: ManifestDocument) -> System:
    """Turn a document into a `System` with every default filled in; names are not resolved yet."""
    return System(
        application=Application(name=document.application.name, description=document.application.description),
        hosts=_named(document.hosts, to_host),
        components=_named(document.components, _component),
        partitions=_named(document.partitions, _partition),
        interference={**_BUILT_IN, **_named(document.interference, _interference)},
        tasks=_named(document.tasks, _task),
        policy=_policy(document.policy or PolicyBlock()),
        moved=document.moved or {},
    )


def _named(blocks: Mapping[str, B] | None, make: Callable[[str, B], V]) -> dict[str, V]:
    return {name: make(name, block) for name, block in (blocks or {}).items()}


def _component(name: str, block: ComponentBlock) -> Component:
    return Component(
        name=name,
        criticality=block.criticality,
        apt=block.apt or {},
        run=to_run(block.run) if block.run else None,
        memory=block.memory,
        processors=block.processors,
        cpu=_component_cpu(block),
        together=tuple(block.together or ()),
        apart=tuple(block.apart or ()),
        dedicated=block.dedicated,
        task=block.task,
        hosts=None if block.hosts is None else tuple(block.hosts),
        runs_on=block.runs_on,
        interference=block.interference,
        simulation=_simulation(block.simulation) if block.simulation else None,
    )


def _component_cpu(block: ComponentBlock) -> CpuRequest:
    """A component with thresholds is measured unless its reserve is fixed; on the host nothing is reserved."""
    cpu = _cpu(block.cpu)
    if cpu.reserve is None and block.apt and block.runs_on is RunsOn.PARTITION:
        return CpuRequest(reserve=Measured.MEASURED, limit=cpu.limit, weight=cpu.weight)
    return cpu


def _cpu(block: CpuBlock | None) -> CpuRequest:
    return (
        _NOTHING_FIXED if block is None else CpuRequest(reserve=block.reserve, limit=block.limit, weight=block.weight)
    )


def _simulation(block: SimulationBlock) -> Simulation:
    return Simulation(
        work=block.work,
        blocked=block.blocked,
        varies=block.varies,
        threads=block.threads,
        success_within=block.success_within,
    )


def _partition(name: str, block: PartitionBlock) -> PartitionRequest:
    return PartitionRequest(
        name=name,
        components=(name,) if block.components is None else tuple(block.components),
        processors=block.processors,
        memory=block.memory,
        cpu=_cpu(block.cpu),
        protect=block.protect,
        start=block.start,
        grace=(block.stop or PartitionStopBlock()).grace,
        hyperv=_hyperv(block.hyperv or HypervPartitionBlock()),
        guest=_guest(block.guest or GuestBlock()),
    )


def _hyperv(block: HypervPartitionBlock) -> HypervPartition:
    return HypervPartition(generation=block.generation, switch=block.switch, image=block.image, vm_path=block.vm_path)


def _guest(block: GuestBlock) -> Guest:
    return Guest(connect=to_connect(block.connect) if block.connect else None, credential=block.credential)


def _interference(_name: str, block: BusyLoopBlock | BrowserBlock | CommandLoadBlock) -> Interference:
    match block:
        case BusyLoopBlock():
            return BusyLoop(threads=block.threads)
        case BrowserBlock():
            return Browser(instances=block.instances)
        case CommandLoadBlock():
            return CommandLoad(command=tuple(block.command), instances=block.instances)
        case _:
            assert_never(block)


def _task(name: str, block: TaskBlock) -> TaskRequest:
    return TaskRequest(
        name=name,
        category=block.category,
        priority=block.priority,
        background_priority=block.background_priority,
        replace_shipped=block.replace_shipped,
    )


def _policy(block: PolicyBlock) -> Policy:
    return Policy(
        interference=block.interference,
        minimise=block.minimise,
        headroom=block.headroom,
        max_disruption=block.max_disruption,
        accept=_named(block.accept, _acceptance),
    )


def _acceptance(code: str, block: AcceptanceBlock) -> Acceptance:
    return Acceptance(code=code, at=tuple(block.at), reason=block.reason, until=block.until)
