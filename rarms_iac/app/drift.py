"""Hosts compared with the manifest and with what the last apply left: drift."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from rarms_iac.app.hosts import Hosts, last_runs, observe_hosts
from rarms_iac.app.planning import outcome_of, plan_request, with_reservations
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.applying.desired_hosts import desired_hosts
from rarms_iac.applying.make_plan import make_plan
from rarms_iac.applying.plan_request import PlanRequest
from rarms_iac.diff.drift import (
    DriftKind,
    ResourceDrift,
    drift,
    drift_of_marks,
    lasting_settings,
    partitions_after_last_run,
    with_lasting_settings,
    without_unfinished,
)
from rarms_iac.model.commands import APPLY, PLAN, RecommendedCommand
from rarms_iac.model.diagnostics import Diagnostic, has_errors
from rarms_iac.model.facets import Readings
from rarms_iac.model.journal import Journal, PastRun, RunKind, ScriptRun, history_of
from rarms_iac.model.output import Internal, output
from rarms_iac.model.plan import HostPlan
from rarms_iac.model.seen_host import SeenHost, seen_hosts
from rarms_iac.model.state import State
from rarms_iac.model.system import Disruption


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedHost:
    """A host as it was seen, the runs there, and its resources that are not as applied or as wanted."""

    seen: Internal[SeenHost]
    drifted: tuple[ResourceDrift, ...]
    runs: Internal[tuple[PastRun, ...]] = ()  # that are remembered, of any application, the oldest first
    starting: Internal[Mapping[str, Readings]] = field(default_factory=dict)  # as of `lasting_settings`

    @output
    def name(self) -> str:
        """The host's name in the manifest."""
        return self.seen.name

    @output
    def host_lp(self) -> int:
        """LPs that the host has."""
        return self.seen.facts.logical_processors

    @output
    def host_changed(self) -> int:
        """How many resources were changed on the host."""
        return sum(resource.drift.is_of_the_host for resource in self.drifted)

    @output
    def not_applied(self) -> int:
        """How many are only not applied yet."""
        return len(self.to_apply) - self.host_changed

    @output
    def unused(self) -> int:
        """How many the manifest no longer wants."""
        return len(self.drifted) - len(self.to_apply)

    @property
    def to_apply(self) -> tuple[ResourceDrift, ...]:
        """The drift that an apply ends."""
        return tuple(resource for resource in self.drifted if resource.drift is not DriftKind.UNUSED)

    @property
    def is_written(self) -> bool:
        """Whether anything there carries the application's mark."""
        own = self.seen.state.of(self.seen.application)
        return bool(own.partitions or own.tasks or own.responsiveness)

    @property
    def serial(self) -> int:
        """How many runs of the application there were."""
        return self.seen.state.serials.get(self.seen.application, 0)

    @property
    def own_runs(self) -> tuple[PastRun, ...]:
        """The application's runs that are remembered, the oldest first."""
        return tuple(run for run in self.runs if run.application == self.seen.application)

    @property
    def last_run_at(self) -> str:
        """When the last run of the application began; empty: none is remembered."""
        return self.own_runs[-1].started_at if self.own_runs else ""

    @property
    def reserves(self) -> Mapping[str, int]:
        """By partition, in whole per cent of its virtual processors; without test partitions."""
        return {name: each.settings.reserve for name, each in self.seen.present.items() if not each.is_test}

    @property
    def changed_partitions(self) -> frozenset[str]:
        """The partitions that another tool changed."""
        changed = (each.address for each in self.drifted if each.drift.is_of_the_host)
        return frozenset(address.partition for address in changed if address.partition and not address.task)

    def undone_at(self, serial: int) -> str:
        """Return the time at which the last run undid a state of the host; empty: it did not.

        An undo ends all states since its apply. If the host does not have a record of that apply, it ends all states.

        Args:
            serial: The number of the application's runs until that state.
        """
        runs = self.own_runs
        if not runs or runs[-1].run is not RunKind.UNDO:
            return ""
        runs_back = (
            ago for ago, run in enumerate(reversed(runs)) if run.run is RunKind.APPLY and run.plan == runs[-1].plan
        )
        first = self.serial - next(runs_back, self.serial)
        return self.last_run_at if first <= serial < self.serial else ""


def drift_of_hosts(
    request: PlanRequest, observed: Mapping[str, State], runs: Mapping[str, Journal | ScriptRun | None]
) -> tuple[Mapping[str, tuple[ResourceDrift, ...]], tuple[Diagnostic, ...]]:
    """Find the drift of every observed host.

    Args:
        request: what the manifest asks for, how far its layout may disturb, and whether to search for ways out.
        runs: the last run of each live host; None: there was none.

    Returns:
        The drift by host name, and the findings that keep the manifest from being compared: without a layout it is
        unknown what is wanted, and only changes on the hosts are reported. With one, those of hosts that fail.
    """
    hosts, findings = desired_hosts(request, observed)
    application = request.application
    present = {name: partitions_after_last_run(run, application) for name, run in runs.items()}
    if hosts:
        findings = tuple(finding for finding in findings if outcome_of((finding,)) is Outcome.FAILED)
        drifts = {
            name: drift(desired.state, desired.seen.state, application, desired.unused, present.get(name))
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

    Returns:
        The differences by host in name order, and which runs are unfinished.

    Raises:
        UseCaseError: a host cannot be read, or hides what is there (failed).
    """
    system, hosts = hosts.system, hosts.with_one_look()
    states = observe_hosts(hosts)
    runs = dict(last_runs(hosts))
    request = replace(with_reservations(hosts, plan_request(hosts), states), explain=explain)
    starting = {name: lasting_settings(run) for name, run in runs.items()}
    lasting = {name: with_lasting_settings(state, starting.get(name, {})) for name, state in states.items()}
    drifts, problems = drift_of_hosts(request, lasting, runs)
    if outcome_of(problems) is Outcome.FAILED:
        raise UseCaseError(Outcome.FAILED, problems, hosts.manifest.sources)
    # Nothing is held back, so that every difference has the change that shows it attribute by attribute.
    plan = make_plan(replace(request, max_disruption=Disruption.REMOVAL, explain=False), lasting).plan
    parts = {part.host.name: part for part in plan.hosts} if plan else {}
    seen = seen_hosts(system.hosts, system.application.name, states)
    return DriftReport(
        application=system.application.name,
        hosts=tuple(
            ComparedHost(
                seen=seen[name],
                drifted=tuple(_with_change(resource, parts.get(name)) for resource in drifted),
                runs=history_of(runs.get(name)),
                starting=starting.get(name, {}),
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
