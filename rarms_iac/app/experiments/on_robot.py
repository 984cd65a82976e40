"""Experiments that a robot's own rarms does whole: what is sent for them, and what comes back meanwhile.

Manifest, data logs and digests of the components' files go there. Records of data logs come back as soon as they are
made, through the readers of these logs. `rarms_iac.robot.experiments` is the other end. Begin at `ask_robot`.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import date
from pathlib import Path
from typing import Any

from rarms_iac.app.control import Control
from rarms_iac.app.experiments.measure_request import ExperimentResult
from rarms_iac.app.hosts import Hosts, host_errors, observe_host
from rarms_iac.app.manifest_edits import text_of
from rarms_iac.app.robot_measurements import add_measurements
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.measuring.measuring_findings import CANNOT_MEASURE
from rarms_iac.model.diagnostics import Diagnostic, Finding
from rarms_iac.model.host import Connect
from rarms_iac.model.series import Series
from rarms_iac.model.state import State
from rarms_iac.providers.interface import HostFailed
from rarms_iac.providers.robot import LINE_LIMIT, perform_call
from rarms_iac.storage.codec import Json, NotDecodable, encode
from rarms_iac.storage.datalog.merging import MOST_BYTES, is_log
from rarms_iac.storage.datalog.named_files import Files
from rarms_iac.storage.disk import MEASUREMENTS
from rarms_iac.storage.reading import read_file

OTHER_FILE = Finding.error("RARMS411", "A file of a component differs on the robot")

REPORTS, SETTINGS, SAMPLES, TUNING = "reports", "settings", "samples", "tuning"
"""The reporters of this side, as calls name them."""

SamplesSoFar = Callable[[str, str | None, Mapping[str, Series]], None]
"""Called with the name of a host, of the load beside it, and the samples of its components so far, as they come."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ManifestText:
    """A manifest or an overlay."""

    file: str  # as messages of this side name it
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentJob:
    """Everything that an experiment on the robot needs, but for the request of its command."""

    texts: tuple[ManifestText, ...]  # the manifest, then its overlays in their order
    today: date
    folder: str  # of the components' files, there
    files: Mapping[str, str]  # digests of the components' files, here, by path below their folder
    logs: Mapping[str, str]  # by path below `measurements/`
    hosts: tuple[str, ...]  # the chosen ones, with the robot
    others: Mapping[str, State]  # the other hosts of the manifest that could be reached from here
    may_stop: bool  # partitions may be stopped to measure; counts where no question can be asked


class RobotReports:
    """Hears what a robot reports, beside its settings and samples."""

    def consents(self, host: str, partitions: tuple[str, ...]) -> bool:  # noqa: ARG002 - a person is asked
        """Tell whether these partitions of a host may be stopped to measure."""
        return False

    def message(self, text: str) -> None:
        """Take whole sentences for a person."""

    def findings(self, diagnostics: tuple[Diagnostic, ...]) -> None:
        """Take findings that do not end the work."""

    def log(self, path: str, kept: int, text: str) -> None:
        """Take what is new in a log below `measurements/`: its first `kept` bytes are known, and `text` follows."""

    def measured(self, result: ExperimentResult) -> None:
        """Take the result of an experiment."""

    def proving(self, host: str, load: str | None, series: Mapping[str, Series]) -> None:
        """Take the samples of a proof so far."""


@dataclass(slots=True, kw_only=True)
class ExperimentListener(RobotReports):
    """The `RobotListener` of an experiment: reporters hear what they would hear of this machine; logs are kept here."""

    hosts: Hosts
    host: str
    control: Control
    reporters: Mapping[str, tuple[type[Any], Any]] = field(default_factory=dict)  # by target: its class and itself
    samples: SamplesSoFar = lambda _host, _load, _series: None
    results: list[ExperimentResult] = field(default_factory=list)
    known: dict[str, bytes] = field(default_factory=dict)  # logs there, as far as this side knows them
    came_bytes: int = 0  # of logs, from there

    def should_stop(self) -> bool:
        return self.control.stop.should_stop()

    def on_call(self, target: str, method: str, arguments: Json) -> bool | None:
        if target == REPORTS:
            return perform_call(self, RobotReports, method, arguments)
        if target in self.reporters:
            interface, reporter = self.reporters[target]
            return perform_call(reporter, interface, method, arguments)
        raise NotDecodable("target", f"there is no {target[:40]}")

    def consents(self, host: str, partitions: tuple[str, ...]) -> bool:
        """Ask the caller as `Control` says."""
        return self.control.consents(host, partitions)

    def message(self, text: str) -> None:
        """Pass on the sentences."""
        self.control.reporter.message(text)

    def findings(self, diagnostics: tuple[Diagnostic, ...]) -> None:
        """Pass on the findings."""
        self.control.reporter.findings(diagnostics, self.hosts.manifest.sources)

    def proving(self, host: str, load: str | None, series: Mapping[str, Series]) -> None:
        """Pass on the samples."""
        self.samples(host, load, series)

    def measured(self, result: ExperimentResult) -> None:
        """Keep the result, with the log's place here."""
        self.results.append(replace(result, log=(self.hosts.folder / result.log).as_posix()))

    def log(self, path: str, kept: int, text: str) -> None:
        """Add what is new in a log to the log here."""
        if not self._is_own_log(path):
            raise NotDecodable("path", f"{path[:80]!r} is not a log of a component of {self.host}")
        before = self.known.get(path, b"")
        if not 0 <= kept <= len(before):
            raise NotDecodable("kept", f"{kept} of {len(before)} bytes")
        came = text.encode("utf-8")
        self.came_bytes += len(came)
        if self.came_bytes > MOST_BYTES:
            raise NotDecodable("text", f"logs of more than {MOST_BYTES:,} bytes came")
        self.known[path] = before[:kept] + came
        add_measurements(self.hosts.folder, path.partition("/")[0], {path: self.known[path]})

    def _is_own_log(self, path: str) -> bool:
        """Whether the host's components can have this log, so that a robot cannot write others, or any number."""
        system = self.hosts.system
        platform, *names = path.removesuffix(".jsonl").removesuffix(".configuration").split("/")
        members = names[0].split("+") if names else []
        if not is_log(path) or platform != system.hosts[self.host].platform:
            return False
        return names == ["tuning"] or (
            members == sorted(set(members) & set(system.components)) and set(names[1:]) <= set(system.interference)
        )


def ask_robot(
    hosts: Hosts,
    host: str,
    command: str,
    request: object,
    listener: ExperimentListener,
    *,
    components: Iterable[str],
    loads: Iterable[str],
) -> Json:
    """Have a robot do an experiment, and return what its use case returned, encoded.

    Args:
        hosts: those of the manifest.
        host: the robot's name in it.
        command: `measure`, `tune`, `prove` or `run`.
        request: of the command.
        listener: hears what the robot reports.
        components: names of those whose files must be the same there as here.
        loads: likewise.

    Raises:
        UseCaseError: the robot cannot be asked or `connect` has no folder (failed); or its use case raised one.
    """
    logs = logs_below(hosts.folder)
    listener.known = dict(logs)
    system, control = hosts.system, listener.control
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
    )
    robot = hosts.robot(host)
    assert robot is not None, "only robots are asked"
    with host_errors(), control.stop.gently():
        return robot.ask(command, {"job": encode(job), "request": encode(request)}, listener)


@contextmanager
def readable_answer(host: str) -> Iterator[None]:
    """Inside, an answer of a robot that cannot be read ends the use case.

    Raises:
        UseCaseError: it is not as the codec writes it (failed).
    """
    with host_errors():
        try:
            yield
        except NotDecodable as problem:
            raise HostFailed(host, f"its answer cannot be read: {problem}", "Look at the host by hand.") from None


def _folder_there(hosts: Hosts, host: str) -> str:
    connect = hosts.system.hosts[host].connect
    if connect is None:  # a channel of the caller leads to it
        return hosts.folder.resolve().as_posix()
    if isinstance(connect, Connect) and connect.folder is not None:
        return connect.folder
    message = f"The manifest does not say where {host} has the files of its components."
    advice = "Copy the manifest's folder there, and name the copy: `connect: { folder: /opt/robot }`."
    place = hosts.manifest.places.value("hosts", host, "connect")
    finding = CANNOT_MEASURE.of_host(host, message, advice, place=place)
    raise UseCaseError(Outcome.FAILED, [finding], hosts.manifest.sources)


def _other_states(hosts: Hosts, host: str) -> Mapping[str, State]:
    """The states of the manifest's other hosts, of those that can be reached."""
    states: dict[str, State] = {}
    for name in sorted(set(hosts.system.hosts) - {host}):
        with suppress(UseCaseError):
            states[name] = observe_host(hosts.open(name))
    return states


def different_files(host: str, job: ExperimentJob, there: Mapping[str, str]) -> list[Diagnostic]:
    """Find the components' files that the robot does not have as this side has them.

    Args:
        host: the robot's name.
        job: what was sent.
        there: digests of the robot's files, by path below `job.folder`.

    Returns:
        An error for each file, in the order of their names.
    """
    problems: list[Diagnostic] = []
    for path, digest in sorted(job.files.items()):
        if there.get(path) != digest:
            how = "is another file there than here" if path in there else "is not there"
            message = f"{path} {how}: {host} has the components' files in {job.folder}."
            advice = "Copy it there, and repeat the command."
            problems.append(OTHER_FILE.of_host(host, message, advice, file=path, folder=job.folder))
    return problems


def logs_below(folder: Path) -> Mapping[str, bytes]:
    """Read the logs that a robot needs, by path below `measurements/`.

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
