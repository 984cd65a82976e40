"""ManifestDocument -> System: defaults filled in, nothing judged (that is what the checks are for)."""

from collections.abc import Callable, Mapping
from typing import TypeVar, assert_never

from rarms_iac.manifest.document.components import ComponentBlock, CpuBlock, SimulationBlock
from rarms_iac.manifest.document.interference import BrowserBlock, BusyLoopBlock, CommandLoadBlock
from rarms_iac.manifest.document.manifest import ManifestDocument
from rarms_iac.manifest.document.partitions import GuestBlock, HypervPartitionBlock, PartitionBlock, PartitionStopBlock
from rarms_iac.manifest.document.policy import AcceptanceBlock, PolicyBlock, TaskBlock
from rarms_iac.manifest.hosts_to_system import to_connect, to_host
from rarms_iac.manifest.run_to_system import to_run
from rarms_iac.model.system import (
    Acceptance,
    Application,
    Browser,
    BusyLoop,
    CommandLoad,
    Component,
    CpuWish,
    Guest,
    HypervPartition,
    Interference,
    Measured,
    PartitionWish,
    Policy,
    RunsOn,
    Simulation,
    System,
    TaskWish,
)

B = TypeVar("B")
V = TypeVar("V")

_NO_WISH = CpuWish()
_BUILT_IN: Mapping[str, Interference] = {"busy-loop": BusyLoop()}


def to_system(document: ManifestDocument) -> System:
    """What the document says, exact, every default said; names are not resolved yet."""
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


def _component_cpu(block: ComponentBlock) -> CpuWish:
    """A component with thresholds rests on measurements unless it says otherwise; one in the host reserves nothing."""
    wish = _cpu(block.cpu)
    if wish.reserve is None and block.apt and block.runs_on is RunsOn.PARTITION:
        return CpuWish(reserve=Measured.MEASURED, limit=wish.limit, weight=wish.weight)
    return wish


def _cpu(block: CpuBlock | None) -> CpuWish:
    return _NO_WISH if block is None else CpuWish(reserve=block.reserve, limit=block.limit, weight=block.weight)


def _simulation(block: SimulationBlock) -> Simulation:
    return Simulation(
        work=block.work,
        blocked=block.blocked,
        varies=block.varies,
        threads=block.threads,
        success_within=block.success_within,
    )


def _partition(name: str, block: PartitionBlock) -> PartitionWish:
    return PartitionWish(
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


def _task(name: str, block: TaskBlock) -> TaskWish:
    return TaskWish(
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
