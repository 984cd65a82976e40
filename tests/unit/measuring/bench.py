"""The loop of measuring on a simulated host in a folder, for the tests of this folder."""

from collections.abc import Callable, Iterator
from pathlib import Path

from rarms_iac.app.control import MeasuringReporter
from rarms_iac.measuring.loop import LoopResult, measure_settings
from rarms_iac.measuring.methods import Search, strategy_of
from rarms_iac.measuring.partitions import host_resources, remove_test_partitions
from rarms_iac.measuring.setting_run import MeasuringContext
from rarms_iac.measuring.settings_log import SettingsLog
from rarms_iac.measuring.strategies import Searching, SettingCount, Strategy, goal_of
from rarms_iac.measuring.wall_times import WallTimes
from rarms_iac.model.experiment import Experiment
from rarms_iac.providers.simulated.measuring import Simulate, SimulatedMeasuringHost
from rarms_iac.providers.simulated.scheduling.machine import JobDone, ModelMachine
from rarms_iac.storage.datalog.identity import LogSubject, header_of, identity_of
from rarms_iac.storage.datalog.log import Provenance
from tests.builders import a_host
from tests.fluid import fluid

TAKEN = Provenance(rarms_version="0", when="2027-01-31T12:00:00Z")


class Bench:
    """A folder with a host and a data log; each call opens both anew, as a new process would."""

    def __init__(self, folder: Path, experiment: Experiment) -> None:
        self.folder = folder
        self.experiment = experiment
        self.ran: list[float] = []  # what P1 reserved in each simulation that was begun

    def host(self, simulate: Simulate = fluid) -> SimulatedMeasuringHost:
        def counted(machine: ModelMachine, seed: int) -> Iterator[JobDone]:
            self.ran += [vm.reserve for vm in machine.machines if vm.components]
            return simulate(machine, seed)

        return SimulatedMeasuringHost(a_host(), self.folder / "onboard.json", counted)

    def book(self, remeasure_seed: int | None = None) -> SettingsLog:
        experiment = self.experiment
        subject = LogSubject(
            platform="onboard", components=experiment.members, setup=experiment.setup, load=experiment.load, tasks={}
        )
        header = header_of(subject, identity_of(subject, {}, {}), self.host().platform_facts())
        return SettingsLog(
            path=self.folder / "logs" / "log.jsonl",
            header=header,
            provenance=lambda _setting: TAKEN,
            remeasure_seed=remeasure_seed,
        )

    def search(self, name: str = "bisection", most: int = 100) -> Searching:
        searching = strategy_of(Search(strategy=name), goal_of(self.experiment), most)
        assert isinstance(searching, Searching)
        return searching

    def measure(
        self,
        strategy: Strategy | None = None,
        *,
        simulate: Simulate = fluid,
        should_stop: Callable[[], bool] = lambda: False,
        seed: int = 1,
        remeasure_seed: int | None = None,
        count: SettingCount | None = None,
        reporter: MeasuringReporter | None = None,
        wall_times: WallTimes | None = None,
    ) -> LoopResult:
        host = self.host(simulate)
        with host.lock("a test"):
            remove_test_partitions(host)
            around = MeasuringContext(
                host=host,
                resources=lambda: host_resources(a_host(), host.observe(), "robot"),
                seed=seed,
                reporter=reporter or MeasuringReporter(),
                wall_times=wall_times or WallTimes(),
                should_stop=should_stop,
            )
            book = self.book(remeasure_seed)
            return measure_settings(self.experiment, strategy or self.search(), book, around, count=count)

    @property
    def recorded(self) -> list[int]:
        return [setting.reserve for setting in self.book().settings()]

    @property
    def machines(self) -> list[str]:
        return [partition.settings.name for partition in self.host().observe().partitions]
