"""Hosts for a reader: what the doctor found on them, and what drifted; each also as JSON for programs."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rarms_iac.app.doctor import Examinations, ExaminedHost
from rarms_iac.app.drift import DriftReport, HostDrift
from rarms_iac.diff.drift import DriftKind
from rarms_iac.model.commands import APPLY, PLAN, prose
from rarms_iac.model.condition import HostCondition
from rarms_iac.model.diagnostics import Sources
from rarms_iac.model.quantities import show_bytes, show_processors
from rarms_iac.model.state import HostFacts
from rarms_iac.model.wording import counted
from rarms_iac.views.changes import attributes_of, members_of
from rarms_iac.views.console import STRONG, paragraph, stack, styled, table
from rarms_iac.views.finding_forms import OutputFormat, findings_as
from rarms_iac.views.findings import findings_text
from rarms_iac.views.json_output import json_of

if TYPE_CHECKING:
    from rich.console import RenderableType


HEALTHY = "Nothing here makes a plan ineffective or unsafe."


def doctor_as(form: OutputFormat, examined: Examinations, sources: Sources) -> "RenderableType":
    """Give an examination that form: text to be laid out, or else the text itself."""
    match form:
        case OutputFormat.TEXT:
            return doctor_text(examined, sources)
        case OutputFormat.JSON:
            return json_of(examined)
        case _:
            return findings_as(form, examined.findings, sources, accepted=examined.accepted)


def doctor_text(examined: Examinations, sources: Sources) -> "RenderableType":
    """Show the facts of each host, then the findings of all."""
    parts: list[RenderableType] = []
    for host in examined.hosts:
        rows = [row for row in _rows(host, examined.application) if row[1]]
        title = f"Host {host.facts.name} ({host.facts.provider.value})"
        parts += [styled((title, STRONG)), table(rows, wrap=(1,), indent=2), ""]
    findings, accepted = examined.findings, examined.accepted
    healthy = not findings and not accepted
    return stack(*parts, HEALTHY if healthy else findings_text(findings, sources, accepted=accepted))


def _rows(examined: ExaminedHost, application: str) -> Iterator[tuple[str, str]]:
    facts, condition = examined.facts, examined.condition
    yield "computer", facts.computer_name
    yield "Windows", _windows(facts)
    yield "PowerShell", condition.powershell or ""
    yield "module Hyper-V", _module(condition)
    yield "scheduler", "" if facts.scheduler.value == "none" else facts.scheduler.value
    yield "processors", _processors(facts, condition)
    available = condition.memory_available
    free = "" if available is None else f", {show_bytes(available)} left for machines"
    yield "memory", show_bytes(facts.memory) + free
    yield "rights", facts.rights.value
    yield "machines", _machines(examined, application)


def _windows(facts: HostFacts) -> str:
    return f"build {facts.os_build}, {'client' if facts.client else 'server'}" if facts.os_build else ""


def _module(condition: HostCondition) -> str:
    return "" if condition.module is None else ", ".join(condition.module) or "not installed"


def _processors(facts: HostFacts, condition: HostCondition) -> str:
    seen = condition.seen_processors  # by the host's own Windows
    parts = [show_processors(facts.logical_processors)]
    parts += ["SMT"] if facts.smt else []
    parts += [f"{seen} of them seen by its own Windows"] if seen not in {None, facts.logical_processors} else []
    return ", ".join(parts)


def _machines(examined: ExaminedHost, application: str) -> str:
    if not examined.machines:
        return "none seen"
    return f"{examined.machines}: {examined.managed} of {application}, {examined.running} running"


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
    parts = [part for host in report.hosts if host.drifted for part in _host(host)]
    problems = report.problems
    if report.unfinished:
        names = ", ".join(sorted(report.unfinished))
        parts.append(paragraph(prose(f"A run is unfinished on {names}: ", APPLY, " finishes it.")))
    elif not problems and any(host.host_changed or host.not_applied for host in report.hosts):
        parts.append(paragraph(prose(PLAN, " shows what would make it as the manifest wants it.")))
    if problems:
        codes = ", ".join(dict.fromkeys(f"{problem.code} ({problem.summary.lower()})" for problem in problems))
        parts.append(paragraph(prose(f"The manifest was not compared: {codes}. ", PLAN, " tells more.")))
    return stack(*parts, paragraph(styled((_summary(report), STRONG))))


def _host(host: HostDrift) -> "Iterator[RenderableType]":
    yield styled((f"Host {host.name} ({show_processors(host.host_lp)})", STRONG))
    for drifted in host.drifted:
        address, change = drifted.address, drifted.change
        differing = "; ".join(
            f"{attribute.name} is {attribute.before}, wanted {attribute.after}"
            for attribute in (attributes_of(change, host.facts) if change is not None else ())
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
        wanted = "" if report.problems else ", and as the manifest wants it"
        return f"No drift. What rarms wrote is as it was{wanted}.{extra}"
    return f"Drift: {changed} changed on the host, {waiting} not applied yet."


def snapshot_script_text(path: str, name: str) -> str:
    """Say how the script that looks, written to a path, is run on its host."""
    return (
        f"Wrote {path}. Run it on the host as administrator, and take what it prints along:\n"
        f"  powershell -NoProfile -ExecutionPolicy RemoteSigned -File {name} > host.json\n"
        "Plan from it with: rarms plan --snapshot HOST=host.json"
    )
