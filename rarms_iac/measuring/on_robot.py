"""Experiments of the rarms on a robot: the data that this side sends, and the reports that it receives meanwhile.

This side sends the manifest, data logs, and digests of the components' files. The robot sends each new record of a data
log at once; the readers of data logs check it. `rarms_iac.robot.experiments` is the other side. Begin at `ask_robot`.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import date
from pathlib import Path
from typing import Any, Protocol, TypeVar

from rarms_iac.app.control import Control, MeasuringReporter
from rarms_iac.app.hosts import Hosts, host_errors, observe_host
from rarms_iac.app.manifest_files import text_of
from rarms_iac.app.measurement_files import add_measurements
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.measuring.findings import OTHER_FILE, UNABLE
from rarms_iac.measuring.measure_request import ExperimentResult
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import Connect
from rarms_iac.model.state import State
from rarms_iac.providers.interface import HostFailed, RobotListener
from rarms_iac.providers.robot import LINE_LIMIT
from rarms_iac.storage.codec import NotDecodable, decode, encode
from rarms_iac.storage.datalog.merging import MOST_BYTES, is_log
from rarms_iac.storage.datalog.named_files import Files
from rarms_iac.storage.disk import MEASUREMENTS
from rarms_iac.storage.reading import read_file

Answer = TypeVar("Answer")

REPORTS, SETTINGS, SAMPLES, TUNING = "reports", "settings", "samples", "tuning"
"""The reporters of this side, as calls name them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ManifestText:
    """A manifest or an overlay."""

    file: str  # its name in messages of this side
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentJob:
    """The data of an experiment on the robot."""

    texts: tuple[ManifestText, ...]  # the manifest, then its overlays in their order
    today: date
    folder: str  # of the components' files, on the robot
    files: Mapping[str, str]  # digests of the components' files on this side, by path below their folder
    logs: Mapping[str, str]  # by path below `measurements/`
    hosts: tuple[str, ...]  # the chosen ones, with the robot
    others: Mapping[str, State]  # the other hosts of the manifest that could be reached from here
    may_stop: bool  # partitions may be stopped to measure; counts where no question can be asked
    request: Any  # of the command, as JSON


class RobotReports(Protocol):
    """Receives the reports of a robot; settings and samples have reporters of their own."""

    def consents(self, host: str, partitions: tuple[str, ...]) -> bool:
        """Return whether partitions may be stopped to measure."""

    def message(self, text: str) -> None:
        """Take sentences for the user."""

    def findings(self, diagnostics: tuple[Diagnostic, ...]) -> None:
        """Take findings that do not end the work."""

    def log(self, path: str, known_bytes: int, text: str) -> None:
        """Take the end of a log.

        Args:
            known_bytes: the size of its begin, which this side has already.

        Raises:
            NotDecodable: the log is not of a component of the host, is too large, or does not have the known bytes.
        """

    def measured(self, result: ExperimentResult) -> None:
        """Take the result of an experiment."""


@dataclass(slots=True, kw_only=True)
class ExperimentListener(RobotReports):
    """Passes reports of an experiment on to reporters, and adds records to the logs here."""

    hosts: Hosts
    host: str
    control: Control
    reporters: Mapping[str, tuple[type[Any], Any]] = field(default_factory=dict)  # by target: its class and itself
    results: list[ExperimentResult] = field(default_factory=list)
    known: dict[str, bytes] = field(default_factory=dict)  # the robot's logs, as far as this side has them
    came_bytes: int = 0  # of logs, from the robot

    def consents(self, host: str, partitions: tuple[str, ...]) -> bool:
        return self.control.consents(host, partitions)

    def message(self, text: str) -> None:
        self.control.reporter.message(text)

    def findings(self, diagnostics: tuple[Diagnostic, ...]) -> None:
        self.control.reporter.findings(diagnostics, self.hosts.manifest.sources)

    def measured(self, result: ExperimentResult) -> None:
        self.results.append(replace(result, log=(self.hosts.folder / result.log).as_posix()))

    def log(self, path: str, known_bytes: int, text: str) -> None:
        if not self._is_own_log(path):
            raise NotDecodable("path", f"{path[:80]!r} is not a log of a component of {self.host}")
        before = self.known.get(path, b"")
        if not 0 <= known_bytes <= len(before):
            raise NotDecodable("known_bytes", f"{known_bytes} of {len(before)} bytes")
        came = text.encode("utf-8")
        self.came_bytes += len(came)
        if self.came_bytes > MOST_BYTES:
            raise NotDecodable("text", f"the logs have more than {MOST_BYTES:,} bytes")
        self.known[path] = before[:known_bytes] + came
        add_measurements(self.hosts.folder, path.partition("/")[0], {path: self.known[path]})

    def _is_own_log(self, path: str) -> bool:
        """Return whether a component of the host can have this log. A robot cannot write other logs."""
        system = self.hosts.system
        platform, *names = path.removesuffix(".jsonl").removesuffix(".configuration").split("/")
        members = names[0].split("+") if names else []
        if not is_log(path) or platform != system.hosts[self.host].platform:
            return False
        return names == ["tuning"] or (
            members == sorted(set(members) & set(system.components)) and set(names[1:]) <= set(system.interference)
        )


def ask_robot(
    listener: ExperimentListener,
    command: str,
    request: object,
    answer: type[Answer],
    *,
    components: Iterable[str],
    loads: Iterable[str],
) -> Answer:
    """Have a robot do an experiment, and return the result of its use case.

    Args:
        command: `measure`, `tune`, `prove` or `run`.
        components: names of the components whose files must be equal on both sides.
        loads: names of the loads whose files must be equal on both sides.

    Raises:
        UseCaseError: the robot cannot be asked, `connect` has no folder, or the result cannot be read (failed); or its
            use case raised one.
    """
    hosts, host, control = listener.hosts, listener.host, listener.control
    logs, system = logs_below(hosts.folder), hosts.system
    listener.known = dict(logs)
    members, against = [system.components[name] for name in components], [system.interference[name] for name in loads]
    job = ExperimentJob(
        texts=tuple(ManifestText(file=file, text=text_of(file)) for file in hosts.manifest.sources),
        today=hosts.manifest.source.today,
        folder=_folder_there(hosts, host),
        files=Files(hosts.folder).named_by(members, against),
        logs={path: content.decode("utf-8") for path, content in logs.items()},
        hosts=hosts.chosen,
        others=_other_states(hosts, host),
        may_stop=host in hosts.channels and control.consents(host, ()),
        request=encode(request),
    )
    reporters = {
        REPORTS: (RobotReports, listener),
        SETTINGS: (MeasuringReporter, control.reporter.settings),
        **listener.reporters,
    }
    robot = hosts.robot(host)
    assert robot is not None, "only robots are asked"
    with host_errors(), control.stop.gently():
        encoded = robot.ask(
            command, encode(job), RobotListener(reporters=reporters, should_stop=control.stop.should_stop)
        )
    with readable_answer(host):
        return decode(answer, encoded)


@contextmanager
def readable_answer(host: str) -> Iterator[None]:
    """End the use case if the robot's answer cannot be decoded inside.

    Raises:
        UseCaseError: it is not as the codec writes it (failed).
    """
    with host_errors():
        try:
            yield
        except NotDecodable as problem:
            raise HostFailed(
                host, f"its answer cannot be read: {problem}", "Check the installation of rarms on the host."
            ) from None


def _folder_there(hosts: Hosts, host: str) -> str:
    connect = hosts.system.hosts[host].connect
    if connect is None:  # a channel of the caller leads to it
        return hosts.folder.resolve().as_posix()
    if isinstance(connect, Connect) and connect.folder is not None:
        return connect.folder
    template = "The folder of the components' files on {host} is not in the manifest."
    advice = "Copy the manifest's folder to the host, and set its path: `connect: { folder: /opt/robot }`."
    place = hosts.manifest.places.value("hosts", host, "connect")
    finding = UNABLE.of_host(host, template, advice, place=place)
    raise UseCaseError(Outcome.FAILED, [finding], hosts.manifest.sources)


def _other_states(hosts: Hosts, host: str) -> Mapping[str, State]:
    """Return the states of the manifest's other hosts that can be reached."""
    states: dict[str, State] = {}
    for name in sorted(set(hosts.system.hosts) - {host}):
        with suppress(UseCaseError):
            states[name] = observe_host(hosts.open(name))
    return states


def different_files(host: str, job: ExperimentJob, there: Mapping[str, str]) -> list[Diagnostic]:
    """Find the components' files that the robot lacks, or that differ from the files on this side.

    Args:
        there: digests of the robot's files, by path below `job.folder`.

    Returns:
        An error for each file, in the order of their names.
    """
    problems: list[Diagnostic] = []
    for path, digest in sorted(job.files.items()):
        if there.get(path) != digest:
            how = "differs" if path in there else "is missing"
            template = "{file} {_how} in {folder} on {host}."
            advice = "Copy the file to that folder and run the same command again."
            problems.append(OTHER_FILE.of_host(host, template, advice, file=path, folder=job.folder, _how=how))
    return problems


def logs_below(folder: Path) -> Mapping[str, bytes]:
    """Read the logs of a manifest's folder.

    Returns:
        Their bytes, by path below `measurements/`.

    Raises:
        UseCaseError: they have more bytes than a request (failed).
    """
    found: dict[str, bytes] = {}
    root = folder / MEASUREMENTS
    for path in sorted(root.rglob("*.jsonl")):
        name = path.relative_to(root).as_posix()
        if is_log(name):
            found[name] = read_file(path, LINE_LIMIT)
    return found
