"""ManifestDocument -> System: defaults filled in, nothing judged (that is what the checks are for)."""

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from functools import cache
from typing import Any, TypeVar

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
from rarms_iac.manifest.document.fields import Block
from rarms_iac.manifest.document.hosts import (
    ConnectBlock,
    FaultBlock,
    HostBlock,
    HypervHostBlock,
    KeepForHostBlock,
    LinuxBlock,
    SimulatedBlock,
    WinRmBlock,
)
from rarms_iac.manifest.document.manifest import (
    BrowserBlock,
    BurstsBlock,
    BusyLoopBlock,
    CommandLoadBlock,
    GuestBlock,
    HypervPartitionBlock,
    ManifestDocument,
    MeasuringLimitsBlock,
    PartitionBlock,
    PartitionStopBlock,
    PolicyBlock,
    StressBlock,
)
from rarms_iac.manifest.document.rules import BLOCK_OF
from rarms_iac.model.host import (
    Connect,
    Fault,
    Host,
    HypervHost,
    KeepForHost,
    LinuxHost,
    ProviderKind,
    SimulatedHost,
    WinRmConnect,
)
from rarms_iac.model.loads import DEFAULT_LOADS, LOADS_WITHOUT_ENTRY, Browser, Bursts, BusyLoop, CommandLoad, Stress
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
    Component,
    CpuRequest,
    Guest,
    HypervPartition,
    Measured,
    MeasuringLimits,
    PartitionRequest,
    Policy,
    RunsOn,
    Simulation,
    System,
    TaskRequest,
)

V = TypeVar("V")
Converter = Callable[[Any], Any]


def to_system(document: ManifestDocument, robot: str = "") -> System:
    """Turn a document into a `System` with every default filled in; names are not resolved yet.

    Args:
        document: the manifest with its overlays.
        robot: the name of `Application.robot`.
    """
    interference = {**LOADS_WITHOUT_ENTRY, **_converted(document.interference or {})}
    return _value(
        System,
        document,
        application=_value(Application, document.application, robot=robot),
        hosts=_named(document.hosts, _host),
        components=_named(document.components, _component),
        partitions=_named(document.partitions, _partition),
        interference=interference,
        tasks=_named(document.tasks, lambda name, block: _value(TaskRequest, block, name=name)),
        policy=_policy(document.policy or PolicyBlock()),
        moved=document.moved or {},
    )


def _value(cls: type[V], block: Block, **different: object) -> V:
    """The value of the model with the fields of its block; `different` has those that are not taken as they are.

    Raises:
        KeyError: the block lacks a field, which tests show.
    """
    values = block.__dict__
    for name in _field_names(cls):  # type: ignore[arg-type]  # a class is hashable
        if name not in different:
            value = values[name]
            convert = _CONVERTERS.get(type(value))
            different[name] = value if convert is None else convert(value)
    return cls(**different)


@cache
def _field_names(cls: Any) -> tuple[str, ...]:
    return tuple(field.name for field in fields(cls))


def _converted(value: Any) -> Any:
    convert = _CONVERTERS.get(type(value))
    return value if convert is None else convert(value)


def _to(cls: type) -> Converter:
    return lambda block: _value(cls, block)


def _named(blocks: Mapping[str, Any] | None, make: Callable[[str, Any], V]) -> dict[str, V]:
    return {name: make(name, block) for name, block in (blocks or {}).items()}


_SETTINGS = {
    ProviderKind.SIMULATED: SimulatedBlock,
    ProviderKind.HYPERV: HypervHostBlock,
    ProviderKind.LINUX: LinuxBlock,
}


def _host(name: str, block: HostBlock) -> Host:
    """A host with its defaults; its platform is its own name by default."""
    settings = getattr(block, BLOCK_OF[block.provider]) or _SETTINGS[block.provider]()
    return _value(
        Host,
        block,
        name=name,
        keep_for_host=_converted(block.keep_for_host or KeepForHostBlock()),
        platform=block.platform or name,
        settings=_converted(settings),
    )


_STOP = Stop()
_CLOSED = Closed()
_PER_RUN = Samples(source="per_run")
_NOTHING_FIXED = CpuRequest()


def _run(block: RunBlock) -> Run:
    """How a component is run; the deadline of a periodic job is its period by default."""
    arrival = _CLOSED if block.arrival in (None, "closed") else _converted(block.arrival)
    deadline = block.deadline
    if deadline is None and isinstance(arrival, Periodic):
        deadline = arrival.period
    return _value(
        Run,
        block,
        start=Command(words=tuple(block.command or ())) if block.call is None else _call(block.call),
        files=tuple(block.files or ()),
        environment=_converted(block.environment or {}),
        until=_converted(block.until),
        stop=_converted(block.stop) or _STOP,
        arrival=arrival,
        samples=_converted(block.samples) or _PER_RUN,
        deadline=deadline,
        success_within=None,  # `run_of` takes it from `simulation`,
        rates_success=True,  # and this from `apt`
    )


def _call(target: str) -> Call:
    module, _, function = target.partition(":")
    return Call(module=module, function=function)


def _until(block: UntilBlock) -> SampleCount | Elapsed:
    if block.elapsed is not None:
        return Elapsed(time=block.elapsed)
    return SampleCount(samples=block.samples or 0)


def _component(name: str, block: ComponentBlock) -> Component:
    """A component with thresholds is measured unless its reserve is fixed; on the host nothing is reserved."""
    cpu = _converted(block.cpu) or _NOTHING_FIXED
    if cpu.reserve is None and block.apt and block.runs_on is RunsOn.PARTITION:
        cpu = replace(cpu, reserve=Measured.MEASURED)
    return _value(
        Component,
        block,
        name=name,
        apt=block.apt or {},
        interference=_names(block.interference),
        cpu=cpu,
        together=tuple(block.together or ()),
        apart=tuple(block.apart or ()),
    )


def _partition(name: str, block: PartitionBlock) -> PartitionRequest:
    return _value(
        PartitionRequest,
        block,
        name=name,
        components=(name,) if block.components is None else tuple(block.components),
        cpu=_converted(block.cpu) or _NOTHING_FIXED,
        grace=(block.stop or PartitionStopBlock()).grace,
        hyperv=_converted(block.hyperv or HypervPartitionBlock()),
        mechanism=block.linux.mechanism if block.linux else None,
        guest=_converted(block.guest or GuestBlock()),
    )


def _names(one_or_several: str | list[str] | None) -> tuple[str, ...]:
    return (one_or_several,) if isinstance(one_or_several, str) else tuple(one_or_several or ())


def _policy(block: PolicyBlock) -> Policy:
    accept = _named(block.accept, lambda code, acceptance: _value(Acceptance, acceptance, code=code))
    measuring = _value(MeasuringLimits, block.measuring or MeasuringLimitsBlock())
    loads = _names(block.interference) or DEFAULT_LOADS
    return _value(Policy, block, interference=loads, measuring=measuring, accept=accept)


_CONVERTERS: Mapping[type, Converter] = {
    list: tuple,
    dict: lambda values: {name: _converted(value) for name, value in values.items()},
    BrowserBlock: _to(Browser),
    BurstsBlock: _to(Bursts),
    BusyLoopBlock: _to(BusyLoop),
    CommandLoadBlock: _to(CommandLoad),
    ConnectBlock: _to(Connect),
    CpuBlock: _to(CpuRequest),
    EveryBlock: lambda block: Periodic(period=block.every),
    FaultBlock: _to(Fault),
    FieldBlock: lambda block: Field(name=block.field),
    FromEnvironmentBlock: lambda block: FromEnvironment(name=block.from_env),
    GuestBlock: _to(Guest),
    HypervHostBlock: _to(HypervHost),
    HypervPartitionBlock: _to(HypervPartition),
    KeepForHostBlock: _to(KeepForHost),
    LinuxBlock: _to(LinuxHost),
    RunBlock: _run,
    SamplesBlock: lambda block: _value(Samples, block, pattern=block.pattern or ""),
    SimulatedBlock: lambda block: _value(SimulatedHost, block, faults=_converted(block.faults or {})),
    SimulationBlock: _to(Simulation),
    StopBlock: _to(Stop),
    StressBlock: _to(Stress),
    TimeFieldBlock: lambda block: Field(name=block.field, factor=UNITS[Unit.TIME][block.unit]),
    UntilBlock: _until,
    WinRmBlock: _to(WinRmConnect),
}
"""What becomes of a block's value by its type; one of another type stays as it is."""
