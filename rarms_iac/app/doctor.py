"""Examining hosts for what makes a plan ineffective or unsafe there."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from rarms_iac.app.hosts import Hosts, host_errors, observe_host
from rarms_iac.applying.doctor import examine
from rarms_iac.applying.shared_machines import hosts_of_one_machine
from rarms_iac.manifest.acceptance import apply_acceptances
from rarms_iac.model.diagnostics import Diagnostic, count_severities, in_order
from rarms_iac.model.output import output
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.planner.layout import smaller_host_findings
from rarms_iac.providers.interface import ExaminableHost


@dataclass(frozen=True, slots=True, kw_only=True)
class Examinations:
    """All chosen hosts, by name, and what the policy accepts of the findings."""

    kind: Literal["doctor"] = "doctor"
    application: str
    hosts: tuple[SeenHost, ...]  # with the findings of its checks
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
    manifest = hosts.manifest
    examined: list[SeenHost] = []
    accepted: list[Diagnostic] = []
    looked_at = tuple(_look(hosts, name) for name in hosts.chosen)
    shared = tuple(hosts_of_one_machine(hosts.system, {seen.name: seen.state for seen in looked_at}, manifest.places))
    for seen in looked_at:
        findings, silenced = apply_acceptances(
            [
                *(finding for finding in shared if finding.address == f"host/{seen.name}"),
                *smaller_host_findings(seen, manifest.places),
                *examine(seen, manifest.places.key("hosts", seen.name)),
            ],
            manifest.system.policy,
            manifest.places,
            manifest.source.today,
            codes=(),  # an acceptance that silences nothing here may be needed by a plan
        )
        examined.append(replace(seen, findings=findings))
        accepted += silenced
    return Examinations(application=hosts.system.application.name, hosts=tuple(examined), accepted=tuple(accepted))


def _look(hosts: Hosts, name: str) -> SeenHost:
    """Look at a host, or at its snapshot."""
    described, application = hosts.system.hosts[name], hosts.system.application.name
    snapshot = hosts.snapshots.hosts.get(name)
    if snapshot is not None:
        return SeenHost(
            host=described,
            application=application,
            state=snapshot.state,
            condition=snapshot.condition,
            findings=snapshot.findings,
        )
    host = hosts.open(name)
    if isinstance(host, ExaminableHost):
        with host_errors():
            return host.examined(application)
    return SeenHost(host=described, application=application, state=observe_host(host))
