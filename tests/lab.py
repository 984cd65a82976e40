"""A test bench: a system, its simulated hosts in a folder, and the route between them as the commands take it."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from tempfile import TemporaryDirectory

from rarms_iac.applying.execute import apply_plan, finish_unfinished
from rarms_iac.applying.make_plan import PlanningResult, make_plan
from rarms_iac.applying.run_report import RunReport
from rarms_iac.applying.run_steps import RunControl
from rarms_iac.applying.undo import undo
from rarms_iac.model.operations import CreatePartition, RenamePartition, StartPartition, set_to
from rarms_iac.model.plan import Plan, Scope
from rarms_iac.model.state import State
from rarms_iac.model.system import System
from rarms_iac.providers.simulated.provider import SimulatedHostProvider
from tests.builders import ORIGIN
from tests.planning import a_request
from tests.strategies import Strangers

TODAY = date(2026, 11, 21)
ANOTHER_TOOL = Scope(application="somebody", plan="by-hand")


def never() -> bool:
    return False


@dataclass
class Countdown:
    """Asks for the end after so many looks."""

    left: int

    def __call__(self) -> bool:
        self.left -= 1
        return self.left < 0


@dataclass(frozen=True)
class Lab:
    """Each call opens the hosts again, as a new process would."""

    system: System
    folder: Path

    @property
    def hosts(self) -> dict[str, SimulatedHostProvider]:
        return {
            name: SimulatedHostProvider(host, self.folder / f"{name}.json") for name, host in self.system.hosts.items()
        }

    def wanting(self, system: System) -> "Lab":
        """These hosts under another manifest."""
        return replace(self, system=system)

    def observe(self) -> dict[str, State]:
        return {name: host.observe() for name, host in self.hosts.items()}

    def prepare(self, **asked: object) -> PlanningResult:
        return make_plan(a_request(self.system, today=TODAY, **asked), self.observe())

    def plan(self, **asked: object) -> Plan:
        prepared = self.prepare(**asked)
        assert prepared.plan is not None, prepared.findings
        return prepared.plan

    def apply(self, plan: Plan, should_stop: Callable[[], bool] = never) -> RunReport:
        return apply_plan(plan, self.hosts, ORIGIN, RunControl(should_stop=should_stop))

    def finish(self) -> RunReport | None:
        return finish_unfinished(list(self.hosts.values()))

    def undo(self, should_stop: Callable[[], bool] = never) -> list[RunReport]:
        return [undo(host, ORIGIN, RunControl(should_stop=should_stop)) for host in self.hosts.values()]

    def steps_left(self) -> int:
        return sum(len(host.steps) for host in self.plan().hosts)

    def add(self, others: Strangers) -> None:
        """Put machines of another owner on the first host, by hand."""
        host = next(iter(self.hosts.values()))
        for partition in others.partitions:
            settings, name = partition.settings, partition.settings.name
            create = CreatePartition(partition=name, generation=settings.generation, memory=settings.memory)
            host.execute(create, ANOTHER_TOOL)
            cpu = set_to(name, reserve=settings.reserve, limit=settings.limit, weight=settings.weight)
            host.execute(cpu, ANOTHER_TOOL)
            if settings.running:
                host.execute(StartPartition(partition=name), ANOTHER_TOOL)
            host.execute(RenamePartition(partition=name, name=name), ANOTHER_TOOL)


@contextmanager
def a_lab(system: System) -> Iterator[Lab]:
    """A bench in a folder that goes away, also for properties, which run many times in one test."""
    with TemporaryDirectory() as folder:
        yield Lab(system, Path(folder))


def without_serials(states: Mapping[str, State]) -> dict[str, State]:
    """What an undo brings back: everything but the count of applies."""
    return {name: replace(state, serials={}) for name, state in states.items()}
