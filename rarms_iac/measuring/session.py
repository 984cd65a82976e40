"""A session of measuring: the hosts that one command holds, and what cannot run on them."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from rarms_iac.app.control import UNATTENDED, Control
from rarms_iac.app.decision_logs import record_choices
from rarms_iac.app.hosts import Hosts, host_errors, refuse_unfinished
from rarms_iac.app.manifests import Manifest, start_warnings
from rarms_iac.app.measurement_files import log_errors
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.applying import refusals
from rarms_iac.measuring.duration import Announced, WallTimes, nothing_announced
from rarms_iac.measuring.exec_processes import refuse_running
from rarms_iac.measuring.findings import UNABLE
from rarms_iac.measuring.partitions import remove_test_partitions
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.host import Host, ProviderKind, SimulatedHost
from rarms_iac.model.loads import Interference
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.system import Component
from rarms_iac.providers.measuring import MeasuringHost, StepwiseMeasuringHost
from rarms_iac.storage.datalog.log import Remeasurement
from rarms_iac.storage.writing import owner


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuringSession:
    """The hosts and the control of a command that measures."""

    hosts: Hosts
    control: Control = UNATTENDED
    command: Literal["measure", "tune", "prove"] = "measure"
    seed: int | None = None  # of the random numbers; None: the largest that settings in the log have, or the usual one
    remeasurements: Mapping[Path, Remeasurement] = field(default_factory=dict)  # by data log that is measured again
    on_busy_host: bool = False  # measure although other partitions run there
    lock_timeout_ms: int = 0  # how long to wait for another run, at a host and at a data log
    wall_times: WallTimes = field(default_factory=WallTimes)  # of the settings that this command has run
    announced: Announced = field(default_factory=nothing_announced)  # for all settings of the command
    recorded: set[tuple[Path, ReservePercent]] = field(default_factory=set)  # settings that this command ran, by log
    held_hosts: Mapping[str, MeasuringHost] = field(default_factory=dict)  # by name; their locks are held

    @property
    def application(self) -> str:
        """The name of the manifest's application."""
        return self.hosts.system.application.name

    def host_of(self, experiment: Experiment) -> MeasuringHost:
        """Return the held host that an experiment is run on."""
        return self.held_hosts[experiment.host.name]


UNMODELLED_SMT = (
    "`smt: true` changes the number of logical processors of a partition, but not its measurements. The "
    "simulation runs every logical processor at full speed."
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
    refuse_unfinished(session.hosts)
    held: dict[str, MeasuringHost] = {}
    with host_errors(), ExitStack() as locks:
        for name in sorted(set(names)):
            host = session.hosts.open_to_measure(name)
            assert host is not None, "only hosts that can be measured on are chosen"
            locks.enter_context(host.lock(owner(), session.lock_timeout_ms))
            # A run may have begun, and been killed, while the lock was waited for.
            if isinstance(host, StepwiseMeasuringHost) and (run := host.unfinished()) is not None:
                raise UseCaseError(Outcome.REFUSED, [refusals.unfinished(name, run)])
            if removed := remove_test_partitions(host):
                session.control.reporter.message(
                    f"{name}: {' and '.join(removed)}. rarms keeps and uses earlier results."
                )
            held[name] = host
            settings = session.hosts.system.hosts[name].settings
            if isinstance(settings, SimulatedHost) and settings.smt:
                session.control.reporter.message(f"{name}: {UNMODELLED_SMT}")
        yield replace(session, held_hosts=held)


def start_warnings_of(manifest: Manifest, started: Iterable[tuple[Host, str]]) -> tuple[Diagnostic, ...]:
    """Return the warnings about components that run as processes: those of no simulated host.

    Args:
        started: Hosts with the names of the components that run on them.
    """
    names = dict.fromkeys(name for host, name in started if host.provider is not ProviderKind.SIMULATED)
    return start_warnings(manifest, [manifest.system.components[name] for name in names])


def no_measurable_host(hosts: Hosts, advice: str) -> UseCaseError:
    """Make the error that rarms can run components on none of the chosen hosts (failed)."""
    template, names = "rarms cannot run components on these hosts: {_names}.", ", ".join(hosts.chosen)
    chosen = tuple(hosts.chosen)
    return UseCaseError(Outcome.FAILED, [UNABLE.at(None, template, advice, hosts=chosen, _names=names or "none")])


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
        UseCaseError: There is such a component or load (negative), or a component runs already (failed).
    """
    manifest = session.hosts.manifest
    if manifest.system.hosts[host.name].provider is ProviderKind.LINUX:
        refuse_running(manifest, components)
    named = [("components", name, component) for name, component in components.items()]
    for section, name, subject in [*named, *(("interference", name, load) for name, load in loads.items())]:
        in_its_partition = in_their_partitions and section == "components"
        if obstacle := host.obstacle(subject, in_its_partition=in_its_partition):
            finding = UNABLE.at(
                manifest.places.key(section, name),
                "{host} cannot run {name}: {reason}.",
                obstacle.advice,
                address=f"{section.removesuffix('s')}/{name}",
                host=host.name,
                name=name,
                reason=obstacle.reason,
            )
            raise UseCaseError(Outcome.NEGATIVE, [finding], manifest.sources)


def record_reservations(hosts: Hosts) -> None:
    """Write the reservations that follow from the data logs now into the configuration logs.

    Args:
        hosts: those of the manifest, which is read again.

    Raises:
        UseCaseError: One of them is damaged (negative), or held by another run (refused).
    """
    with log_errors():
        record_choices(hosts.reloaded().manifest)  # a level may have been chosen meanwhile
