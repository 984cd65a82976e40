"""What a step of `rarms apply` costs besides the host's own work: journal on, and the time of fsync told apart.

A step is what the executor does: read, record its begin, execute, read again, record its end. The time spent in fsync
is measured in the same run by a disk that keeps it, and taken off each step.
"""

import statistics
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from benchmarks.timing import Figure, report, seconds
from rarms_iac.model.changes import Address
from rarms_iac.model.claims import Claim
from rarms_iac.model.host import Host, KeepForHost, ProviderKind, SimulatedHost
from rarms_iac.model.journal import RunKind, RunStarted, StepRecorded, StepStatus
from rarms_iac.model.operations import CreatePartition, Operation, RenamePartition, SetCpu, WriteMark
from rarms_iac.model.plan import HostPlan, Scope, Step, Undo, UndoLevel
from rarms_iac.model.quantities import Bytes
from rarms_iac.model.state import State
from rarms_iac.model.system import Disruption
from rarms_iac.providers.marks import mark_for, write_mark
from rarms_iac.providers.simulated.run import SimulatedHostProvider
from rarms_iac.storage import disk

SCOPE = Scope(application="robot", plan="0123456789ab")
STEPS = 60
GOAL_MS = 2.0


class StopwatchDisk(disk.RealFileEffects):
    """The real disk, which adds up how long it waited for fsync."""

    def __init__(self) -> None:
        self.waited = 0.0

    def flush(self, path: Path) -> None:
        self.waited += seconds(lambda: super(StopwatchDisk, self).flush(path))

    def flush_folder(self, folder: Path) -> None:
        self.waited += seconds(lambda: super(StopwatchDisk, self).flush_folder(folder))


def a_host() -> Host:
    return Host(
        name="onboard",
        provider=ProviderKind.SIMULATED,
        logical_processors=2,
        memory=Bytes(4 << 30),
        keep_for_host=KeepForHost(),
        platform="onboard",
        connect=None,
        settings=SimulatedHost(),
    )


def filled(folder: Path, partitions: int) -> SimulatedHostProvider:
    """A host with so many partitions of ours."""
    quick = SimulatedHostProvider(a_host(), folder / ".rarms" / "hosts" / "onboard.json")
    for name in (f"part-{number}" for number in range(partitions)):
        makings: tuple[Operation, ...] = (
            CreatePartition(partition=name, generation=2, memory=1 << 20),
            WriteMark(partition=name, application="robot", name=name, set="0" * 12),
            RenamePartition(partition=name, name=name),
        )
        for making in makings:
            quick.execute(making, SCOPE)
    return SimulatedHostProvider(a_host(), folder / ".rarms" / "hosts" / "onboard.json")


def a_step(number: int, partitions: int) -> Step:
    name, reserve = f"part-{number % partitions}", 1 + number % 50
    return Step(
        address=Address(partition=name),
        title=f"reserve {reserve} %",
        operation=SetCpu(partition=name, reserve=reserve, limit=100, weight=100),
        before={},
        after={"reserve": reserve},
        undo=Undo(level=UndoLevel.FULL, operation=SetCpu(partition=name, reserve=0, limit=100, weight=100)),
        disruption=Disruption.LIVE,
        claim_before=Claim(),
        claim_after=Claim(processors=1, reserve=reserve, memory=1 << 20),
        comment="as the benchmark wants it",
    )


def a_run(state: State, steps: tuple[Step, ...]) -> RunStarted:
    host_plan = HostPlan(
        host=a_host(),
        facts=state.facts,
        state_path="",
        serial=0,
        digests={},
        changes=(),
        steps=steps,
        held_back=(),
        unused=(),
        unchanged=0,
        scripts={},
    )
    return RunStarted(
        run=RunKind.APPLY,
        plan=SCOPE.plan,
        application=SCOPE.application,
        started_by="benchmark",
        host_plan=host_plan,
        steps=steps,
        serials={"robot": 1},
    )


def perform(host: SimulatedHostProvider, number: int, step: Step) -> None:
    host.read(step.address, SCOPE)
    host.record(StepRecorded(number=number, status=StepStatus.BEGUN))
    host.execute(step.operation, SCOPE)
    if host.read(step.address, SCOPE)["reserve"] != step.after["reserve"]:
        raise RuntimeError("the step did nothing")
    host.record(StepRecorded(number=number, status=StepStatus.CHANGED))


def step_costs(partitions: int) -> list[Figure]:
    watch = StopwatchDisk()
    net: list[float] = []
    waits: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        host = filled(Path(folder), partitions)
        steps = tuple(a_step(number, partitions) for number in range(STEPS))
        with disk.use(watch):
            host.start_run(a_run(host.observe(), steps))
            for number, step in enumerate(steps):
                watch.waited, begun = 0.0, time.perf_counter()
                perform(host, number, step)
                waits.append(watch.waited)
                net.append(time.perf_counter() - begun - watch.waited)
    at = f"with {partitions} partitions"
    return [
        Figure(name=f"a step {at}, net of fsync", value=1000 * statistics.median(net), unit="ms", at_most=GOAL_MS),
        Figure(name=f"its fsync {at}", value=1000 * statistics.median(waits), unit="ms"),
    ]


def observation(partitions: int) -> Figure:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / ".rarms" / "hosts" / "onboard.json"
        host = filled(Path(folder), 1)
        content = host.load()
        (machine,) = content.machines.values()
        ids = [f"{number:08x}-0000-4000-8000-000000000000" for number in range(partitions)]
        copies = {
            one: replace(machine, id=one, notes=write_mark("", mark_for(one, "robot", f"part-{number}", "0" * 12)))
            for number, one in enumerate(ids)
        }
        host.save(replace(content, made=partitions, machines=copies))
        times = [seconds(SimulatedHostProvider(a_host(), path).observe) for _ in range(7)]
    return Figure(
        name=f"observing {partitions} partitions", value=1000 * statistics.median(times), unit="ms", at_most=100
    )


def main() -> int:
    return report([*step_costs(4), *step_costs(100), observation(1000)])


if __name__ == "__main__":
    sys.exit(main())
