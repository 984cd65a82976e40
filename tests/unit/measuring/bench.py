"""The loop of measuring on a simulated host in a folder, for the tests of this folder."""

from collections.abc import Callable, Iterator
from pathlib import Path

from rarms_iac.app.control import Control, MeasuringReporter, NeverStop, SilentAppReporter
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.app.snapshots import Snapshots
from rarms_iac.manifest.load import Loaded
from rarms_iac.manifest.text.tree import first_line
from rarms_iac.measuring.availability import available_on_host
from rarms_iac.measuring.duration import WallTimes
from rarms_iac.measuring.experiment_log import ExperimentLog
from rarms_iac.measuring.measure_request import ExperimentResult
from rarms_iac.measuring.partitions import remove_test_partitions
from rarms_iac.measuring.run_experiment import ExperimentRun, measure_settings
from rarms_iac.measuring.session import MeasuringSession
from rarms_iac.measuring.strategies import Search, Searching, SettingCount, Strategy, Sweep, goal_of, strategy_of
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.setting import PlatformFacts
from rarms_iac.providers.simulated.measuring import Simulate, SimulatedMeasuringHost
from rarms_iac.providers.simulated.scheduling.machine import JobDone, ModelMachine
from rarms_iac.storage.datalog.files import read_log
from rarms_iac.storage.datalog.identity import LogSubject, header_of, identity_of, present_log
from rarms_iac.storage.datalog.log import Remeasurement
from tests.builders import a_host, a_system
from tests.fluid import fluid


class Told(SilentAppReporter):
    """Passes on what is told of settings."""

    def __init__(self, settings: MeasuringReporter) -> None:
        self.settings = settings


class Stops(NeverStop):
    """Is asked to stop when the test says so."""

    def __init__(self, should_stop: Callable[[], bool]) -> None:
        self._should_stop = should_stop

    def should_stop(self) -> bool:
        return self._should_stop()


class Bench:
    """A folder with a host and a data log; each call opens both again, as a new process would."""

    def __init__(self, folder: Path, experiment: Experiment) -> None:
        self.folder = folder
        self.experiment = experiment
        self.ran: list[float] = []  # what P1 reserved in each simulation that was begun

    def host(self, simulate: Simulate = fluid) -> SimulatedMeasuringHost:
        def counted(machine: ModelMachine, seed: int) -> Iterator[JobDone]:
            self.ran += [vm.reserve for vm in machine.machines if vm.components]
            return simulate(machine, seed)

        return SimulatedMeasuringHost(a_host(), self.folder / "onboard.json", counted)

    @property
    def book(self) -> ExperimentLog:
        experiment, path = self.experiment, self.folder / "logs" / "log.jsonl"
        subject = LogSubject(
            platform="onboard", components=experiment.members, setup=experiment.setup, load=experiment.load, tasks={}
        )
        header = header_of(subject, identity_of(subject, {}, {}), self.facts)
        file = read_log(path)
        present = None if file is None else present_log(file, header.setup.members, header.identity, self.facts)
        return ExperimentLog(path=path, experiment=experiment, header=header, present=present)

    @property
    def facts(self) -> PlatformFacts:
        return self.host().platform_facts()

    @property
    def hosts(self) -> Hosts:
        system = a_system(hosts=[self.experiment.host], components=list(self.experiment.members))
        folder = str(self.folder)
        loaded = Loaded(
            system=system, places=first_line(""), diagnostics=(), sources={}, folder=folder, parsed=(), digest=""
        )
        manifest = Manifest(source=ManifestSource(), system=system, loaded=loaded)
        return Hosts(manifest=manifest, selection=HostSelection(), snapshots=Snapshots(hosts={}))

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
    ) -> ExperimentResult:
        host, book = self.host(simulate), self.book
        again = Remeasurement(seed=remeasure_seed or 0, asked="", begun="")
        with host.lock("a test"):
            remove_test_partitions(host)
            session = MeasuringSession(
                hosts=self.hosts,
                control=Control(reporter=Told(reporter or MeasuringReporter()), stop=Stops(should_stop)),
                seed=seed,
                remeasurements={book.path: again} if remeasure_seed else {},
                wall_times=wall_times or WallTimes(),
                held_hosts={host.name: host},
            )
            run = ExperimentRun(
                session=session,
                experiment=self.experiment,
                method=Sweep(),
                strategy=strategy or self.search(),
                log=book,
                available=available_on_host(session, self.experiment),
                count=count,
            )
            answer = measure_settings(run)
            assert isinstance(answer, ExperimentResult), answer
            return answer

    @property
    def recorded(self) -> list[int]:
        return [setting.reserve for setting in self.book.known.settings]

    @property
    def machines(self) -> list[str]:
        return [partition.settings.name for partition in self.host().observe().partitions]
