"""What drifted on hosts: each difference with what is there and what the manifest wants."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from rarms_iac.app.drift import ComparedHost, DriftReport
from rarms_iac.diff.drift import DriftKind
from rarms_iac.model.commands import APPLY, PLAN, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.quantities import show_processors
from rarms_iac.model.wording import counted, in_a_row, natural_order
from rarms_iac.views.changes import attributes_of, members_of
from rarms_iac.views.console import STRONG, paragraph, stack, styled

if TYPE_CHECKING:
    from rich.console import RenderableType


TITLES = {
    DriftKind.HOST_CHANGED: "changed on the host",
    DriftKind.NOT_APPLIED: "not applied yet",
    DriftKind.BOTH: "changed on the host, and not applied yet",
    DriftKind.MISSING: "not there",
    DriftKind.REMOVED: "removed from the host",
    DriftKind.UNUSED: "unused",
}


def drift_text(report: DriftReport) -> "RenderableType":
    """Show of each difference what is there, and what the manifest wants."""
    parts = [part for host in report.hosts if host.drifted for part in _drifted_host(host)]
    problems = report.problems
    if report.unfinished:
        names = ", ".join(sorted(report.unfinished, key=natural_order))
        parts.append(paragraph(prose(f"A run is unfinished on {names}: ", APPLY, " finishes it.")))
    elif not problems and PLAN in report.commands:
        parts.append(paragraph(prose(PLAN, " shows what would make it as the manifest wants it.")))
    if problems:
        reasons = name_findings(problems)
        parts.append(paragraph(prose(f"The manifest was not compared: {reasons}. ", PLAN, " tells more.")))
    return stack(*parts, paragraph(styled((_summary(report), STRONG))))


def name_findings(findings: Sequence[Diagnostic]) -> str:
    """`RARMS014 (reservations exceed the platform)`, each once."""
    return ", ".join(dict.fromkeys(f"{finding.code} ({finding.summary})" for finding in findings))


def _drifted_host(host: ComparedHost) -> "Iterator[RenderableType]":
    yield styled((f"Host {host.name} ({show_processors(host.host_lp)})", STRONG))
    for drifted in sorted(host.drifted, key=lambda each: natural_order(str(each.address))):
        address, change = drifted.address, drifted.change
        differing = "; ".join(
            f"{attribute.name} is {attribute.before}, wanted {attribute.after}"
            for attribute in (attributes_of(change, host.seen.facts) if change is not None else ())
            if attribute.differs and attribute.before is not None and attribute.after is not None
        )
        name = address.in_short
        members = members_of(address.partition, {address.partition: drifted.components})
        amount = None if change is None else change.reserved_lp
        wanted = "" if amount is None else f", {show_processors(amount)} wanted"
        text = f"{members}{wanted}: {TITLES[drifted.drift]}; {differing or drifted.message}"
        yield paragraph(styled((name, STRONG), text), indent=2, more=4)
    yield ""


def _summary(report: DriftReport) -> str:
    changed = sum(host.host_changed for host in report.hosts)
    waiting = sum(host.not_applied for host in report.hosts)
    unused = sum(host.unused for host in report.hosts)
    if not changed and not waiting:
        extra = f" {counted(unused, 'partition')} unused." if unused else ""
        if not any(host.is_written for host in report.hosts):
            return f"No drift. Nothing of {report.application} is on {in_a_row([host.name for host in report.hosts])}."
        wanted = "" if report.problems else ", and match the manifest"
        return f"No drift. The partitions of rarms are unchanged{wanted}.{extra}"
    return f"Drift: {changed} changed on the host, {waiting} not applied yet."
