"""ManifestDocument -> System: defaults filled in, nothing judged (that is what the checks are for)."""

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any, TypeVar, assert_never, cast

from rarms_iac.manifest.document.components import (
    ComponentBlock,
    CpuBlock,
    EveryBlock,
    FieldBlock,
    FromEnvironmentBlock,
    RunBlock,
    SamplesBlock,
    TimeFieldBlock,
    UntilBlock,
)
from rarms_iac.manifest.document.fields import Block
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
    StressBlock,
    TaskBlock,
)
from rarms_iac.model.host import (
    Connect,
    Fault,
    Host,
    HostSettings,
    HypervHost,
    KeepForHost,
    LinuxHost,
    ProviderKind,
    SimulatedHost,
)
from rarms_iac.model.quantities import UNITS, Unit
from rarms_iac.model.run import (
    Call,
    Closed,
    Command,
    Elapsed,
    Field,
    FromEnvironment,
    Periodic,
    Run,
    SampleCount,
    Samples,
    Stop,
)
from rarms_iac.model.system import (
    Acceptance,
    Application,
    Browser,
    BusyLoop,
    CommandLoad,
    Component,
    CpuRequest,
    Guest,
    HypervPartition,
    Interference,
    Measured,
    PartitionRequest,
    Policy,
    RunsOn,
    Simulation,
    Stress,
    System,
    TaskRequest,
)

B = TypeVar("B")
V = TypeVar("V")


def to_host(name: str, block: HostBlock) -> Host:
    """A host with its defaults; its platform is its own name by default."""
    keep = block.keep_for_host or KeepForHostBlock()
    return Host(
        name=name,
        provider=block.provider,
        logical_processors=block.logical_processors,
        memory=block.memory,
        keep_for_host=_from_block(KeepForHost, keep),
        platform=block.platform or name,
        connect=to_connect(block.connect) if block.connect else None,
        settings=_settings(block),
        system_responsiveness=block.system_responsiveness,
    )


def to_connect(block: ConnectBlock) -> Connect:
    """How a remote system is reached."""
    return _from_block(Connect, block)


def _from_block(cls: type[V], block: Block, **different: object) -> V:
    """The value of the model with the same fields as its block; `different` has those that are not taken as they are.

    Raises:
        AttributeError: the block lacks a field, which tests show.
    """
    taken = {
        field.name: getattr(block, field.name) for field in fields(cast("Any", cls)) if field.name not in different
    }
    return cls(**taken, **different)


def _settings(block: HostBlock) -> HostSettings:
    match block.provider:
        case ProviderKind.SIMULATED:
            simulated = block.simulated or SimulatedBlock()
            return _from_block(SimulatedHost, simulated, faults=_named(simulated.faults, _fault))
        case ProviderKind.HYPERV:
            return _from_block(HypervHost, block.hyperv or HypervHostBlock())
        case ProviderKind.LINUX:
            return _from_block(LinuxHost, block.linux or LinuxBlock())
        case _:
            assert_never(block.provider)


def _fault(_name: str, block: FaultBlock) -> Fault:
    return _from_block(Fault, block)


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
        stop=_from_block(Stop, block.stop) if block.stop else _STOP,
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


_NOTHING_FIXED = CpuRequest()
_BUILT_IN: Mapping[str, Interference] = {"busy-loop": BusyLoop()}


def to_system(document: ManifestDocument) -> System:
    """Turn a document into a `System` with every default filled in; names are not resolved yet."""
    return System(
        application=_from_block(Application, document.application),
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
    return _from_block(
        Component,
        block,
        name=name,
        apt=block.apt or {},
        run=to_run(block.run) if block.run else None,
        cpu=_component_cpu(block),
        together=tuple(block.together or ()),
        apart=tuple(block.apart or ()),
        hosts=None if block.hosts is None else tuple(block.hosts),
        simulation=_from_block(Simulation, block.simulation) if block.simulation else None,
    )


def _component_cpu(block: ComponentBlock) -> CpuRequest:
    """A component with thresholds is measured unless its reserve is fixed; on the host nothing is reserved."""
    cpu = _cpu(block.cpu)
    if cpu.reserve is None and block.apt and block.runs_on is RunsOn.PARTITION:
        return CpuRequest(reserve=Measured.MEASURED, limit=cpu.limit, weight=cpu.weight)
    return cpu


def _cpu(block: CpuBlock | None) -> CpuRequest:
    return _NOTHING_FIXED if block is None else _from_block(CpuRequest, block)


def _partition(name: str, block: PartitionBlock) -> PartitionRequest:
    guest = block.guest or GuestBlock()
    return PartitionRequest(
        name=name,
        components=(name,) if block.components is None else tuple(block.components),
        processors=block.processors,
        memory=block.memory,
        cpu=_cpu(block.cpu),
        protect=block.protect,
        start=block.start,
        grace=(block.stop or PartitionStopBlock()).grace,
        hyperv=_from_block(HypervPartition, block.hyperv or HypervPartitionBlock()),
        mechanism=block.linux.mechanism if block.linux else None,
        guest=_from_block(Guest, guest, connect=to_connect(guest.connect) if guest.connect else None),
    )


def _interference(_name: str, block: BusyLoopBlock | BrowserBlock | CommandLoadBlock | StressBlock) -> Interference:
    match block:
        case BusyLoopBlock():
            return _from_block(BusyLoop, block)
        case BrowserBlock():
            return _from_block(Browser, block)
        case CommandLoadBlock():
            return _from_block(CommandLoad, block, command=tuple(block.command))
        case StressBlock():
            return _from_block(Stress, block)
        case _:
            assert_never(block)


def _task(name: str, block: TaskBlock) -> TaskRequest:
    return _from_block(TaskRequest, block, name=name)


def _policy(block: PolicyBlock) -> Policy:
    return _from_block(Policy, block, accept=_named(block.accept, _acceptance))


def _acceptance(code: str, block: AcceptanceBlock) -> Acceptance:
    return _from_block(Acceptance, block, code=code, at=tuple(block.at))
