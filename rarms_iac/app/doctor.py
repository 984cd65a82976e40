"""Examining hosts for what makes a plan ineffective or unsafe there."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

from rarms_iac.app.hosts import Hosts, host_errors, observe_host
from rarms_iac.applying.doctor import examine
from rarms_iac.applying.doctor.examination import Examination
from rarms_iac.applying.shared_machines import hosts_of_one_machine
from rarms_iac.manifest.acceptance import apply_acceptances
from rarms_iac.model.condition import HostCondition
from rarms_iac.model.diagnostics import Diagnostic, count_severities, in_order
from rarms_iac.model.output import Internal, output
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import HostFacts, Partition
from rarms_iac.planner.layout import smaller_host_findings
from rarms_iac.providers.interface import ExaminableHost, ObservedHost


@dataclass(frozen=True, slots=True, kw_only=True)
class ExaminedHost:
    """A host as it was looked at, and what was found there."""

    facts: HostFacts
    condition: HostCondition
    memory_left: int | None  # bytes that machines can still have
    machines: int  # on the host
    managed: int  # of these, the application's
    running: int  # of all of them
    findings: tuple[Diagnostic, ...]
    partitions: Internal[tuple[Partition, ...]]  # all of its machines


@dataclass(frozen=True, slots=True, kw_only=True)
class Examinations:
    """All chosen hosts, by name, and what the policy accepts of the findings."""

    kind: Literal["doctor"] = "doctor"
    application: str
    hosts: tuple[ExaminedHost, ...]
    accepted: tuple[Diagnostic, ...]

    @output
    def counts(self) -> Mapping[str, int]:
        """Findings by how much they weigh."""
        return count_severities(self.findings)

    @property
    def findings(self) -> tuple[Diagnostic, ...]:
        """Those of all hosts that are not accepted, in order."""
        return in_order([finding for host in self.hosts for finding in host.findings])


def examine_hosts(hosts: Hosts) -> Examinations:
    """Look at every chosen host once, live or in its snapshot. Only reads.

    Args:
        hosts: the chosen ones; others are not looked at.

    Returns:
        What was seen of each host in name order, with the findings.

    Raises:
        UseCaseError: a host cannot be reached or read (failed).
    """
    manifest, application = hosts.manifest, hosts.system.application.name
    examined: list[ExaminedHost] = []
    accepted: list[Diagnostic] = []
    examinations = tuple(_examinations(hosts))
    states = {host.name: host.state for host in examinations}
    shared = tuple(hosts_of_one_machine(hosts.system, states, manifest.places))
    for host in examinations:
        facts = host.state.facts
        findings, silenced = apply_acceptances(
            [
                *(finding for finding in shared if finding.address == f"host/{host.name}"),
                *smaller_host_findings(
                    SeenHost(host=hosts.system.hosts[facts.name], application=application, state=host.state),
                    manifest.places,
                ),
                *examine(host),
            ],
            manifest.system.policy,
            manifest.places,
            manifest.source.today,
            codes=(),  # an acceptance that silences nothing here may be needed by a plan
        )
        machines = host.state.partitions
        examined.append(
            ExaminedHost(
                facts=facts,
                condition=host.condition,
                memory_left=host.state.memory_left,
                machines=len(machines),
                managed=len(host.state.of(application).partitions),
                running=sum(machine.settings.running for machine in machines),
                findings=findings,
                partitions=machines,
            )
        )
        accepted += silenced
    return Examinations(application=application, hosts=tuple(examined), accepted=tuple(accepted))


def _examinations(hosts: Hosts) -> Iterator[Examination]:
    for name in hosts.chosen:
        looked = _observe(hosts, name)
        yield Examination(
            state=looked.state,
            condition=looked.condition,
            provider_findings=looked.findings,
            place=hosts.manifest.places.key("hosts", name),
        )


def _observe(hosts: Hosts, name: str) -> ObservedHost:
    snapshot = hosts.snapshots.hosts.get(name)
    if snapshot is not None:
        return ObservedHost(state=snapshot.state, condition=snapshot.condition, findings=snapshot.findings)
    host = hosts.open(name)
    if isinstance(host, ExaminableHost):
        with host_errors():
            return host.examined()
    return ObservedHost(state=observe_host(host), condition=HostCondition(), findings=())
