"""Random systems and random hosts, with machines and task classes on them that no application owns."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

from hypothesis import strategies as st

from rarms_iac.model.host import Host
from rarms_iac.model.quantities import Percent, ShareOfHost
from rarms_iac.model.state import (
    Checkpoints,
    HostFacts,
    Partition,
    PartitionSettings,
    RegistryValue,
    Responsiveness,
    RunState,
    StartAction,
    State,
    StopAction,
    TaskClass,
    ValueKind,
)
from rarms_iac.model.system import Component, CpuRequest, PartitionRequest, RunsOn, StartMode, System
from tests import builders_plan as build
from tests.builders import a_component, a_host, a_partition, a_system

NAMES = ("arm", "base", "camera", "door", "ears", "feet")
FOREIGN_NAMES = ("backup", "domain-controller", "old-vision")
TASKS = ("MotionControl", "Localization", "SpeechRecognition")
MIB = 2**20


def facts_for(host: Host, **changed: object) -> HostFacts:
    """The facts of a machine that is as the manifest says: a server of today."""
    seen = build.facts(host.name, logical_processors=host.logical_processors)
    return replace(seen, **{"memory": int(host.memory), **changed})  # type: ignore[arg-type]  # fields, said by tests


@st.composite
def components(draw: st.DrawFn, name: str, most: int) -> Component:
    """A component that asks for at most so many per cent of its host, and 64 MiB to 512 MiB."""
    base = a_component(
        name,
        criticality=draw(st.integers(1, 5)),
        memory=f"{64 * draw(st.integers(1, 8))} MiB",
        processors=draw(st.none() | st.integers(1, 2)),
        task=draw(st.none() | st.sampled_from(TASKS)),
    )
    reserve = ShareOfHost(Percent(Fraction(draw(st.integers(0, most)))))
    weight = draw(st.none() | st.integers(1, 500))
    return replace(base, cpu=CpuRequest(reserve=reserve, weight=weight))


@st.composite
def systems(draw: st.DrawFn, host: Host | None = None) -> System:
    """A system of one host whose components fit it with some room for others."""
    host = host or a_host(logical_processors=draw(st.integers(2, 4)), memory="8 GiB")
    host = replace(host, system_responsiveness=draw(st.none() | st.sampled_from((10, 20, 90))))
    names = draw(st.lists(st.sampled_from(NAMES), unique=True, min_size=1, max_size=len(NAMES)))
    most = 70 // len(names)
    chosen = [draw(components(name, most)) for name in names]
    if draw(st.booleans()):
        chosen.append(a_component("watcher", runs_on=RunsOn.HOST, task=draw(st.sampled_from(TASKS)), criticality=9))
    return a_system(hosts=[host], components=chosen, partitions=draw(requests(tuple(names))))


@st.composite
def requests(draw: st.DrawFn, names: tuple[str, ...]) -> list[PartitionRequest]:
    """Some partitions by hand: one of the first two together, or one that is started by hand."""
    found = []
    if len(names) > 2 and draw(st.booleans()):
        found.append(a_partition(names[0], components=names[:2]))
    if draw(st.booleans()):
        found.append(a_partition(names[-1], start=StartMode.MANUAL) if not found or len(names) > 2 else found[0])
    return list({request.name: request for request in found}.values())


@dataclass(frozen=True, slots=True)
class Strangers:
    """What is on a host and not ours."""

    partitions: tuple[Partition, ...]
    tasks: tuple[TaskClass, ...]
    responsiveness: RegistryValue | None = None


@st.composite
def strangers(draw: st.DrawFn) -> Strangers:
    """Up to three machines that hold little, and task classes as they are shipped, or an OEM's."""
    machines = []
    for at, name in enumerate(draw(st.lists(st.sampled_from(FOREIGN_NAMES), unique=True, max_size=3))):
        running = draw(st.booleans())
        settings = replace(some_settings(name), reserve=draw(st.integers(0, 9)), memory=256 * MIB, running=running)
        state = RunState.RUNNING if running else RunState.OFF
        machines.append(Partition(settings=settings, id=f"ffff000{at}-foreign", state=state))
    tasks = [
        TaskClass(name=name, values={"Priority": number(draw(st.integers(1, 8)))})
        for name in draw(st.lists(st.sampled_from(["Games", "Audio", "OEM Thing"]), unique=True))
    ]
    return Strangers(tuple(machines), tuple(tasks), draw(st.none() | st.sampled_from((10, 20, 35)).map(number)))


def some_settings(name: str) -> PartitionSettings:
    """Settings of a machine that a person made by hand."""
    return replace(
        build.settings(name, processors=1, reserve=0, running=False),
        start_action=StartAction.NOTHING,
        stop_action=StopAction.SAVE,
        checkpoints=Checkpoints.PRODUCTION,
    )


def number(data: int) -> RegistryValue:
    return RegistryValue(kind=ValueKind.DWORD, data=data)


def empty_state(host: Host, others: Strangers | None = None) -> State:
    """A host that rarms has never seen."""
    others = others or Strangers((), ())
    return State(
        facts=facts_for(host),
        partitions=others.partitions,
        tasks=others.tasks,
        responsiveness=Responsiveness(value=others.responsiveness),
    )


def state_with(host: Host, *names: str, **facts: object) -> State:
    """A host on which partitions of these names run."""
    running = tuple(build.partition(build.settings(name)) for name in names)
    return State(facts=facts_for(host, **facts), partitions=running)


@st.composite
def edits(draw: st.DrawFn, settings: PartitionSettings) -> PartitionSettings:
    """The settings after a person changed one of them by hand, to something else."""
    changes: Mapping[str, st.SearchStrategy[object]] = {
        "reserve": st.integers(0, 9),
        "weight": st.integers(1, 500),
        "memory": st.integers(1, 8).map(lambda count: count * 64 * MIB),
        "processors": st.integers(1, 2),
        "stop_action": st.sampled_from(StopAction),
        "checkpoints": st.sampled_from(Checkpoints),
    }
    name = draw(st.sampled_from(sorted(changes)))
    value = draw(changes[name].filter(lambda candidate: candidate != getattr(settings, name)))
    return replace(settings, **{name: value})  # type: ignore[arg-type]  # name and value belong together
