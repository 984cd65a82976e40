"""A session of measuring: the hosts that one command holds, and how it measures on them."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from rarms_iac.app.control import UNATTENDED, Control
from rarms_iac.app.hosts import Hosts, host_errors, refuse_unfinished
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.measuring import measuring_findings
from rarms_iac.measuring.partitions import remove_test_partitions
from rarms_iac.measuring.stopping import finish_stop_or_start, own_running, start_again, stop_to_measure
from rarms_iac.measuring.wall_times import WallTimes
from rarms_iac.model.commands import START, command, prose
from rarms_iac.model.diagnostics import Diagnostic, Facts
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.host import SimulatedHost
from rarms_iac.model.journal import part_of_measurement
from rarms_iac.model.loads import Interference
from rarms_iac.model.system import Component
from rarms_iac.model.wording import in_a_row
from rarms_iac.providers.measuring import MeasuringHost
from rarms_iac.storage.datalog.log import Remeasurement
from rarms_iac.storage.lock import owner


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuringSession:
    """Where and how a command measures."""

    hosts: Hosts
    control: Control = UNATTENDED
    command: Literal["measure", "tune", "prove"] = "measure"
    seed: int | None = None  # of the random numbers; None: the largest that settings in the log have, or the usual one
    remeasurements: Mapping[Path, Remeasurement] = field(default_factory=dict)  # by data log that is measured again
    on_busy_host: bool = False  # measure although other partitions run there
    lock_timeout_ms: int = 0  # how long to wait for another run, at a host and at a data log
    wall_times: WallTimes = field(default_factory=WallTimes)  # of the settings that this command has run
    held_hosts: Mapping[str, MeasuringHost] = field(default_factory=dict)  # by name; their locks are held

    @property
    def application(self) -> str:
        """The name of the manifest's application."""
        return self.hosts.system.application.name

    def host_of(self, experiment: Experiment) -> MeasuringHost:
        """Return the held host that an experiment is run on."""
        return self.held_hosts[experiment.host.name]


UNMODELLED_SMT = (
    "`smt: true` says which logical processors share a core, and so what partitions take of the host. What is measured "
    "there does not change by it: the simulation runs every logical processor at full speed."
)


@contextmanager
def hold_measuring_hosts(session: MeasuringSession, names: Iterable[str]) -> Iterator[MeasuringSession]:
    """Hold hosts that are measured on, and remove what a killed measurement left there.

    Args:
        session: It holds no host yet; its reporter hears what was removed.
        names: Hosts that can be measured on; a name may be repeated.

    Yields:
        Once, the session with these hosts; they are held until the context ends.

    Raises:
        UseCaseError: A host is held by another run, or has an unfinished run (refused); or what a `HostError` inside
            the context becomes.
    """
    refuse_unfinished(session.hosts, unless=lambda run: bool(part_of_measurement(run)))
    held: dict[str, MeasuringHost] = {}
    with host_errors(), ExitStack() as locks:
        for name in sorted(set(names)):
            host = session.hosts.open_to_measure(name)
            assert host is not None, "only hosts that can be measured on are chosen"
            locks.enter_context(host.lock(owner(), session.lock_timeout_ms))
            finish_stop_or_start(host, session.control.reporter)
            if removed := remove_test_partitions(host):
                message = f"{name}: {' and '.join(removed)}. What the earlier run recorded is kept and used."
                values: Facts = {"host": name, "removed": tuple(removed)}
                finding = measuring_findings.LEFT_BEHIND.at(
                    None, message, "Nothing.", address=f"host/{name}", values=values
                )
                session.control.reporter.findings([finding])
            held[name] = host
            settings = session.hosts.system.hosts[name].settings
            if isinstance(settings, SimulatedHost) and settings.smt:
                session.control.reporter.message(f"{name}: {UNMODELLED_SMT}")
        yield replace(session, held_hosts=held)


def refuse_what_cannot_run(
    session: MeasuringSession,
    host: MeasuringHost,
    *,
    components: Mapping[str, Component] = MappingProxyType({}),
    loads: Mapping[str, Interference] = MappingProxyType({}),
    in_their_partitions: bool = False,
) -> None:
    """Refuse a component or a load that a host cannot run.

    The host would refuse it too; here the line of the manifest can be named, and nothing was changed yet.

    Args:
        loads: By name; they run in test partitions.
        in_their_partitions: Whether the components are to run in those that were applied for them.

    Raises:
        UseCaseError: There is such a component or load (negative).
    """
    manifest = session.hosts.manifest
    named = [("components", name, component) for name, component in components.items()]
    for section, name, subject in [*named, *(("interference", name, load) for name, load in loads.items())]:
        in_its_partition = in_their_partitions and section == "components"
        if obstacle := host.obstacle(subject, in_its_partition=in_its_partition):
            finding = measuring_findings.NOTHING_TO_RUN.at(
                manifest.places.key(section, name),
                f"{host.name} cannot run {name}: {obstacle.reason}.",
                obstacle.advice,
                address=f"{section.removesuffix('s')}/{name}",
                values={"host": host.name, "name": name, "reason": obstacle.reason},
            )
            raise UseCaseError(Outcome.NEGATIVE, [finding], manifest.sources)


def stop_own_partitions(session: MeasuringSession, host: MeasuringHost) -> None:
    """Stop what runs of the application on a held host, if that is consented to.

    Raises:
        UseCaseError: Without consent, or they cannot be stopped (refused or failed).
    """
    names = own_running(host.observe(), session.application)
    if not names:
        return
    if not session.control.consents(host.name, names):
        raise UseCaseError(
            Outcome.REFUSED,
            [
                measuring_findings.BUSY_HOST.of_host(
                    host.name,
                    f"On {host.name} these run, and would change what is measured: {', '.join(names)}.",
                    prose(
                        "Let ",
                        command(session.command, stop_partitions=True),
                        " stop them and start them again afterwards, or do it yourself: ",
                        command("stop"),
                        ", later ",
                        START,
                        ".",
                    ),
                    partitions=names,
                )
            ],
        )
    stop_to_measure(session.hosts, host, names)
    message = f"{host.name}: stopped {in_a_row(names)} to measure. They start again afterwards."
    session.control.reporter.message(message)


@contextmanager
def starting_again(session: MeasuringSession) -> Iterator[list[Diagnostic]]:
    """At the end, start what a measurement stopped on the held hosts: this one, or an earlier one that was killed.

    Args:
        session: Its hosts must still be held at the end. Its reporter hears what was started; after an exception, what
            could not be started, too. A request to stop waits until all are started.

    Yields:
        Once, a list that holds after the end an error for each host where partitions could not be started, and why.
    """
    errors: list[Diagnostic] = []
    try:
        yield errors
    except BaseException:
        session.control.reporter.findings(_start_all(session), session.hosts.manifest.sources)
        raise
    errors += _start_all(session)


def _start_all(session: MeasuringSession) -> list[Diagnostic]:
    errors: list[Diagnostic] = []
    with session.control.stop.gently():
        for host in session.held_hosts.values():
            try:
                names = start_again(session.hosts, host)
            except UseCaseError as error:
                errors += error.findings
                continue
            if names:
                message = f"{host.name}: started {in_a_row(names)} again, which a measurement had stopped."
                session.control.reporter.message(message)
    return errors
