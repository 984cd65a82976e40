"""How an application stands: what is on its hosts, what was proven, what no longer holds, and what to do next."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Literal

from rarms_iac.app.drift import ComparedHost, look_for_drift
from rarms_iac.app.hosts import Hosts, host_errors, last_runs, observe_host
from rarms_iac.app.report import compared_with_hosts, measured_report
from rarms_iac.app.report_model import ComponentProof, ComponentVerdict, Report
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.applying.desired_hosts import totals_after
from rarms_iac.applying.preconditions import marked_resources, no_rights
from rarms_iac.diff.drift import DriftKind, ResourceDrift
from rarms_iac.model.commands import APPLY, DRIFT, MEASURE, PLAN, START, RecommendedCommand, command
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.journal import PastRun, history_of
from rarms_iac.model.outcomes import Achievement
from rarms_iac.model.output import Internal, output
from rarms_iac.model.quantities import guaranteed
from rarms_iac.model.setting import TEST_PARTITIONS
from rarms_iac.model.state import Rights, StoppedBy
from rarms_iac.model.system import System
from rarms_iac.model.totals import HostTotals, host_totals
from rarms_iac.planner.groups import groups_of
from rarms_iac.providers.interface import RobotHost, StepwiseHost
from rarms_iac.texts.messages import in_a_row, natural_order


@dataclass(frozen=True, slots=True, kw_only=True)
class PartitionStatus:
    """A partition of the application that is on a host."""

    name: str
    components: tuple[str, ...]  # by the manifest, the most critical first; none: it no longer wants the partition
    reserve: int  # CR, per cent of each of its virtual processors
    processors: int
    running: bool
    stopped_by: StoppedBy
    drift: DriftKind | None  # None: it is as it was applied, and as the manifest wants it
    lasting_reserve: int | None = None  # that it has once its start is over, as `reserve`; None: it is not starting

    @output
    def reserved_lp(self) -> Fraction:
        """What it is guaranteed, in LPs."""
        return guaranteed(self.reserve, self.processors)

    @property
    def is_left_by_measurement(self) -> bool:
        """Whether a measurement stopped it and has not started it again."""
        return self.is_stopped and self.stopped_by is StoppedBy.MEASUREMENT

    @property
    def is_stopped(self) -> bool:
        """Whether rarms stopped it, and it was not started since."""
        return self.stopped_by is not StoppedBy.NO_USER and not self.running


@dataclass(frozen=True, slots=True, kw_only=True)
class TestPartitionStatus:
    """A partition that a measurement made for itself and removes at its end; a killed one leaves it."""

    name: str
    application: str  # whose measurement; empty: it is not marked yet
    reserved_lp: Fraction
    running: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class HostOverview:
    """A host, or why it could not be looked at."""

    name: str
    compared: Internal[ComparedHost | None] = None  # None: it could not be looked at
    totals: HostTotals | None = None  # None as above
    partitions: tuple[PartitionStatus, ...] = ()  # by name
    unrecorded: tuple[str, ...] = ()  # as of `History`
    problems: tuple[Diagnostic, ...] = ()  # why it could not be looked at; then nothing else is known
    held_by: str = ""  # who runs something on it now, as `hosts.owner` names them; empty: no run that can be seen

    @output
    def test_partitions(self) -> tuple[TestPartitionStatus, ...]:
        """Those of any application, by name; they count in no total."""
        tests = (each for each in self.compared.seen.state.partitions if each.is_test) if self.compared else ()
        return tuple(
            TestPartitionStatus(
                name=partition.shown_name,
                application=partition.mark.application if partition.mark else "",
                reserved_lp=Fraction(guaranteed(partition.settings.reserve, partition.settings.processors)),
                running=partition.settings.running,
            )
            for partition in sorted(tests, key=lambda partition: partition.shown_name)
        )

    @output
    def attached(self) -> str:
        """The service or container that a measurement holds, or a killed one left held; empty: none."""
        return self.compared.seen.state.attached if self.compared else ""

    @output
    def other_drift(self) -> tuple[ResourceDrift, ...]:
        """The drift of what is not a partition there: task classes, and what is not made yet."""
        drifted = self.compared.drifted if self.compared else ()
        shown = {*TEST_PARTITIONS, *(partition.name for partition in self.partitions)}
        return tuple(
            each
            for each in drifted
            if each.address.partition not in TEST_PARTITIONS
            and (each.address.task or each.address.partition not in shown)
        )

    @output
    def last_run(self) -> PastRun | None:
        """The last run there, of any application."""
        return self.compared.runs[-1] if self.compared and self.compared.runs else None

    @property
    def drift_kinds(self) -> frozenset[DriftKind]:
        """How what is there or wanted there drifted."""
        kinds = [partition.drift for partition in self.partitions if partition.drift is not None]
        return frozenset(kinds) | {resource.drift for resource in self.other_drift}

    @property
    def is_unfinished(self) -> bool:
        """Whether its last run did not end, and goes on no more as far as can be seen."""
        return not self.held_by and self.last_run is not None and self.last_run.closing is None

    @property
    def is_left_by_measurement(self) -> bool:
        """Whether a measurement was cut off there."""
        return not self.held_by and self.is_at_measurement

    @property
    def is_at_measurement(self) -> bool:
        """Whether a measurement of the application is at work there, or left something when it was killed."""
        has_test = self.compared is not None and any(partition.is_test for partition in self.compared.seen.own)
        return has_test or any(partition.is_left_by_measurement for partition in self.partitions)


@dataclass(frozen=True, slots=True, kw_only=True)
class NextCommand:
    """The command that brings the application on, and why."""

    command: RecommendedCommand
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class History:
    """The runs of all applications on hosts; a host remembers `journal.MOST_PAST_RUNS` runs."""

    kind: Literal["history"] = "history"
    application: str
    hosts: Mapping[str, tuple[PastRun, ...]]  # the oldest run of each first
    # By host without a run: what bears a mark of rarms there. Where there is any, the journal is missing.
    unrecorded: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Overview:
    """The status of an application."""

    kind: Literal["status"] = "status"
    application: str
    hosts: tuple[HostOverview, ...]  # the chosen ones, by name
    proofs: tuple[ComponentProof, ...]  # the last of each threshold
    stale: Mapping[str, tuple[str, ...]]  # what changed since, by data log that reservations would use
    verdicts: tuple[ComponentVerdict, ...]  # on each component whose reserve is to be measured, by platform
    next_command: NextCommand | None  # None: nothing is left to do, as far as is known, or a run holds a host
    problems: tuple[Diagnostic, ...] = ()  # why the manifest has no layout; empty: it has, or no host could be asked
    has_thresholds: Internal[bool] = True  # whether a component has an APT
    unused_logs: int = 0  # stale data logs of loads that no reservation uses

    @output
    def unknown(self) -> tuple[str, ...]:
        """The hosts that could not be looked at, by name."""
        return tuple(host.name for host in self.hosts if host.problems)


def overview_of(hosts: Hosts, report: Report | None = None, *, explain: bool = False) -> Overview:
    """Look at the chosen hosts and at the logs next to the manifest. Changes nothing.

    Args:
        hosts: one that cannot be read is reported as such, and the others all the same.
        report: as `measured_report` returns it; None: the logs are read.

    Returns:
        Each host in name order; one that cannot be reached has its finding.

    Raises:
        UseCaseError: a data log cannot be read (negative).
    """
    hosts = hosts.with_one_look()
    report = report or measured_report(hosts.manifest)
    overviews, problems = _host_overviews(hosts, explain=explain)
    used = {load for name in hosts.system.components for load in hosts.system.loads_of((name,))}
    outdated_logs = [log for log in report.measurements if log.stale]
    stale = {log.log: log.stale for log in outdated_logs if log.interference in used}
    proofs = compared_with_hosts(report.proofs, [host.compared for host in overviews if host.compared])
    return Overview(
        application=hosts.system.application.name,
        hosts=overviews,
        proofs=proofs,
        stale=stale,
        verdicts=report.verdicts,
        next_command=_next_command(hosts.system, overviews, report.verdicts, proofs, has_layout=not problems),
        problems=problems,
        has_thresholds=any(component.apt for component in hosts.system.components.values()),
        unused_logs=len(outdated_logs) - len(stale),
    )


def history_of_hosts(hosts: Hosts) -> History:
    """List what was applied and undone on the chosen live hosts, by any application.

    Args:
        hosts: the chosen ones; those with a snapshot are passed over.

    Returns:
        The runs by host, the oldest first.

    Raises:
        UseCaseError: a journal cannot be read, or a host without a journal cannot be looked at.
    """
    runs = {name: history_of(run) for name, run in last_runs(hosts)}
    return History(
        application=hosts.system.application.name,
        hosts=runs,
        unrecorded={name: marked_resources(observe_host(hosts.open(name))) for name, past in runs.items() if not past},
    )


def _refuse_hidden(hosts: Hosts, name: str) -> None:
    """Look at this host and no other, so that one that is out of reach does not hide the rest.

    Raises:
        UseCaseError: it cannot be looked at, or hides what is there (failed).
    """
    snapshot = hosts.snapshots.hosts.get(name)
    state = snapshot.state if snapshot else observe_host(hosts.open(name))
    if state.facts.rights is not Rights.PROVEN:
        raise UseCaseError(Outcome.FAILED, [no_rights(state.facts)])


def _holder(hosts: Hosts, name: str) -> str:
    if name in hosts.snapshots.hosts:
        return ""
    host = hosts.open(name)
    with host_errors():
        return host.holder() if isinstance(host, StepwiseHost | RobotHost) else ""


def _host_overviews(hosts: Hosts, *, explain: bool) -> tuple[tuple[HostOverview, ...], tuple[Diagnostic, ...]]:
    """Describe each chosen host; also return the errors that leave the manifest without a layout."""
    looked: dict[str, tuple[str, History]] = {}  # by host: who holds it, and its runs
    problems: dict[str, tuple[Diagnostic, ...]] = {}
    for name in hosts.chosen:
        try:
            before = _holder(hosts, name)
            history = history_of_hosts(hosts.only(name))
            _refuse_hidden(hosts, name)
            looked[name] = before or _holder(hosts, name), history  # what ran meanwhile was seen half
        except UseCaseError as error:
            problems[name] = error.findings
    compared: dict[str, ComparedHost] = {}
    no_layout: tuple[Diagnostic, ...] = ()
    try:
        if looked:
            report = look_for_drift(hosts.only(*looked), explain=explain)
            compared, no_layout = {host.name: host for host in report.hosts}, report.problems
    except UseCaseError as error:
        problems.update(dict.fromkeys(looked, error.findings))
    overviews = tuple(
        HostOverview(name=name, problems=problems[name])
        if name in problems
        else _host_overview(hosts.system, compared[name], *looked[name])
        for name in hosts.chosen
    )
    return overviews, no_layout


def _host_overview(system: System, compared: ComparedHost, held_by: str, history: History) -> HostOverview:
    seen = compared.seen
    state = replace(seen.state, partitions=tuple(each for each in seen.state.partitions if not each.is_test))
    components = {group.name: tuple(member.name for member in group.members) for group in groups_of(system)}
    kinds = {each.address.partition: each.drift for each in compared.drifted if not each.address.task}
    return HostOverview(
        name=seen.name,
        compared=compared,
        totals=host_totals(seen.host, seen.facts, totals_after(state, seen.application, (), components)),
        partitions=tuple(
            PartitionStatus(
                name=name,
                components=components.get(name, ()),
                reserve=partition.settings.reserve,
                processors=partition.settings.processors,
                running=partition.settings.running,
                stopped_by=partition.mark.stopped_by if partition.mark else StoppedBy.NO_USER,
                drift=kinds.get(name),
                lasting_reserve=int(compared.starting[name]["reserve"]) if name in compared.starting else None,
            )
            for name, partition in sorted(seen.present.items())
            if not partition.is_test
        ),
        unrecorded=history.unrecorded.get(seen.name, ()),
        held_by=held_by,
    )


def _next_command(
    system: System,
    hosts: Sequence[HostOverview],
    verdicts: Sequence[ComponentVerdict],
    proofs: Sequence[ComponentProof],
    *,
    has_layout: bool,
) -> NextCommand | None:
    if any(host.held_by for host in hosts):
        return None
    unfinished = [host.name for host in hosts if host.is_unfinished]
    kinds = {kind for host in hosts for kind in host.drift_kinds}
    if unfinished:
        return NextCommand(command=APPLY, reason=f"finishes the run on {in_a_row(unfinished)}")
    if any(host.is_left_by_measurement for host in hosts):
        reason = "removes the test partitions of an interrupted measurement, and restarts the stopped partitions"
        return NextCommand(command=START, reason=reason)
    if any(host.problems for host in hosts):
        return None  # the advice of these problems comes first
    if any(verdict.achievement is Achievement.UNMEASURED for verdict in verdicts):
        return NextCommand(command=MEASURE, reason="measures the missing reservations")
    if any(kind.is_of_the_host for kind in kinds):
        return NextCommand(command=DRIFT, reason="shows the changes")
    if not has_layout:
        return NextCommand(command=PLAN, reason="shows why no layout exists, and changes that help")
    if kinds - {DriftKind.UNUSED}:
        return NextCommand(command=PLAN, reason="shows the changes that are not applied yet")
    partitions = [partition for host in hosts for partition in host.partitions]
    return _next_proof_command(system, partitions, [proof for proof in proofs if not proof.outdated])


def _next_proof_command(
    system: System, partitions: Sequence[PartitionStatus], proofs: Sequence[ComponentProof]
) -> NextCommand | None:
    """Return the next command, once all is applied, until every threshold is shown to be met under every load."""
    asked = {
        (name, index, load)
        for name, component in system.components.items()
        for index in component.apt
        for load in system.policy.interference
    }
    missed = {proof.entry.component for proof in proofs if proof.proven.verdict == "missed"}
    if missed := missed & {name for name, _, _ in asked}:
        again = command("measure", *sorted(missed), again=True, stop_partitions=True)
        return NextCommand(command=again, reason="finds a reservation for the components that missed their threshold")
    stopped = sorted({partition.name for partition in partitions if partition.is_stopped}, key=natural_order)
    if stopped:
        return NextCommand(command=command("start", *stopped), reason="starts the stopped partitions")
    held = [proof for proof in proofs if proof.proven.met]
    if asked <= {(proof.entry.component, proof.index.name, proof.entry.interference) for proof in held}:
        return None
    off = sorted((partition.name for partition in partitions if not partition.running), key=natural_order)
    if off:
        reason = "starts the partitions for the proof"
        return NextCommand(command=command("start", *off), reason=reason)
    too_near = [
        proof.entry.component
        for proof in proofs
        if proof.proven.verdict == "inconclusive" and not proof.proven.samples_needed
    ]
    if too_near:
        reason = "shows a value too close to its threshold: raise the reservation, or relax the threshold"
        return NextCommand(command=command("explain", min(too_near, key=natural_order)), reason=reason)
    samples = max((proof.proven.samples_needed or 0 for proof in proofs if not proof.proven.met), default=0)
    if samples:
        reason = "runs all components together again, with more samples"
        return NextCommand(command=command("prove", samples=samples), reason=reason)
    reason = "runs all components together, and compares them with their thresholds"
    return NextCommand(command=command("prove"), reason=reason)
