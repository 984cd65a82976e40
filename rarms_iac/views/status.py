"""`rarms status` and `rarms history`: hosts with their partitions and totals, and the runs on them."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import compress
from typing import TYPE_CHECKING

from rarms_iac.app.drift import ComparedHost
from rarms_iac.app.report_model import ComponentProof, PlatformCapacity
from rarms_iac.app.status import History, HostOverview, Overview, PartitionStatus, TestPartitionStatus
from rarms_iac.applying.refusals import describe_missing_journal
from rarms_iac.diff.drift import DriftKind
from rarms_iac.model.commands import APPLY, PLAN, Wording, prose, sentences
from rarms_iac.model.journal import Closing, PastRun, RunKind
from rarms_iac.model.outcomes import Achievement
from rarms_iac.model.quantities import guaranteed
from rarms_iac.model.state import StoppedBy
from rarms_iac.model.totals import HostTotals
from rarms_iac.texts.indexes import show_threshold
from rarms_iac.texts.messages import counted, in_a_row, natural_order
from rarms_iac.texts.quantities import share_of_host, share_of_processors, show_processors
from rarms_iac.views.changes import TITLES, members_of, name_findings
from rarms_iac.views.console import CHANGED, DIM, STRONG, paragraph, stack, styled
from rarms_iac.views.table import Column, Row, Table
from rarms_iac.views.verdicts import (
    describe_proof_setting,
    describe_verdict,
    describe_verdicts,
    proof_time,
    why_not_known,
)

if TYPE_CHECKING:
    from rich.console import RenderableType


BAR = 20
"""Columns of a bar."""


def status_text(overview: Overview) -> "RenderableType":
    """Show each host with its partitions, then what was proven, what no longer holds, and the next command."""
    parts = [part for host in overview.hosts for part in _host_overview(host)]
    nothing_is_applied = overview.hosts and not any(host.partitions or host.problems for host in overview.hosts)
    for number, line in enumerate(() if nothing_is_applied else _proven(overview.proofs)):
        parts.append(paragraph(line, indent=2) if number else paragraph(line, start="Proven: "))
    for log, changes in overview.stale.items():
        parts.append(paragraph(f"{log}: {'; '.join(changes)}", start="Stale: "))
    unknown = [verdict for verdict in overview.verdicts if verdict.achievement is not Achievement.MET]
    is_proven = overview.next_command is None and overview.has_thresholds and not overview.unknown
    if is_proven and not describe_holders(overview.hosts):
        confirmed = [each.component for each in unknown if each.achievement is Achievement.PROVISIONAL]
        unknown = [each for each in unknown if each.achievement is not Achievement.PROVISIONAL]
        if confirmed:
            parts.append(paragraph(f"Provisional, confirmed by the proof: {in_a_row(confirmed)}."))
    parts += [paragraph(f"{line}.") for line in describe_verdicts(unknown)]
    if overview.problems and all(each.achievement is Achievement.PROVISIONAL for each in unknown):
        parts.append(paragraph(f"{name_findings(overview.problems)}.", start="No layout: "))
    if overview.unused_logs:
        logs = counted(overview.unused_logs, "stale data log")
        parts.append(paragraph(f"{logs} for loads that are not in use.", start="Unused: "))
    if overview.unknown:
        parts.append(paragraph(f"{in_a_row(overview.unknown)} could not be read.", start="Unknown: "))
    if at_work := describe_holders(overview.hosts):
        return stack(*parts, paragraph(at_work))
    if overview.next_command is None:
        return stack(*parts, *([] if overview.unknown else [paragraph(_nothing_left(overview))]))
    step = overview.next_command
    return stack(*parts, paragraph(prose(step.command, f" {step.reason}."), start="Next: "))


def describe_holders(hosts: Sequence[HostOverview]) -> str:
    """Say which runs go on now and what they do, and that the next command follows from their end; empty: none."""
    sentences = [f"{host.held_by}, {_work_of_holder(host)} on {host.name}." for host in hosts if host.held_by]
    return " ".join([*sentences, "The next command is shown when it has ended."] if sentences else [])


def _work_of_holder(host: HostOverview) -> str:
    if host.last_run is not None and host.last_run.closing is None:
        return "applies a plan" if host.last_run.run is RunKind.APPLY else "undoes an apply"
    if host.is_at_measurement:
        return "measures"
    return "is running"


def _nothing_left(overview: Overview) -> str:
    proven = "every threshold was proven" if overview.has_thresholds else "no component has a threshold to prove"
    return f"Everything is applied, and {proven}."


def _host_overview(host: HostOverview) -> "Iterator[RenderableType]":
    if host.problems:
        yield styled((f"Host {host.name}", STRONG), " could not be read:")
        yield from (paragraph(sentences(problem.detail, problem.advice), indent=2) for problem in host.problems)
        yield ""
        return
    totals = host.totals
    assert totals is not None, "the host was read"
    bar = _bar(float((totals.reserved_lp + totals.unmanaged_lp) / totals.host_lp))
    yield styled((f"Host {host.name}", STRONG), f"  {bar}")
    yield replace(partitions_table(host), totals=(f"{describe_totals(totals)}.",), indent=2)
    if host.attached:
        end = "The end of the measurement restores" if host.held_by else "The next command that locks the host restores"
        yield paragraph(f"A measurement limits {host.attached}. {end} its settings.", indent=2)
    for drift in host.other_drift:
        name = drift.address.in_short
        yield paragraph(styled(f"{name}: ", (TITLES[drift.drift], CHANGED)), indent=2, more=2)
    if host.unrecorded:
        yield paragraph(styled((describe_missing_journal(host.name, host.unrecorded), CHANGED)), indent=2, more=2)
    if host.last_run:
        yield paragraph(styled((f"Last run: {describe_run(host.last_run)}", DIM)), indent=2, more=2)
    yield ""


def describe_other_claims(unmanaged_lp: Fraction, kept_lp: Fraction) -> list[str]:
    """Return the capacity that is neither reserved by the application nor free.

    Examples are `0.3 LP by unmanaged partitions` and `0.2 LP kept for the host`.

    Args:
        unmanaged_lp: LPs that machines of others reserve; what is 0 is left out.
    """
    amounts = ((unmanaged_lp, "by unmanaged partitions"), (kept_lp, "kept for the host"))
    return [f"{show_processors(amount)} {purpose}" for amount, purpose in amounts if amount]


def describe_totals(totals: HostTotals) -> str:
    """Write as `1.4 LP of 2 LP reserved, 0.2 LP kept for the host, 0.4 LP free`."""
    free = f"{show_processors(totals.free_lp)} free"
    if totals.free_lp < 0:
        free = f"{show_processors(-totals.free_lp)} more than may be reserved"
    reserved = f"{show_processors(totals.reserved_lp)} of {show_processors(totals.host_lp)} reserved"
    return ", ".join([reserved, *describe_other_claims(totals.unmanaged_lp, totals.kept_lp), free])


def _bar(share: float) -> str:
    filled = min(BAR, round(BAR * share))
    return f"[{'#' * filled}{'.' * (BAR - filled)}]"


PARTITIONS = (
    Column("partition", wraps=True),
    Column("reservation", right=True, unit="LP"),
    Column("CR", right=True),
    Column("state", wraps=True),
)


def partitions_table(host: HostOverview) -> Table:
    """Return a row a partition by name, then the test partitions of measurements."""
    rows: list[Row] = [
        (
            partition.name + members_of(partition.name, {partition.name: partition.components}),
            partition.reserved_lp,
            share_of_processors(partition.reserve, partition.processors),
            "; ".join(_remarks(partition)),
        )
        for partition in sorted(host.partitions, key=lambda each: natural_order(each.name))
    ]
    rows += [(test.name, test.reserved_lp, "", _test_state(test)) for test in host.test_partitions]
    return Table(PARTITIONS, rows)


def _test_state(partition: TestPartitionStatus) -> str:
    whose = f"of {partition.application}" if partition.application else "not marked yet"
    return f"test partition, not counted; {'running' if partition.running else 'off'}, {whose}"


def _remarks(partition: PartitionStatus) -> Iterator[str]:
    match partition.stopped_by:
        case StoppedBy.USER if not partition.running:
            yield "stopped by `rarms stop`"
        case StoppedBy.MEASUREMENT if not partition.running:
            yield "stopped to measure"
        case _:
            yield "running" if partition.running else "off"
    if partition.lasting_reserve is not None:
        later = show_processors(guaranteed(partition.lasting_reserve, partition.processors))
        yield f"start reservation, {later} afterwards"
    if partition.drift is not None and not partition.is_left_by_measurement:
        yield TITLES[partition.drift]


def _proven(proofs: Sequence[ComponentProof]) -> Sequence[str]:
    """Write a summary of thresholds held and when they were proven, and a line for each that does not hold."""
    sentences: list[str] = []
    for load in dict.fromkeys(proof.entry.interference for proof in proofs):
        of_load = [proof for proof in proofs if proof.entry.interference == load]
        holding = [proof for proof in of_load if proof.proven.met and not proof.outdated]
        times = sorted({proof_time(proof) for proof in holding})
        when = f", proven at {times[0]}" if times else ""
        when = f", the first proven at {times[0]}, the last at {times[-1]}" if len(times) > 1 else when
        thresholds = f"{len(holding)} of {counted(len(of_load), 'threshold')}"
        with_load = f"under {load}" if load else "without load"
        sentences.append(f"{thresholds} met with all components running {with_load}{when}.")
    for proof in proofs:
        if proof.outdated:
            sentences.append(f"{proof.entry.component} is outdated: {'; '.join(proof.outdated)}.")
        elif not proof.proven.met:
            threshold = show_threshold(proof.index, proof.proven.threshold)
            verdict = describe_verdict(proof.index, proof.proven.verdict)
            needed = f", about {proof.proven.samples_needed} samples needed" if proof.proven.samples_needed else ""
            setting = describe_proof_setting(proof)
            sentences.append(f"{proof.entry.component}, {proof.index.name} {threshold}: {verdict}{needed} ({setting}).")
    return list(dict.fromkeys(sentences))


OWNER = Column("application", wraps=True)
RUNS = (
    Column("when"),
    Column("run"),
    Column("plan"),
    OWNER,
    Column("by", wraps=True),
    Column("ending", wraps=True),
)


def describe_run(run: PastRun) -> str:
    """Write as `apply of plan 0123, done; by ann@lab, process 7, 2026-11-22 10:11:12 UTC`."""
    robot = f" on {run.robot}" if run.robot else ""
    return f"{_command(run)} of plan {run.plan}{robot}, {_ending(run)}; by {run.started_by}, {run.started_at}"


def history_text(history: History) -> "RenderableType":
    """Show the runs on each host, the last one first; an apply that was undone says so.

    The column of the application is left out if all runs are of the one that is asked for: the others need its room.
    """
    parts: list[RenderableType] = []
    is_shared = any(
        run.robot or run.application != history.application for runs in history.hosts.values() for run in runs
    )
    shown = [is_shared or column is not OWNER for column in RUNS]
    for host, runs in history.hosts.items():
        marked = history.unrecorded.get(host)
        parts.append(styled((f"Host {host}", STRONG), "" if runs or marked else "  no plan was applied here"))
        if marked:
            parts.append(paragraph(styled((describe_missing_journal(host, marked), CHANGED)), indent=2, more=2))
        rows = [tuple(compress(row, shown)) for row in history_rows(runs)]
        parts.append(Table(tuple(compress(RUNS, shown)), rows, indent=2))
    return stack(*parts)


def history_rows(runs: Sequence[PastRun]) -> Sequence[tuple[str, ...]]:
    """Return time, run, plan with application and robot, user, and ending; the last run first.

    Args:
        runs: of a host, the oldest first.
    """
    rows = []
    for number, run in enumerate(runs, start=1):
        whose = f"{run.application} on {run.robot}" if run.robot else run.application
        ending = _ending(run, runs[number:])
        rows.append((run.started_at, _command(run), run.plan, whose, run.started_by, ending))
    return rows[::-1]


def _command(run: PastRun) -> str:
    return run.purpose.value if run.run is RunKind.APPLY else run.run.value


def _ending(run: PastRun, later: Sequence[PastRun] = ()) -> str:
    """Return the ending of a run, or that a later run undid it."""
    undos = (other for other in later if other.run is RunKind.UNDO and other.plan == run.plan)
    if run.run is RunKind.APPLY and any(undo.closing is Closing.DONE for undo in undos):
        return "undone"
    return run.ending


def fit_text(fit: PlatformCapacity) -> str:
    """Write as `1.4 LP of 2 LP reserved (70 % of onboard). Headroom of onboard: 0.6 LP (30 % of onboard).`.

    What is kept for the hosts and what unmanaged machines have is named where there is some.

    While the reservation of a component is not known, the total begins with "at least" and no headroom is said.
    """
    unpromised, hosts = fit.unpromised_lp, ", ".join(fit.hosts)

    def amount(processors: Fraction) -> str:
        return f"{show_processors(processors)} ({share_of_host(processors, fit.processors, hosts)})"

    least = "at least " if fit.unknown else ""
    room = (
        f"Headroom of {hosts}: {amount(unpromised)}"
        if unpromised >= 0
        else f"Over {hosts} by {least}{amount(-unpromised)}"
    )
    if fit.unknown:
        room = f"Headroom of {hosts}: not known: {why_not_known(fit.unknown)}" if unpromised >= 0 else room
    share = share_of_host(fit.reserved_lp, fit.processors, hosts)
    reserved = f"{least}{show_processors(fit.reserved_lp)} of {show_processors(fit.processors)} reserved"
    return f"{reserved[:1].upper()}{reserved[1:]} ({share}){other_claims_text(fit)}. {room}."


def other_claims_text(fit: PlatformCapacity) -> str:
    """Write as `, 0.2 LP kept for the host`: neither reserved by the application nor headroom."""
    return "".join(f", {text}" for text in describe_other_claims(fit.unmanaged_lp, fit.kept_lp))


def applied_text(host: ComparedHost, *, is_planned: bool) -> Wording:
    """Write whether the host is as the manifest wants it, and the command that makes it so."""
    if not is_planned:
        return prose("The manifest cannot be applied: ", PLAN, " shows the causes.")
    if not host.to_apply:
        return "Applied: the host is as in the manifest."
    addresses_of: dict[str, list[str]] = {}
    for difference in host.to_apply:
        title = TITLES[DriftKind.NOT_APPLIED if difference.drift is DriftKind.MISSING else difference.drift]
        addresses_of.setdefault(title, []).append(str(difference.address))
    parts = "; ".join(f"{message}: {', '.join(addresses)}" for message, addresses in addresses_of.items())
    return prose(f"{parts[:1].upper()}{parts[1:]}. ", PLAN, " shows the changes, ", APPLY, " makes them.")
