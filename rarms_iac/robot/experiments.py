"""Experiments on this machine for another computer, the caller: the robot's side of `measuring.on_robot`.

In: the caller's manifest and data logs, and the components' files of this machine. Out: reports, records of data logs,
and a result. Records are in a folder of this request, and this side sends each at once. The folder is removed at the
end. Begin at `COMMANDS`.
"""

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from shutil import rmtree
from tempfile import TemporaryDirectory
from typing import Any

from rarms_iac.app.control import Control, MeasuringReporter, SilentAppReporter
from rarms_iac.app.hosts import Hosts, select_hosts
from rarms_iac.app.manifest_files import text_of
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.measuring.measure import measure_components
from rarms_iac.measuring.measure_request import MeasureRequest
from rarms_iac.measuring.on_robot import (
    REPORTS,
    SAMPLES,
    SETTINGS,
    TUNING,
    ExperimentJob,
    RobotReports,
    different_files,
    logs_below,
)
from rarms_iac.measuring.prove import ProveRequest, prove_layout
from rarms_iac.measuring.run_component import RunRequest, SampleReporter, run_components
from rarms_iac.measuring.tune import UNATTENDED_TUNING, TunedThere, TuneRequest, TuningPrompt, tune_here
from rarms_iac.model.diagnostics import Diagnostic, Place, Sources
from rarms_iac.model.host import Host
from rarms_iac.model.journal import Journal
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import State
from rarms_iac.providers.interface import UNHEARD, HostFailed, RobotListener
from rarms_iac.robot.caller import Caller
from rarms_iac.storage.codec import Json, NotDecodable, decode, encode
from rarms_iac.storage.datalog.merging import is_log
from rarms_iac.storage.datalog.named_files import Files
from rarms_iac.storage.disk import MEASUREMENTS, make_folder_for
from rarms_iac.storage.writing import Locked, hold, owner
from rarms_iac.storage.writing import replace as write

WORK = Path("/run/rarms")
"""The folder of this machine that has a folder for each request while it is done."""

LOCK = "lock"
_WAIT_MS = 10_000  # for another request that makes its folder
_PAUSE_S = 1.0  # least time between two reports of samples
_PAUSES = 20  # least time between two reports, in multiples of the time for sending one


@dataclass(frozen=True, slots=True)
class OtherHost:
    """A `RobotHost`: another host of the manifest, as the other side saw it. It does nothing."""

    host: Host
    state: State

    @property
    def name(self) -> str:
        return self.host.name

    def observe(self) -> State:
        return self.state

    def examined(self, application: str) -> SeenHost:
        return SeenHost(host=self.host, application=application, state=self.state)

    def journal(self) -> Journal | None:
        return None

    def unfinished(self) -> Journal | None:
        return None

    def holder(self) -> str:
        return ""

    def look_once(self) -> None:
        """Note that the host was looked at."""

    def ask(self, command: str, job: Json, listener: RobotListener = UNHEARD) -> Json:  # noqa: ARG002 - the protocol's
        raise HostFailed(self.name, f"a robot cannot {command} on another robot", "Run the command on your computer.")


@dataclass(slots=True)
class _Reporter(SilentAppReporter):
    """A `Reporter` that sends its calls to the caller."""

    workspace: "_Workspace"

    def message(self, text: str) -> None:
        self.workspace.reports.message(text)

    def findings(self, diagnostics: Sequence[Diagnostic], sources: Sources | None = None) -> None:  # noqa: ARG002
        self.workspace.reports.findings(self.workspace.named(diagnostics))


@dataclass(slots=True)
class _Workspace:
    """The folder of a request, and who asked for it."""

    job: ExperimentJob
    caller: Caller
    files: Mapping[str, str]  # the other side's names of the manifest's texts, by those here
    platform: str = ""
    sent: dict[str, bytes] = field(default_factory=dict)  # logs as the other side knows them
    reports: RobotReports = field(init=False)

    def __post_init__(self) -> None:
        self.reports = self.caller.sends(RobotReports, REPORTS)

    @property
    def control(self) -> Control:
        """The caller's part in a use case."""
        reporter = _Reporter(self)
        reporter.settings = self._settings()
        return Control(reporter=reporter, stop=self.caller.interrupts, consents=self._consents)

    def _settings(self) -> MeasuringReporter:
        """Send the reports of settings, the new records of logs after each setting, and at intervals the samples."""
        settings: Any = self.caller.sends(MeasuringReporter, SETTINGS) if self.caller.listens else MeasuringReporter()
        settings.samples_came = now_and_then(settings.samples_came)
        settings.proof_samples_came = now_and_then(settings.proof_samples_came)
        ended = settings.setting_ended

        def setting_ended(*arguments: object) -> None:
            ended(*arguments)
            self.send_logs()

        settings.setting_ended = setting_ended
        reporter: MeasuringReporter = settings
        return reporter

    @property
    def tuning_prompt(self) -> TuningPrompt:
        """The other side's, to which findings name the manifest's files as it does."""
        calls: Any = self.caller.sends(TuningPrompt, TUNING)
        confirms = calls.confirms
        calls.confirms = lambda found: confirms(replace(found, findings=self.named(found.findings)))
        prompt: TuningPrompt = calls
        return prompt

    def _consents(self, host: str, partitions: tuple[str, ...]) -> bool:
        if not self.caller.listens:
            return self.job.may_stop
        return self.reports.consents(host, partitions)

    def send_logs(self) -> None:
        """Send the new records in the logs of the platform."""
        for path, content in logs_below(Path()).items():
            before = self.sent.get(path, b"")
            if content != before and PurePosixPath(path).parts[0] == self.platform:
                known_bytes = len(before) if content[: len(before)] == before else 0
                self.reports.log(path, known_bytes, content[known_bytes:].decode("utf-8"))
                self.sent[path] = content

    def named(self, diagnostics: Sequence[Diagnostic]) -> tuple[Diagnostic, ...]:
        """Return findings that name the manifest's files as the other side does."""
        return tuple(
            replace(
                each,
                place=self._placed(each.place) if each.place else None,
                related=tuple(replace(other, place=self._placed(other.place)) for other in each.related),
            )
            for each in diagnostics
        )

    def _placed(self, place: Place) -> Place:
        return replace(place, file=self.files.get(place.file, place.file))


def measure(host: Host, job: Json, caller: Caller) -> Json:
    """Measure components; each result is a call, the rest of the outcome is the result."""
    with _workspace(host, job, caller) as (workspace, hosts, asked):
        outcome = measure_components(hosts, decode(MeasureRequest, asked), workspace.control)
        workspace.send_logs()
        for result in outcome.experiments:
            workspace.reports.measured(result)
        return encode(replace(outcome, experiments=(), findings=workspace.named(outcome.findings)))


def tune(host: Host, job: Json, caller: Caller) -> Json:
    """Combine components; what changes in the manifest is changed in its copy here, and goes to the other side."""
    with _workspace(host, job, caller) as (workspace, hosts, asked):
        prompt = workspace.tuning_prompt if caller.listens else UNATTENDED_TUNING
        result = tune_here(hosts, decode(TuneRequest, asked), workspace.control, prompt)
        workspace.send_logs()
        texts = {workspace.files[file]: text_of(file) for file in result.files}
        named = replace(result, findings=workspace.named(result.findings), files=tuple(texts))
        return encode(TunedThere(result=named, texts=texts))


def prove(host: Host, job: Json, caller: Caller) -> Json:
    """Prove the applied layout."""
    with _workspace(host, job, caller) as (workspace, hosts, asked):
        outcome = prove_layout(hosts, decode(ProveRequest, asked), workspace.control)
        workspace.send_logs()
        return encode(replace(outcome, findings=workspace.named(outcome.findings)))


def run(host: Host, job: Json, caller: Caller) -> Json:
    """Run components."""
    with _workspace(host, job, caller) as (workspace, hosts, asked):
        reporter = caller.sends(SampleReporter, SAMPLES) if caller.listens else None
        outcome = run_components(hosts.manifest, decode(RunRequest, asked), reporter)
        return encode(replace(outcome, findings=workspace.named(outcome.findings)))


COMMANDS = {"measure": measure, "tune": tune, "prove": prove, "run": run}


@contextmanager
def _workspace(host: Host, job: Json, caller: Caller) -> Iterator[tuple[_Workspace, Hosts, Json]]:
    """Write the caller's files to a new current folder, and compare the components' files.

    Raises:
        UseCaseError: a file of the components is not here, or another one (refused); or what the use case raised.
    """
    asked = decode(ExperimentJob, job)
    with _own_folder():
        try:
            files = _write_texts(asked)
            for path, text in asked.logs.items():
                if not is_log(path):
                    raise NotDecodable("logs", f"{path[:80]!r} is not a log")
                _write(Path(MEASUREMENTS, path), text)
            workspace = _Workspace(asked, caller, files, host.platform, dict(logs_below(Path())))
            try:
                yield workspace, _hosts_of(asked, host, tuple(files)), asked.request
            except UseCaseError as error:
                workspace.send_logs()
                raise UseCaseError(error.outcome, workspace.named(error.findings)) from error
        finally:
            os.chdir("/")


@contextmanager
def _own_folder() -> Iterator[None]:
    """Make a new current folder, remove it at the end, and remove now what killed processes left."""
    WORK.mkdir(mode=0o700, exist_ok=True)
    with ExitStack() as stack:
        with hold(WORK / LOCK, owner(), _WAIT_MS):
            for left in WORK.glob("*/"):
                with suppress(Locked), hold(left / LOCK, owner()):
                    rmtree(left)
            folder = Path(stack.enter_context(TemporaryDirectory(dir=WORK)))
            stack.enter_context(hold(folder / LOCK, owner()))
        os.chdir(folder)
        yield


def _write_texts(job: ExperimentJob) -> Mapping[str, str]:
    """Write manifest and overlays, each overlay in a folder of its own; the robot is called like the last one."""
    files: dict[str, str] = {}
    for number, text in enumerate(job.texts):
        name = Path(text.file).name
        path = Path(f"overlay-{number}", name) if number else Path("rarms.yaml")
        _write(path, text.text)
        files[path.as_posix()] = text.file
    return files


def _write(path: Path, text: str) -> None:
    make_folder_for(path)
    write(path, text.encode("utf-8"))


def _hosts_of(job: ExperimentJob, host: Host, files: Sequence[str]) -> Hosts:
    manifest, *overlays = files
    source = ManifestSource(
        manifest=manifest, overlays=tuple(overlays), today=job.today, here=host.name, code=job.folder
    )
    hosts = select_hosts(load_manifest(source), HostSelection(hosts=job.hosts))
    system = hosts.system
    here = Files(Path(), code=Path(job.folder)).named_by(system.components.values(), system.interference.values())
    if problems := different_files(host.name, job, here):
        raise UseCaseError(Outcome.REFUSED, problems)
    return replace(
        hosts, looked_at_once={name: OtherHost(system.hosts[name], state) for name, state in job.others.items()}
    )


def now_and_then(report: Callable[..., None]) -> Callable[..., None]:
    """Return a reporter's method that passes on a call only after a pause, which is longer where calls take long."""
    next_time = 0.0

    def call(*arguments: object) -> None:
        nonlocal next_time
        began = time.monotonic()
        if began >= next_time:
            report(*arguments)
            ended = time.monotonic()
            next_time = ended + max(_PAUSE_S, _PAUSES * (ended - began))

    return call
