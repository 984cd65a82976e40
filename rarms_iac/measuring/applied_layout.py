"""What is applied: finds what of the manifest runs on hosts, and refuses what cannot be proven."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any

from rarms_iac.app.hosts import Hosts, observe_host
from rarms_iac.app.planning import plan_from_states, plan_request
from rarms_iac.app.requests import PlanLimits
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.applying.desired_hosts import totals_after
from rarms_iac.measuring import findings
from rarms_iac.measuring.proof import AppliedLayout
from rarms_iac.model.commands import APPLY, PLAN, command, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.quantities import guaranteed
from rarms_iac.model.state import State
from rarms_iac.model.system import Component, Disruption, RunsOn
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.mechanism import deadline_period_us


def applied_layouts(
    hosts: Hosts, states: Mapping[str, State], everywhere: Mapping[str, State]
) -> dict[str, AppliedLayout]:
    """Return by host what of the manifest runs there.

    Args:
        everywhere: Those states, and those of other hosts that could be reached.

    Returns:
        Layouts by host name; a host on which nothing of the manifest runs has none.

    Raises:
        UseCaseError: A partition is on no host, or does not run (refused).
    """
    system = hosts.system
    application = system.application.name
    running = {
        partition.mark.name: name
        for name, state in everywhere.items()
        for partition in state.of(application).partitions
        if partition.mark and partition.settings.running
    }
    groups = groups_of(system)
    _refuse_off(everywhere, application, {group.name for group in groups})
    if absent := [group.name for group in groups if group.name not in running]:
        message = f"These partitions do not exist on any host: {', '.join(absent)}."
        raise UseCaseError(
            Outcome.REFUSED, [_not_applied(message, f"partition/{absent[0]}", {"partitions": tuple(absent)})]
        )
    layouts = {
        name: _layout_on(hosts, name, states, [group for group in groups if running[group.name] == name])
        for name in sorted(states)
    }
    return {name: layout for name, layout in layouts.items() if layout is not None}


def _layout_on(hosts: Hosts, name: str, states: Mapping[str, State], groups: Sequence[Group]) -> AppliedLayout | None:
    """Return the layout of a host: these groups, and its own components; None where there are neither."""
    system, host = hosts.system, hosts.system.hosts[name]
    on_host = tuple(_host_components(hosts, name, tuple(sorted(states))))
    if not groups and not on_host:
        return None
    running = {
        partition.shown_name: partition.settings
        for partition in states[name].of(system.application.name).partitions
        if partition.settings.running
    }
    reserves = {partition: guaranteed(each.reserve, each.processors) for partition, each in running.items()}
    periods = {group.name: deadline_period_us(group, host) for group in groups}
    return AppliedLayout(
        application=system.application.name,
        host_processors=host.logical_processors,
        reserved=totals_after(states[name], system.application.name, (), ()).reserved_lp,
        partitions={group.name: group.members for group in groups},
        reserves={partition: float(processors) for partition, processors in reserves.items()},
        processors={partition: each.processors for partition, each in running.items()},
        on_host=on_host,
        tasks=system.tasks,
        deadline_periods_us={group: period for group, period in periods.items() if period is not None},
    )


def _refuse_off(states: Mapping[str, State], application: str, wanted: Collection[str]) -> None:
    """Refuse wanted partitions that are there and do not run, before a plan is named, which need not start them.

    Raises:
        UseCaseError: There are some (refused).
    """
    off = sorted(
        partition.mark.name
        for state in states.values()
        for partition in state.of(application).partitions
        if partition.mark and partition.mark.name in wanted and not partition.settings.running
    )
    if off:
        advice = prose("Start them: ", command("start", *off), ". Then run the same command again.")
        finding = findings.NOT_APPLIED.at(
            None,
            "These partitions are not running: {partitions:each}.",
            advice,
            address=f"partition/{off[0]}",
            partitions=tuple(off),
        )
        raise UseCaseError(Outcome.REFUSED, [finding])


def observe_others(hosts: Hosts, measurable: tuple[str, ...]) -> dict[str, State]:
    """Observe the hosts that are not measurable, where they can be reached: their partitions are not missing either.

    Args:
        measurable: names of those that can run components.

    Returns:
        States by name, of all others that answered.
    """
    states: dict[str, State] = {}
    for name in sorted(set(hosts.system.hosts) - set(measurable)):
        with suppress(UseCaseError):
            states[name] = observe_host(hosts.open(name))
    return states


def refuse_unapplied(hosts: Hosts, states: Mapping[str, State], everywhere: Mapping[str, State]) -> None:
    """Refuse hosts that a plan would change: only what manifest and data logs say now can be proven.

    Args:
        everywhere: those states, and those of other hosts that could be reached.

    Raises:
        UseCaseError: A plan would change something (refused), or the manifest cannot be planned (as `outcome_of`).
    """
    limits = PlanLimits(max_disruption=Disruption.REMOVAL)  # so that no change is held back and goes unseen
    plan = plan_from_states(hosts, plan_request(hosts.only(*sorted(states)), limits), everywhere)
    pending = [(str(change.address), part.host.name) for part in plan.hosts for change in part.changes]
    if pending:
        places = tuple(f"{address} on {host}" for address, host in pending)
        message = f"Changes of the manifest are not applied yet: {', '.join(places)}."
        raise UseCaseError(Outcome.REFUSED, [_not_applied(message, pending[0][0], {"pending": places})])


def _host_components(hosts: Hosts, name: str, measurable: tuple[str, ...]) -> Iterator[Component]:
    """Yield the components of the host's own operating system; one that is allowed on several hosts is on the first."""
    for component in hosts.system.components.values():
        allowed = [each for each in measurable if component.may_run_on(each)]
        if component.runs_on is RunsOn.HOST and allowed[:1] == [name]:
            yield component


def _not_applied(message: str, address: str, values: dict[str, Any]) -> Diagnostic:
    advice = prose("Show the changes with ", PLAN, ", and apply them with ", APPLY, ".")
    return findings.NOT_APPLIED.at(None, "{_message}", advice, address=address, _message=message, **values)
