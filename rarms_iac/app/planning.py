"""Making a plan: from a manifest, its hosts or their snapshots, its data logs and its policy."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from rarms_iac.app.data_logs import measured_reservations
from rarms_iac.app.hosts import Hosts, last_run, last_runs, observe_hosts, refuse_unfinished
from rarms_iac.app.plan_files import plan_key
from rarms_iac.app.requests import PlanLimits, refuse_unknown
from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError
from rarms_iac.applying.make_plan import make_plan
from rarms_iac.applying.plan_request import PlanRequest, findings_of_manifest
from rarms_iac.applying.preconditions import NO_RIGHTS
from rarms_iac.diff.compare import NOT_AT_REST
from rarms_iac.diff.drift import partitions_after_last_run
from rarms_iac.model.changes import Address
from rarms_iac.model.diagnostics import Diagnostic, Severity
from rarms_iac.model.host import SimulatedHost
from rarms_iac.model.journal import Journal
from rarms_iac.model.plan import Plan, Purpose
from rarms_iac.model.state import State
from rarms_iac.planner.groups import groups_of
from rarms_iac.storage.plan_file import signed
from rarms_iac.texts.messages import in_a_row

NO_LIMITS = PlanLimits()


def plan_request(hosts: Hosts, limits: PlanLimits = NO_LIMITS) -> PlanRequest:
    """Ask for all that the manifest wants of the chosen hosts; `dataclasses.replace` asks for something else.

    Args:
        limits: how far the plan may go.

    Returns:
        The request; nothing is looked at yet.
    """
    return PlanRequest(
        system=hosts.system,
        places=hosts.manifest.places,
        manifest=hosts.manifest.source.manifest,
        overlays=hosts.manifest.source.overlays,
        manifest_digest=hosts.manifest.loaded.digest,
        texts=hosts.manifest.loaded.texts_without_secrets(),
        today=hosts.manifest.source.today,
        max_disruption=limits.max_disruption,
        hosts=hosts.chosen,
        targets=limits.targets,
        state_paths={
            name: hosts.state_path(name)
            for name, host in hosts.system.hosts.items()
            if isinstance(host.settings, SimulatedHost)
        },
        findings=findings_of_manifest(hosts.manifest.loaded),
        snapshot_findings=hosts.snapshots.findings,
    )


def plan(hosts: Hosts, request: PlanRequest | None = None) -> Plan:
    """Work out what would change on the chosen hosts. Changes nothing.

    Args:
        hosts: the manifest, with hosts that are looked at live or in their snapshots; those that are not chosen are
            looked at where they can be reached, since the planner may need to know what they have room for.
        request: what it is for, and how far it may go, made of `plan_request`; None: all that the manifest asks for.

    Returns:
        A plan that `applying.apply` can do, or that `plan_files.write_plan_file` writes; it may have no changes.

    Raises:
        UseCaseError: a host cannot be read (failed), is busy or has an unfinished run (refused), or what the manifest
            asks for cannot be had (negative).
    """
    hosts = hosts.with_one_look()
    refuse_unfinished(hosts)
    states = observe_hosts(hosts)
    application = hosts.system.application.name

    def after_last_run(host: str) -> frozenset[str] | None:
        is_live = host not in hosts.snapshots.hosts
        return partitions_after_last_run(last_run(hosts, host), application) if is_live else None

    request = replace(request or plan_request(hosts), after_last_run=after_last_run)
    if request.purpose is Purpose.DESTROY and request.targets:
        request = replace(request, gone=_destroyed(hosts))
    return plan_from_states(hosts, request, states)


def _destroyed(hosts: Hosts) -> frozenset[str]:
    """Return the addresses that a destroy removes: the manifest's, and those that the last runs changed."""
    named = {Address(partition=group.name) for group in groups_of(hosts.system)}
    named |= {Address(task=name) for name in hosts.system.tasks}
    for _, run in last_runs(hosts):
        if isinstance(run, Journal) and run.started.application == hosts.system.application.name:
            named |= {change.address for change in run.started.host_plan.changes}
    return frozenset(map(str, named))


def plan_from_states(hosts: Hosts, request: PlanRequest, states: Mapping[str, State]) -> Plan:
    """Make the plan for hosts that were looked at.

    Args:
        states: what the hosts look like, by name; data logs are held against it.

    Returns:
        The plan; it may have no changes. Where a key is set, it is signed.

    Raises:
        UseCaseError: the manifest cannot be planned (as `outcome_of`).
        RequestError: the key is not as it must be.
    """
    key = plan_key()
    prepared = make_plan(with_reservations(hosts, request, states), states)
    if prepared.plan is None:
        raise UseCaseError(outcome_of(prepared.findings), prepared.findings, hosts.manifest.sources)
    return prepared.plan if key is None else signed(prepared.plan, key)


def with_reservations(hosts: Hosts, request: PlanRequest, states: Mapping[str, State]) -> PlanRequest:
    """Return the request with the reservations of data logs, where a layout is wanted."""
    if request.purpose is not Purpose.APPLY:
        return request
    return replace(request, reservations=measured_reservations(hosts.manifest, states))


def hosts_with_machine(hosts: Hosts, machine: str) -> Hosts:
    """Return the host that has the machine with this id; a single chosen host is not looked at.

    Args:
        machine: its id, in any case of letters.

    Returns:
        The same with that host alone.

    Raises:
        RequestError: several hosts are chosen, and not exactly one has it.
        UseCaseError: a host cannot be read (failed).
    """
    if len(hosts.chosen) == 1:
        return hosts
    states = observe_hosts(hosts)
    names = [
        name
        for name in hosts.chosen
        if any(partition.id.lower() == machine.lower() for partition in states[name].partitions)
    ]
    if len(names) != 1:
        where = f"on {in_a_row(names)}" if names else f"not on any of these hosts: {', '.join(hosts.chosen)}"
        raise RequestError(f"The machine {machine} is {where}. Choose one host with --host.")
    return hosts.only(*names)


def hosts_with_partition(hosts: Hosts, partition: str) -> Hosts:
    """Return the host on which the partition carries the application's mark, or where a killed run has taken it off.

    Returns:
        The same with that host alone.

    Raises:
        RequestError: no host, or several hosts have it.
        UseCaseError: a host cannot be read (failed).
    """
    states = observe_hosts(hosts)
    application = hosts.system.application.name
    names = [
        name
        for name in hosts.chosen
        if any(vm.mark and vm.mark.name == partition for vm in states[name].of(application).partitions)
    ]
    names = names or [
        name
        for name in hosts.chosen
        if any(vm.mark is None and vm.settings.name == partition for vm in states[name].partitions)
    ]
    if len(names) > 1:
        raise RequestError(f"{partition} is on {in_a_row(names)}. Choose one with --host.")
    if not names:
        refuse_unknown_partitions(hosts, [partition])
    return hosts.only(*names)


def refuse_unknown_partitions(hosts: Hosts, names: Sequence[str]) -> None:
    """Refuse names of partitions that no chosen host has with the application's mark.

    Raises:
        RequestError: One is on none of them; the message offers the nearest.
        UseCaseError: A host cannot be read (failed).
    """
    if not names:
        return
    states, application = observe_hosts(hosts), hosts.system.application.name
    marks = [vm.mark for name in hosts.chosen for vm in states[name].of(application).partitions]
    present = sorted({mark.name for mark in marks if mark is not None})
    refuse_unknown(names, present, "partition", f"On {in_a_row(hosts.chosen)}, {application}")


def outcome_of(findings: Sequence[Diagnostic]) -> Outcome:
    """Decide how a use case ends by its findings.

    Args:
        findings: in any order; only errors count.

    Returns:
        Failed where rights are missing; refused where the only error is a host that is busy, since the same may be
            asked again later; negative otherwise.
    """
    codes = {finding.code for finding in findings if finding.severity is Severity.ERROR}
    if NO_RIGHTS.code in codes:
        return Outcome.FAILED
    return Outcome.REFUSED if codes == {NOT_AT_REST.code} else Outcome.NEGATIVE
