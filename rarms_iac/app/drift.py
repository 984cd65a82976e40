"""Drift: which resources differ from the last apply, and whether the host or the manifest changed since."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from rarms_iac.app.compared_host import ComparedHost
from rarms_iac.app.hosts import Hosts, last_runs, observe_hosts
from rarms_iac.app.planning import outcome_of, plan_request, with_reservations
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.applying.desired_hosts import desired_hosts
from rarms_iac.applying.make_plan import make_plan
from rarms_iac.applying.plan_request import PlanRequest
from rarms_iac.diff.drift import ResourceDrift, drift, drift_of_marks, partitions_after_last_run, without_unfinished
from rarms_iac.model.commands import APPLY, PLAN, RecommendedCommand
from rarms_iac.model.diagnostics import Diagnostic, has_errors
from rarms_iac.model.journal import Journal, ScriptRun, history_of
from rarms_iac.model.output import output
from rarms_iac.model.plan import HostPlan
from rarms_iac.model.seen_host import seen_hosts
from rarms_iac.model.state import State
from rarms_iac.model.system import Disruption


def drift_of_hosts(
    request: PlanRequest, observed: Mapping[str, State], runs: Mapping[str, Journal | ScriptRun | None]
) -> tuple[Mapping[str, tuple[ResourceDrift, ...]], tuple[Diagnostic, ...]]:
    """Find the drift of every observed host.

    Args:
        request: what the manifest asks for, how far its layout may disturb, and whether to search for ways out.
        observed: the hosts by name.
        runs: the last run of each live host; None: there was none.

    Returns:
        The drift by host name, and the findings that keep the manifest from being compared: without a layout it is
        unknown what is wanted, and only what was changed on the hosts is told. With one, those of hosts that fail.
    """
    hosts, findings = desired_hosts(request, observed)
    application = request.application
    present = {name: partitions_after_last_run(run, application) for name, run in runs.items()}
    if hosts:
        findings = tuple(finding for finding in findings if outcome_of((finding,)) is Outcome.FAILED)
        drifts = {
            name: drift(desired.state, desired.observed, application, desired.unused, present.get(name))
            for name, desired in hosts.items()
        }
    else:
        drifts = {name: drift_of_marks(state, application, present.get(name)) for name, state in observed.items()}
    return {name: without_unfinished(found, runs.get(name), application) for name, found in drifts.items()}, findings


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftReport:
    """The drift of all chosen hosts, by name, and the plans of runs that are unfinished there, by host."""

    kind: Literal["drift"] = "drift"
    application: str
    hosts: tuple[ComparedHost, ...]
    unfinished: Mapping[str, str]
    problems: tuple[Diagnostic, ...] = ()  # why it is not known what the manifest wants; empty: it is compared

    @output
    def commands(self) -> tuple[RecommendedCommand, ...]:
        """What finishes the runs that are unfinished, and what shows how to make hosts as the manifest wants them."""
        differs = any(host.host_changed or host.not_applied for host in self.hosts)
        looks = self.problems or (differs and not self.unfinished)
        return (*((APPLY,) if self.unfinished else ()), *((PLAN,) if looks else ()))


def look_for_drift(hosts: Hosts, *, explain: bool = False) -> DriftReport:
    """Compare the chosen hosts with the manifest and with what the last apply left. Only reads.

    Args:
        hosts: the chosen ones are compared; others are looked at where they can be reached, as for a plan.
        explain: as of `plan_layout`.

    Returns:
        The differences by host in name order, and which runs are unfinished.

    Raises:
        UseCaseError: a host cannot be read, or hides what is there (failed).
    """
    system, hosts = hosts.system, hosts.with_one_look()
    states = observe_hosts(hosts)
    runs = dict(last_runs(hosts))
    request = replace(with_reservations(hosts, plan_request(hosts), states), explain=explain)
    drifts, problems = drift_of_hosts(request, states, runs)
    if outcome_of(problems) is Outcome.FAILED:
        raise UseCaseError(Outcome.FAILED, problems, hosts.manifest.sources)
    # Nothing is held back, so that every difference has the change that shows it attribute by attribute.
    plan = make_plan(replace(request, max_disruption=Disruption.REMOVAL, explain=False), states).plan
    parts = {part.host.name: part for part in plan.hosts} if plan else {}
    seen = seen_hosts(system.hosts, system.application.name, states)
    return DriftReport(
        application=system.application.name,
        hosts=tuple(
            ComparedHost(
                seen=seen[name],
                drifted=tuple(_with_change(resource, parts.get(name)) for resource in drifted),
                runs=history_of(runs.get(name)),
            )
            for name, drifted in drifts.items()
            if name in hosts.chosen
        ),
        problems=problems if has_errors(problems) else (),
        unfinished={name: run.started.plan for name, run in runs.items() if run is not None and run.unfinished},
    )


def _with_change(resource: ResourceDrift, part: HostPlan | None) -> ResourceDrift:
    if part is None:
        return resource
    address = resource.address
    return replace(
        resource,
        components=() if address.task else part.components.get(address.partition, ()),
        change=next((change for change in part.changes if change.address == address), None),
    )
