"""Making a plan from what the options say: the manifest, the hosts or their snapshots, and the policy."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rarms_iac.app.data_logs import measured_reservations, measurements_of
from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.hosts import Hosts, observe_hosts
from rarms_iac.app.requests import PlanLimits
from rarms_iac.apply.doctor.examine import DOCTOR_ONLY_CODES
from rarms_iac.apply.goals import FIXED
from rarms_iac.apply.preconditions import NO_RIGHTS
from rarms_iac.apply.prepare import Judge, Request, prepare
from rarms_iac.diff.compare_partitions import NOT_AT_REST
from rarms_iac.manifest.acceptance import apply_acceptances
from rarms_iac.manifest.checks import CODES
from rarms_iac.model.diagnostics import Diagnostic, Severity, in_order
from rarms_iac.model.plan import Plan, Purpose
from rarms_iac.model.state import State
from rarms_iac.planner.reservations import ReservationSource
from rarms_iac.storage.finding_pages import known_codes

_PLANNED_FOR = frozenset(known_codes()) - DOCTOR_ONLY_CODES
"""What a whole plan can find."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """What a plan is wanted for."""

    purpose: Purpose = Purpose.APPLY
    limits: PlanLimits = PlanLimits()
    partition: str = ""
    machine: str = ""
    remove_disks: bool = False


def make_plan(hosts: Hosts, wish: Wish) -> Plan:
    """The plan that brings the chosen hosts where they are wanted.

    Raises:
        UseCaseError: a host cannot be read (1), is busy (3), or the manifest's wish cannot be met (4).
    """
    states = observe_hosts(hosts)
    prepared = prepare(request_of(hosts, wish, states), states)
    if prepared.plan is None:
        outcome, sources = outcome_of(prepared.findings), hosts.manifest.sources
        raise UseCaseError(outcome, prepared.findings, sources)
    return prepared.plan


def request_of(hosts: Hosts, wish: Wish, states: Mapping[str, State]) -> Request:
    """The same as the planner wants to hear it."""
    return Request(
        system=hosts.system,
        places=hosts.manifest.places,
        manifest=hosts.manifest.source.manifest,
        manifest_digest=hosts.manifest.loaded.digest,
        today=hosts.manifest.source.today,
        purpose=wish.purpose,
        max_disruption=wish.limits.max_disruption,
        hosts=hosts.chosen,
        targets=wish.limits.targets,
        partition=wish.partition,
        machine=wish.machine,
        remove_disks=wish.remove_disks,
        state_paths={name: hosts.state_path(name) for name in hosts.system.hosts},
        judge=judge_of(hosts, wish),
        reservations=_reservations(hosts, wish, states),
    )


def _reservations(hosts: Hosts, wish: Wish, states: Mapping[str, State]) -> ReservationSource:
    """What data logs say, for who wants a layout."""
    if wish.purpose is not Purpose.APPLY:
        return FIXED
    return measured_reservations(measurements_of(hosts.manifest), states)


def judge_of(hosts: Hosts, wish: Wish) -> Judge:
    """Adds what the manifest itself is told, and takes out what its policy accepts.

    An acceptance that silenced nothing is only told of where everything was looked at.
    """
    whole = wish.purpose is Purpose.APPLY and not (hosts.selection.hosts or wish.limits.targets)
    codes = _PLANNED_FOR if whole else CODES

    def judge(found: Sequence[Diagnostic]) -> tuple[tuple[Diagnostic, ...], tuple[Diagnostic, ...]]:
        everything = in_order(
            tuple(dict.fromkeys((*hosts.manifest.loaded.diagnostics, *hosts.snapshots.findings, *found)))
        )
        policy, places = hosts.system.policy, hosts.manifest.places
        return apply_acceptances(everything, policy, places, hosts.manifest.source.today, codes=codes)

    return judge


def outcome_of(findings: Sequence[Diagnostic]) -> Outcome:
    """A host that is merely busy may be asked again; everything else is a no, or the host's failure."""
    codes = {finding.code for finding in findings if finding.severity is Severity.ERROR}
    if NO_RIGHTS.code in codes:
        return Outcome.FAILED
    return Outcome.REFUSED if codes == {NOT_AT_REST.code} else Outcome.NEGATIVE
