"""Examining hosts for what makes a plan ineffective or unsafe there, and a report of that without a name or a secret.

The report is a file to be sent with an issue (docs/windows-first-hour.md). Every value in it is a number, a truth, a
word of ours or a version: no text of a host or a manifest comes through.
"""

import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from enum import Enum
from typing import Literal

from rarms_iac.app.data_logs import measured_reservations
from rarms_iac.app.hosts import Hosts, host_errors
from rarms_iac.applying.doctor import examine
from rarms_iac.applying.preconditions import hosts_of_one_machine
from rarms_iac.manifest.acceptance import apply_acceptances
from rarms_iac.model.diagnostics import Diagnostic, count_severities, in_order
from rarms_iac.model.host import Connect, ProviderKind, WinRmConnect
from rarms_iac.model.layout import LookedUp
from rarms_iac.model.output import output
from rarms_iac.model.seen_host import Condition, PolicyScope, SeenHost
from rarms_iac.model.state import HostFacts, RunState, Tie
from rarms_iac.model.system import System
from rarms_iac.model.version import __version__
from rarms_iac.planner.groups import groups_of
from rarms_iac.planner.layout import smaller_host_findings
from rarms_iac.planner.layout_findings import other_governor
from rarms_iac.planner.reservations import MeasuredReservations, depends_on_a_log, names_of
from rarms_iac.running.environment import refuse_unknown_user
from rarms_iac.running.orders import CannotStart
from rarms_iac.texts.findings import CANNOT_RUN


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
    reservations = measured_reservations(manifest, {seen.name: seen.state for seen in looked_at})
    shared = tuple(hosts_of_one_machine(hosts.system, {seen.name: seen.state for seen in looked_at}, manifest.places))
    for seen in looked_at:
        findings, silenced = apply_acceptances(
            [
                *(finding for finding in shared if finding.address == f"host/{seen.name}"),
                *smaller_host_findings(seen, manifest.places),
                *other_governor(seen, _measured_for(seen, hosts.system, reservations), manifest.places),
                *_missing_users(hosts, seen),
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


def _missing_users(hosts: Hosts, seen: SeenHost) -> Iterator[Diagnostic]:
    """Find users and groups of components that may run on this machine and that it does not have."""
    is_here = seen.host.provider is ProviderKind.LINUX and _connection(hosts, seen.name) == "here"
    if not is_here or sys.platform != "linux":
        return
    for member in (
        member for group in groups_of(hosts.system) if group.may_run_on(seen.name) for member in group.members
    ):
        try:
            for process in member.run.each_process.values() if member.run else ():
                refuse_unknown_user(member.name, process)
        except CannotStart as problem:
            yield CANNOT_RUN.at(
                hosts.manifest.places.key("components", member.name, "run"),
                "{component} cannot run on {host}: {reason}.",
                problem.advice,
                address=f"host/{seen.name}",
                component=member.name,
                host=seen.name,
                reason=problem.message,
            )


def _measured_for(
    seen: SeenHost, system: System, reservations: MeasuredReservations
) -> Sequence[tuple[tuple[str, ...], LookedUp]]:
    """Return what data logs say of the partitions that may run on a host."""
    groups = [group for group in groups_of(system) if depends_on_a_log(group) and group.may_run_on(seen.name)]
    answers = [(names_of(group.members), reservations.look_up(group.members, seen.host)) for group in groups]
    return [(names, answer) for names, answer in answers if isinstance(answer, LookedUp)]


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
    with host_errors():
        return hosts.open(name).examined(application)


_VERSION = re.compile(r"[0-9]{1,6}(\.[0-9]{1,6}){1,3}(-(preview|rc)\.?[0-9]{0,3})?", re.ASCII)

ExecutionPolicy = Literal["AllSigned", "Bypass", "Default", "RemoteSigned", "Restricted", "Undefined", "Unrestricted"]
_POLICIES: Mapping[str, ExecutionPolicy] = {
    "allsigned": "AllSigned",
    "bypass": "Bypass",
    "default": "Default",
    "remotesigned": "RemoteSigned",
    "restricted": "Restricted",
    "undefined": "Undefined",
    "unrestricted": "Unrestricted",
}

Connection = Literal["snapshot", "here", "ssh", "winrm"]


Known = str | bool | int | None
"""A number, a truth or a word of ours; never a text of a host."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HostSummary:
    """A host as it was looked at; null: it could not be asked, or is not such a host."""

    connection: Connection
    seen: Mapping[str, Known]  # of its facts and its condition, by the names of their fields
    memory_left: int | None  # bytes that machines can still have
    powershell: str | None  # version
    module: tuple[str, ...] | None  # versions of the Hyper-V module
    policies: Mapping[PolicyScope, ExecutionPolicy]
    responsiveness: int | None  # SystemResponsiveness, where it is set to a number
    unread: int  # questions and machines that had no answer
    machines: Mapping[str, int]  # how many, of each sort
    states: Mapping[RunState, int]  # of machines
    ties: Mapping[Tie, int]
    findings: Mapping[str, int]  # how many of each code


@dataclass(frozen=True, slots=True, kw_only=True)
class DoctorReport:
    """All chosen hosts in the order of their names, which are not here."""

    kind: Literal["doctor_report"] = "doctor_report"
    rarms: str  # version
    python: str  # version
    system: str  # that rarms runs on: linux, win32
    hosts: tuple[HostSummary, ...]
    accepted: Mapping[str, int]  # findings that the manifest accepts, of each code


def report_examinations(hosts: Hosts, examined: Examinations) -> DoctorReport:
    """Keep the parts of an examination that do not show whose it is.

    Returns:
        Numbers, versions and words of ours; text that a host or a manifest says is left out.
    """
    return DoctorReport(
        rarms=__version__,
        python=".".join(map(str, sys.version_info[:3])),
        system=sys.platform,
        hosts=tuple(_host_summary(host, _connection(hosts, host.name)) for host in examined.hosts),
        accepted=_by_code(examined.accepted),
    )


def _host_summary(host: SeenHost, connection: Connection) -> HostSummary:
    condition, machines = host.condition, host.state.partitions
    responsiveness = condition.responsiveness.data if condition.responsiveness else None
    return HostSummary(
        connection=connection,
        seen={**_without_texts(host.facts), **_without_texts(condition)},
        memory_left=host.memory_left,
        powershell=next(_versions([condition.powershell or ""]), None),
        module=None if condition.module is None else tuple(_versions(condition.module)),
        policies=dict(_policies(condition.policies)),
        responsiveness=responsiveness if isinstance(responsiveness, int) else None,
        unread=len(condition.unread),
        machines=_machines(host),
        states=Counter(machine.state for machine in machines),
        ties=Counter(tie for machine in machines for tie in machine.ties),
        findings=_by_code(host.findings),
    )


def _without_texts(value: HostFacts | Condition) -> Mapping[str, Known]:
    """Return the fields that are a number, a truth or a word of ours: a text that is not of an enumeration is none."""
    named = {part.name: getattr(value, part.name) for part in fields(value)}
    return {
        name: each.value if isinstance(each, Enum) else each
        for name, each in named.items()
        if isinstance(each, Enum | bool | int)
    }


def _connection(hosts: Hosts, name: str) -> Connection:
    if name in hosts.snapshots.hosts:
        return "snapshot"
    match hosts.system.hosts[name].connect:
        case None:
            return "here"
        case Connect():
            return "ssh"
        case WinRmConnect():
            return "winrm"


def _machines(host: SeenHost) -> Mapping[str, int]:
    machines = host.state.partitions
    not_believed = [machine for machine in machines if machine.foreign_mark]
    return {
        "all": host.machines,
        "managed": host.managed,
        "running": host.running,
        "marks_not_believed": len(not_believed),  # with a line of ours in their notes that does not count
        "marked_replicas": sum(Tie.REPLICA in machine.ties for machine in not_believed),  # with a primary's notes
        "mute": sum(machine.state is RunState.RUNNING and not machine.can_be_asked for machine in machines),
    }


def _by_code(findings: Iterable[Diagnostic]) -> Mapping[str, int]:
    return dict(sorted(Counter(finding.code for finding in findings).items()))


def _policies(policies: Mapping[PolicyScope, str]) -> Iterator[tuple[PolicyScope, ExecutionPolicy]]:
    for scope, policy in policies.items():
        if known := _POLICIES.get(policy.lower()):
            yield scope, known


def _versions(texts: Iterable[str]) -> Iterator[str]:
    """Select the version numbers; other texts may be names."""
    return (text for text in texts if _VERSION.fullmatch(text))
