"""Cells that tests begin from: one fresh, and one whose change touches everything that a script can do."""

from dataclasses import dataclass, replace
from functools import cache

from rarms_iac.model.host import ProviderKind
from rarms_iac.model.plan import Plan, Purpose
from rarms_iac.model.system import (
    Component,
    Disruption,
    HypervPartition,
    PartitionRequest,
    RunsOn,
    System,
    TaskCategory,
    TaskRequest,
)
from tests.builders import a_component, a_host, a_partition, a_system
from tests.fake_powershell.cell import Cell, apply, files_of
from tests.fake_powershell.host import Entry, Vm, WindowsHost
from tests.fake_powershell.observing import CRYPTOGRAPHY, PROFILE, WINDOWS
from tests.fake_powershell.run import put

GIB = 2**30
MMCSS = "HKLM:\\SYSTEM\\CurrentControlSet\\Services\\MMCSS"
IMAGE = "D:\\images\\robot's.vhdx"


def a_windows(*strangers: Vm, **facts: object) -> WindowsHost:
    """A server with four logical processors, 8 GiB, a switch, an image, and the multimedia task Games."""
    host = WindowsHost(logical_processors=4, memory=8 * GIB, switches=["lab"])
    for name, data in (("InstallationType", "Server"), ("CurrentBuildNumber", "26100"), ("ProductName", "Server")):
        host.add_key(WINDOWS).values[name.lower()] = Entry(name=name, kind="String", data=data)
    host.add_key(CRYPTOGRAPHY)
    host.add_key(MMCSS).values["start"] = Entry(name="Start", kind="DWord", data=2)
    games = host.add_key(f"{PROFILE}\\Tasks\\Games").values
    for name, kind, shipped in (("Affinity", "DWord", 2**32 - 1), ("Scheduling Category", "String", "Medium")):
        games[name.lower()] = Entry(name=name, kind=kind, data=shipped)
    host.processors = [{"name": "a processor", "cores": 4, "logical": 4}]
    host.write_file(IMAGE, b"an image")
    host.vms = {stranger.id: stranger for stranger in strangers}
    for name, value in facts.items():
        setattr(host, name, value)
    return host


def a_stranger(name: str = "backup", number: int = 1, **settings: object) -> Vm:
    """A running machine that is not managed."""
    vm = Vm(id=f"ffff{number:04d}-0000-4000-8000-000000000000", name=name, state="Running", notes="keep me")
    for key, value in settings.items():
        setattr(vm, key, value)
    return vm


def a_cell_system(
    *components: Component,
    partitions: tuple[PartitionRequest, ...] = (),
    tasks: tuple[TaskRequest, ...] = (),
    responsiveness: int | None = None,
) -> System:
    """The same application on the same host, each time."""
    host = a_host("onboard", provider=ProviderKind.HYPERV, logical_processors=4, memory="8 GiB")
    host = replace(host, system_responsiveness=responsiveness)
    return a_system(hosts=[host], components=components, partitions=partitions, tasks=tasks)


def earlier() -> System:
    """Three partitions, as they were before everything changes."""
    return a_cell_system(
        a_component("vision", criticality=9, reserve="40 %", processors=2),
        a_component("speech", criticality=5, reserve="10 %", processors=1, memory="1 GiB"),
        a_component("former", criticality=1, reserve="5 %"),
        a_component("watcher", runs_on=RunsOn.HOST, task="Localization", criticality=3),
        responsiveness=10,
    )


def later() -> System:
    """One partition shrinks live, one stops and grows, one is no longer wanted, two are new; task classes change."""
    made = HypervPartition(image=IMAGE, vm_path="D:\\vms")
    return a_cell_system(
        a_component("vision", criticality=9, reserve="20 %", processors=2, weight=200),
        a_component("speech", criticality=5, reserve="20 %", processors=2, memory="512 MiB"),
        a_component("planning", criticality=4, reserve="10 %", processors=1),
        a_component("video", criticality=2, reserve="5 %", processors=1),
        a_component("watcher", runs_on=RunsOn.HOST, task="Localization", criticality=3),
        a_component("player", runs_on=RunsOn.HOST, task="Games", criticality=8),
        partitions=(
            a_partition("planning", hyperv=made),
            a_partition("video", hyperv=HypervPartition(switch="lab", generation=1)),
        ),
        tasks=(
            TaskRequest(name="Games", replace_shipped=True),
            TaskRequest(name="Localization", category=TaskCategory.MEDIUM, priority=2),
        ),
        responsiveness=30,
    )


@dataclass(frozen=True, slots=True)
class Prepared:
    """A cell with a plan for it."""

    cell: Cell
    plan: Plan

    def copy(self, **faults: object) -> WindowsHost:
        """The host as it was when the plan was made, with faults."""
        return self.cell.host.copy(**faults)

    def furnished(self, **faults: object) -> WindowsHost:
        """That host with the plan's scripts and their module on it."""
        host = self.copy(**faults)
        put(host, files_of(self.plan))
        return host

    def after_a_run(self, **faults: object) -> WindowsHost:
        """That host after the plan was applied, to its end or as far as the faults let it come."""
        host = self.copy(**faults)
        ran = apply(host, self.plan)
        assert faults or ran.code == 0, ran.says
        return host.copy()

    def effects(self) -> list[str]:
        """What a run that nothing disturbs changes, in its order."""
        host = self.copy()
        ran = apply(host, self.plan)
        assert ran.code == 0, ran.says
        return host.effects

    def effect(self, begins: str) -> int:
        """The number of the first effect of such a run that begins so."""
        return next(at for at, effect in enumerate(self.effects()) if effect.startswith(begins))


@cache
def fresh() -> Prepared:
    """Two partitions to be made on a host with a stranger: one with a disk and a path, one with a switch."""
    made = HypervPartition(image=IMAGE, vm_path="D:\\vms")
    system = a_cell_system(
        a_component("planning", reserve="10 %", processors=1),
        a_component("watcher", runs_on=RunsOn.HOST, task="Localization", criticality=3),
        partitions=(a_partition("planning", hyperv=made),),
        responsiveness=10,
    )
    cell = Cell(system, a_windows(a_stranger(), a_stranger("other", 2, state="Off", start_action="Nothing")))
    return Prepared(cell, cell.plan())


@cache
def alike() -> Prepared:
    """Machines alike, which a script makes, and starts, in rows of a table."""
    cell = Cell(_alike("5 %"), a_windows())
    return Prepared(cell, cell.plan())


@cache
def alike_changed() -> Prepared:
    """Those machines, whose reserves a script lowers, and its undo raises, in rows of a table."""
    host = a_windows()
    ran = apply(host, Cell(_alike("5 %"), host).plan())
    assert ran.code == 0, ran.says
    cell = Cell(_alike("4 %"), host.copy())
    return Prepared(cell, cell.plan())


def _alike(reserve: str) -> System:
    names = (f"part-{number}" for number in range(4))
    return a_cell_system(*(a_component(name, reserve=reserve, processors=1, memory="256 MiB") for name in names))


@cache
def removal() -> Prepared:
    """A partition with the disk that rarms made, and the plan that removes both."""
    made = fresh()
    cell = made.cell.on(made.after_a_run())
    return Prepared(cell, cell.plan(purpose=Purpose.DESTROY, remove_disks=True))


@cache
def everything() -> Prepared:
    """The cell between `earlier` and `later`."""
    host = a_windows(a_stranger())
    ran = apply(host, Cell(earlier(), host).plan())
    assert ran.code == 0, ran.says
    cell = Cell(later(), host.copy())
    return Prepared(cell, cell.plan(max_disruption=Disruption.REMOVAL))
