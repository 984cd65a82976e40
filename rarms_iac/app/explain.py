"""How a component comes to what its partition gets: a row a value, with where the value comes from.

Begin at `explain_component`. Hosts are looked at; one that cannot be counts by what the manifest says.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Literal

from rarms_iac.app.data_logs import measured_reservations
from rarms_iac.app.decision_logs import TUNE, PreviousTuning, RejectedCompound, previous_tuning
from rarms_iac.app.explained_log import ExplainedValue, log_rows, threshold_rows
from rarms_iac.app.hosts import Hosts, observe_hosts, select_hosts
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.requests import HostSelection
from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError
from rarms_iac.model.capacity import fits
from rarms_iac.model.commands import PLAN, RecommendedCommand
from rarms_iac.model.diagnostics import Diagnostic, has_errors
from rarms_iac.model.experiment import ProcessorSource
from rarms_iac.model.host import Host
from rarms_iac.model.layout import Layout, PlacedPartition
from rarms_iac.model.quantities import LogicalProcessors, guaranteed, in_processors
from rarms_iac.model.seen_host import SeenHost, seen_hosts
from rarms_iac.model.state import PartitionSettings, State
from rarms_iac.model.system import Component, Disruption, Measured, System
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.layout import Planning, plan_layout
from rarms_iac.planner.problem import by_name
from rarms_iac.planner.reservations import MeasuredReservations, depends_on_a_log, names_of
from rarms_iac.planner.sizes import size, size_without_reserve
from rarms_iac.planner.totals import totals_by_host
from rarms_iac.planner.verdicts import MeasuredTogether, NotMeasured
from rarms_iac.storage.shipped import known_codes
from rarms_iac.texts.messages import in_a_row, natural_order, quoted, suggestion
from rarms_iac.texts.plans import describe_placement
from rarms_iac.texts.quantities import count_processors, share_of_host, show_bytes, show_processors, show_reserve

STRATEGIES = {"default": "the default strategy", "paper": "the paper's procedure"}

PROCESSORS_FROM = {
    ProcessorSource.MANIFEST: "manifest",
    ProcessorSource.USED: "the largest number of processors in use at once",
    ProcessorSource.MEMBERS: "the sum of its components, at most the processors of the host",
    ProcessorSource.HOST: "all processors of the host; their use is not measured yet",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """The parts of the reservation of a component's partition, and the rejected alternatives."""

    kind: Literal["component"] = "component"
    component: str
    criticality: int
    partition: str = ""  # empty: it runs on the host itself
    host: str = ""  # where its partition is, or would be; of one on the host itself empty
    fits: bool = True  # whether there is a layout
    least: int | None = None  # CR by the data log; None: no setting in it is enough, or there is none
    settings: PartitionSettings | None = None  # that the partition gets; None: its reserve is not known
    rows: tuple[ExplainedValue, ...]
    errors: tuple[Diagnostic, ...] = ()  # why there is no layout
    commands: tuple[RecommendedCommand, ...] = ()  # the next ones


def find_component(manifest: Manifest, name: str) -> Component:
    """Return a component of a manifest without errors by its name.

    Raises:
        RequestError: there is none; the message offers the nearest component or finding, and lists the components.
    """
    component = manifest.system.components.get(name)
    if component is None:
        nearest = suggestion(name, (*manifest.system.components, *known_codes()))
        names = ", ".join(sorted(manifest.system.components, key=natural_order))
        raise RequestError(f"{quoted(name)} is neither a component nor a finding.{nearest} Components: {names}.")
    return component


def explain_component(manifest: Manifest, name: str) -> Explanation:
    """Explain how a component comes to what it gets, as a plan places it.

    Raises:
        RequestError: no such component.
        UseCaseError: its partition may run on no host (negative).
    """
    component, system = find_component(manifest, name), manifest.system
    group = next((group for group in groups_of(system) if name in names_of(group.members)), None)
    if group is None:
        return _on_the_host(component, system)
    hosts = select_hosts(manifest, HostSelection())
    states = observe_hosts(hosts, needed=())
    reservations = measured_reservations(manifest, states)
    planning = plan_layout(system, reservations, states, manifest.places, explain=False)
    seen = seen_hosts(system.hosts, system.application.name, states)
    return _Case(component, group, hosts, states, seen, reservations, planning).explanation()


def _on_the_host(component: Component, system: System) -> Explanation:
    homes = [host for host in by_name(system.hosts) if component.hosts is None or host.name in component.hosts]
    rows = [
        *threshold_rows(component, ""),
        ExplainedValue("host", ", ".join(host.name for host in homes) or "none", "manifest: runs_on: host"),
        ExplainedValue("reservation", "none", "only partitions have a reservation; it is not measured"),
        ExplainedValue("task class", component.task_class or "none", "manifest"),
    ]
    for host in homes:
        kept = show_processors(in_processors(host.keep_for_host.processor, host.logical_processors))
        rows.append(ExplainedValue(f"kept on {host.name}", kept, "keep_for_host"))
    return Explanation(
        component=component.name,
        criticality=component.criticality,
        rows=tuple(rows),
        commands=(PLAN,) if component.task_class else (),
    )


@dataclass(frozen=True, slots=True)
class _Case:
    """A partition with the plan, the hosts and the measurements that its explanation needs."""

    component: Component
    group: Group
    hosts: Hosts
    states: Mapping[str, State]  # of the hosts that could be looked at
    seen: Mapping[str, SeenHost]  # all hosts
    reservations: MeasuredReservations
    planning: Planning

    @property
    def system(self) -> System:
        return self.hosts.system

    @property
    def layout(self) -> Layout | None:
        return self.planning.answer if isinstance(self.planning.answer, Layout) else None

    @property
    def is_fixed(self) -> bool:
        """Whether the manifest says how much is reserved."""
        return not depends_on_a_log(self.group) and bool(self.fixed_by)

    @property
    def fixed_by(self) -> str:
        own = self.group.request.cpu.reserve
        if own is not None and not isinstance(own, Measured):
            return f"manifest: partition {self.group.name}"
        members = [member.name for member in self.group.members if member.cpu.reserve is not None]
        return f"manifest: {in_a_row(members)}" if members else ""

    @property
    def now_on(self) -> str:
        """The host that the partition is on now, the first by name; empty: none that was looked at."""
        return next((name for name, seen in sorted(self.seen.items()) if self.group.name in seen.present), "")

    @property
    def bound(self) -> str:
        """Why it may only be where it is; empty: it may be elsewhere."""
        if not self.now_on or self.system.policy.max_disruption is Disruption.REMOVAL:
            return ""
        return f"it stays on {self.now_on}: policy.max_disruption does not allow a removal"

    def explanation(self) -> Explanation:
        host, partition, unplaced = self._place()
        wanted, log = self._wanted(host), self._log(host)
        least = None if log is None else log.least
        previous = previous_tuning(self.hosts.manifest, host)
        by_log = depends_on_a_log(self.group)
        compounds = tuple(previous.rejected(names_of(self.group.members))) if by_log else ()
        rows = [
            *threshold_rows(self.component, ""),
            *(
                row
                for member in self.group.members
                if member is not self.component
                for row in threshold_rows(member, f" of {member.name}")
            ),
            *self._log_rows(log, unplaced),
            *self._reservation(host, partition, wanted, log),
            *self._members(partition, previous),
            *self._sizes(partition, host, log),
            *self._host(host, partition, wanted, unplaced),
        ]
        rows += [*map(_rejected, compounds), *([] if compounds else [self._not_shared(previous, host)])]
        rows += [self._elsewhere(partition, other) for other in by_name(self.system.hosts) if other.name != host.name]
        return Explanation(
            component=self.component.name,
            criticality=self.component.criticality,
            partition=partition.name,
            host=host.name,
            fits=self.layout is not None,
            least=least,
            settings=None if unplaced else partition.settings,
            rows=tuple(rows),
            errors=()
            if self.layout is not None
            else tuple(finding for finding in self.planning.findings if has_errors([finding])),
            commands=(TUNE,) if self._is_tuning_next(log, previous, compounds) else (),
        )

    def _is_tuning_next(
        self, log: MeasuredTogether | None, previous: PreviousTuning, compounds: Sequence[RejectedCompound]
    ) -> bool:
        """Tell whether tuning may help; where all fits, or nothing is measured yet, it has nothing to do."""
        is_tunable = depends_on_a_log(self.group) and log is not None
        return self.layout is None and is_tunable and not compounds and not previous.runs

    def _place(self) -> tuple[Host, PlacedPartition, str]:
        """Return the partition's planned, current or first possible place, and why it fits no host."""
        if self.layout is not None:
            chosen = next(each for each in self.layout.partitions if each.name == self.group.name)
            return self.system.hosts[chosen.host], chosen, ""
        allowed = [
            host
            for host in sorted(
                self.system.hosts.values(), key=lambda host: (host.name != self.now_on, natural_order(host.name))
            )
            if self.group.may_run_on(host.name)
        ]
        answers = [(host, size(self.group, host, self.reservations)) for host in allowed]
        for host, answer in answers:
            if isinstance(answer, PlacedPartition):
                return host, answer, ""
        for host, answer in answers:
            shape = size_without_reserve(self._as_wide_as_measured(host), host)
            if isinstance(shape, PlacedPartition) and isinstance(answer, Diagnostic):
                return host, shape, answer.detail
        raise UseCaseError(Outcome.NEGATIVE, self.planning.findings, self.hosts.manifest.sources)

    def _as_wide_as_measured(self, host: Host) -> Group:
        """Return the group with the processors that its data log was measured with, where no reservation says them."""
        log = self.reservations.log(self.group.members, host)
        if isinstance(log, NotMeasured) or self.group.request.processors is not None:
            return self.group
        return replace(self.group, request=replace(self.group.request, processors=log.processors))

    def _wanted(self, host: Host) -> LogicalProcessors | None:
        own = self.group.request.cpu.reserve
        if own is not None and not isinstance(own, Measured):
            return in_processors(own, host.logical_processors)
        answer = self.reservations.look_up(self.group.members, host)
        return None if isinstance(answer, NotMeasured) else answer.reservation

    def _log(self, host: Host) -> MeasuredTogether | None:
        """Return the data log of its partition, also where the reserve is fixed."""
        members, reservations = self.group.members, self.reservations
        if not depends_on_a_log(self.group):
            if not self.is_fixed:
                return None
            members = tuple(
                replace(member, cpu=replace(member.cpu, reserve=Measured.MEASURED)) if member.apt else member
                for member in members
            )
            partitions = {
                name: replace(each, cpu=replace(each.cpu, reserve=None)) if name == self.group.name else each
                for name, each in self.system.partitions.items()
            }
            components = {**self.system.components, **{member.name: member for member in members}}
            system = replace(self.system, components=components, partitions=partitions)
            reservations = measured_reservations(replace(self.hosts.manifest, system=system), self.states)
        log = reservations.log(members, host)
        return log if isinstance(log, MeasuredTogether) else None

    def _log_rows(self, log: MeasuredTogether | None, unplaced: str) -> Iterator[ExplainedValue]:
        if log is not None:
            loads = self.system.loads_of(names_of(self.group.members))
            yield from log_rows(self.component, self.group, loads, log, is_used=not self.is_fixed)
        elif depends_on_a_log(self.group):
            yield ExplainedValue("data log", "none", unplaced)

    def _reservation(
        self,
        host: Host,
        partition: PlacedPartition,
        wanted: LogicalProcessors | None,
        log: MeasuredTogether | None,
    ) -> Iterator[ExplainedValue]:
        def of_host(processors: Fraction) -> str:
            return f"{show_processors(processors)} ({share_of_host(processors, host.logical_processors, host.name)})"

        least = None if log is None or log.least is None else of_host(guaranteed(log.least, log.processors))
        if wanted is None:
            why = "not measured" if log is None else "no measured setting is enough"
            yield ExplainedValue("reservation", "not known", why)
            return
        if self.is_fixed:
            if log is not None:
                value, source = least or "no setting is enough", "data log; the manifest fixes the reserve"
                yield ExplainedValue("least reservation", value, source)
            source = self.fixed_by
        elif least is not None:
            source = "the smallest whole per cent of its VPs that meets every threshold"
        else:
            source = "not set"
        yield ExplainedValue("reservation", of_host(wanted) if wanted else "none", source)
        settings = partition.settings
        if settings.reserve:
            lost = guaranteed(settings.reserve, settings.processors) - wanted
            rounded = f"rounded up by {show_processors(lost)}" if lost else "not rounded"
            given = show_reserve(settings.reserve, settings.processors)
            yield ExplainedValue("reserve", given, f"whole per cent of its VPs: {rounded}")

    def _members(self, partition: PlacedPartition, previous: PreviousTuning) -> Iterator[ExplainedValue]:
        others = [member for member in self.group.members if member is not self.component]
        names = names_of(self.group.members)
        together = ", ".join(f"{other.name} (criticality {other.criticality})" for other in others)
        source = f"with {together}" if others else "alone"
        yield ExplainedValue("partition", partition.name, source)
        if others and self.group.name in self.system.partitions:
            value, source = _combined(previous, names) or ("by hand", "not written by a recorded tuning")
            yield ExplainedValue("combined", value, f"manifest: partitions; {source}")
        for member in self.group.members:
            if wished := [name for name in member.together if name in names]:
                yield ExplainedValue("together", f"{member.name} with {', '.join(wished)}", f"manifest: {member.name}")

    def _sizes(self, partition: PlacedPartition, host: Host, log: MeasuredTogether | None) -> Iterator[ExplainedValue]:
        settings = partition.settings
        is_measured = log is not None and not self.is_fixed
        source = PROCESSORS_FROM[log.processors_from] if log is not None and is_measured else ""
        yield ExplainedValue("processors", count_processors(settings.processors, host), source)
        yield ExplainedValue("memory", show_bytes(settings.memory), "manifest")
        yield ExplainedValue("limit", show_reserve(settings.limit, settings.processors), partition.why_limit)
        yield ExplainedValue("weight", str(settings.weight), partition.why_weight)
        if partition.mechanism:
            yield ExplainedValue("mechanism", partition.mechanism)

    def _host(
        self, host: Host, partition: PlacedPartition, wanted: LogicalProcessors | None, unplaced: str
    ) -> Iterator[ExplainedValue]:
        yield ExplainedValue("host", host.name, self._why_host(host, wanted, unplaced))
        if missing := sorted(self.system.hosts.keys() - self.states.keys(), key=natural_order):
            source = "could not be read; only the manifest is used"
            yield ExplainedValue("not seen", ", ".join(missing), source)
        if self.layout is None:
            return
        totals = totals_by_host(self.system, self.layout.partitions, self.states)[host.name]
        here = sorted(self.layout.on(host.name), key=lambda other: natural_order(other.name))
        amounts: list[tuple[str, Fraction]] = [
            (other.name, other.reserved) for other in here if other.name != partition.name
        ]
        amounts += [("unmanaged partitions", totals.unmanaged_lp), ("kept for the host", totals.kept_lp)]
        for name, amount in amounts:
            if amount:
                yield ExplainedValue(f"{name} on {host.name}", show_processors(amount))
        free = f"{show_processors(totals.free_lp)} of {show_processors(host.logical_processors)}"
        yield ExplainedValue(f"free on {host.name}", free)

    def _why_host(self, host: Host, wanted: LogicalProcessors | None, unplaced: str) -> str:
        if self.now_on == host.name:
            return self.bound or "it is here now"
        if self.now_on:
            return f"it is on {self.now_on} now; apply recreates it on {host.name}"
        if unplaced:
            return "not planned until its reservation is known" if wanted is None else unplaced
        if self.layout is None:
            return "not planned until there is a layout"
        return "" if self.layout.placement is None else describe_placement(self.layout.placement)

    def _not_shared(self, previous: PreviousTuning, host: Host) -> ExplainedValue:
        if not depends_on_a_log(self.group):
            why = "its reservation is not measured"
        elif previous.unreadable:
            why = f"the tuning log cannot be read: {previous.unreadable}"
        elif not previous.runs:
            why = f"`rarms tune` has measured nothing on {host.platform}"
        else:
            why = "tuning has not measured another compound with it"
        return ExplainedValue("other compounds", "none", why)

    def _elsewhere(self, here: PlacedPartition, host: Host) -> ExplainedValue:
        """Return the reservation on another host, and the reason why it is not there.

        The rest of the layout stays where it is.
        """
        name = f"on {host.name}"
        refused = next((member.name for member in self.group.members if not member.may_run_on(host.name)), "")
        answer = size(self.group, host, self.reservations)
        if refused or isinstance(answer, Diagnostic):
            why = answer.detail if isinstance(answer, Diagnostic) else f"{refused} may not run there (`hosts`)"
            return ExplainedValue(name, "none", why)
        seen = self.seen[host.name]
        there = replace(answer, host=host.name, sharing=seen.sharing(answer.name))
        neighbours = () if self.layout is None else self.layout.on(host.name)
        if self.bound or self.layout is None:
            why = self.bound or "no layout exists to compare with"
        elif not fits(seen.capacity, (*seen.claims, *(other.claim for other in (*neighbours, there)))):
            names = [*(other.name for other in neighbours), *(["unmanaged partitions"] if seen.claims else [])]
            why = f"no room together with {in_a_row(names)}" if names else "no room"
        elif there.reserved > here.reserved:
            why = f"it needs less on {here.host}"
        else:
            why = f"it has room, but partitions on {here.host} stay there; otherwise the order of names decides"
        return ExplainedValue(name, show_processors(there.reserved), why)


def _combined(previous: PreviousTuning, members: tuple[str, ...]) -> tuple[str, str] | None:
    """Return the combination that tuning wrote there, and its run."""
    combined = previous.combined(members)
    if combined is None:
        return None
    run, partition = combined
    claim = f", {run.claim} to be the best" if run.strategy == "default" else ""
    apart = show_processors(partition.parts_lp or Fraction(0))
    value = f"{show_processors(partition.reserved_lp)} ({partition.reserve} % of its VPs) instead of {apart} apart"
    return value, f"tuning, {run.when}, by {STRATEGIES[run.strategy]}{claim}"


def _rejected(compound: RejectedCompound) -> ExplainedValue:
    answers = [f"{compound.enough} % of its VPs is enough"] if compound.enough is not None else []
    if compound.missed is not None:
        answers.append(f"{compound.missed} % is not enough for {', '.join(compound.worse)}")
    outdated = f"; outdated: {compound.outdated}" if compound.outdated else ""
    return ExplainedValue("+".join(compound.components), "; ".join(answers), f"rejected by tuning{outdated}")
