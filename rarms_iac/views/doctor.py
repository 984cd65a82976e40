"""`rarms doctor` and `rarms install`: facts of each host with the findings of all, and what was installed."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rarms_iac.app.doctor import Examinations
from rarms_iac.app.install import HostInstallation, Installation
from rarms_iac.app.manifests import Manifest
from rarms_iac.model.commands import DOCTOR, START_AT_BOOT, STATUS, prose
from rarms_iac.model.diagnostics import Sources
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.seen_host import Condition, SeenHost
from rarms_iac.model.state import HostFacts
from rarms_iac.texts.quantities import show_bytes, show_processors
from rarms_iac.views.console import STRONG, paragraph, stack, styled
from rarms_iac.views.finding_forms import OutputFormat, findings_as
from rarms_iac.views.findings_text import findings_text
from rarms_iac.views.json_output import json_of
from rarms_iac.views.table import Column, Table

if TYPE_CHECKING:
    from rich.console import RenderableType


FACTS = (Column("fact"), Column("value", wraps=True))

HEALTHY = prose("No problems found: the hosts can honour reservations. Next: ", STATUS)


def doctor_as(form: OutputFormat, examined: Examinations, manifest: Manifest) -> "RenderableType":
    """Give an examination that form: text to be laid out, or else the text itself."""
    match form:
        case OutputFormat.TEXT:
            return doctor_text(examined, manifest.sources)
        case OutputFormat.JSON:
            return json_of(examined)
        case _:
            return findings_as(
                form, examined.findings, manifest.sources, places=manifest.places, accepted=examined.accepted
            )


def doctor_text(examined: Examinations, sources: Sources) -> "RenderableType":
    """Show the facts of each host, then the findings of all."""
    parts: list[RenderableType] = []
    for host in examined.hosts:
        rows = [row for row in _rows(host, examined.application) if row[1]]
        title = f"Host {host.name} ({host.facts.provider.value})"
        parts += [styled((title, STRONG)), Table(FACTS, rows, header=False, indent=2), ""]
    findings, accepted = examined.findings, examined.accepted
    healthy = not findings and not accepted
    return stack(*parts, paragraph(HEALTHY) if healthy else findings_text(findings, sources, accepted=accepted))


def _rows(examined: SeenHost, application: str) -> Iterator[tuple[str, str]]:
    facts, condition = examined.facts, examined.condition
    yield "computer", facts.computer_name
    kind = "client" if facts.client else "server"
    build = f"build {facts.os_build}, {kind}" if facts.os_build else ""
    if facts.provider is ProviderKind.SIMULATED:
        yield "simulates", f"Windows, {build}" if build else ""
    else:
        yield "Windows", build
    yield "PowerShell", condition.powershell or ""
    yield "module Hyper-V", "" if condition.module is None else ", ".join(condition.module) or "not installed"
    yield "scheduler", "" if facts.scheduler.value == "none" else facts.scheduler.value
    yield "processors", _processors(facts, condition)
    available = examined.memory_left
    free = "" if available is None else f", {show_bytes(available)} left for machines"
    yield "memory", show_bytes(facts.memory) + free
    yield "rights", facts.rights.value
    yield "partitions", _partitions(examined, application)


def _processors(facts: HostFacts, condition: Condition) -> str:
    seen = condition.seen_processors  # by the host's own Windows
    parts = [show_processors(facts.logical_processors)]
    parts += ["SMT"] if facts.smt else []
    parts += [f"{seen} of them in its own Windows"] if seen not in {None, facts.logical_processors} else []
    return ", ".join(parts)


def _partitions(examined: SeenHost, application: str) -> str:
    if not examined.machines:
        return "none seen"
    return f"{examined.machines}: {examined.managed} of {application}, {examined.running} running"


HOSTS = (Column("host"), Column("rarms", wraps=True), Column("machine", wraps=True), Column("sent", right=True))


def installation_text(result: Installation) -> "RenderableType":
    """Show a line for each host, and the next command."""
    rows = [(host.host, _became(host), f"Python {host.python}, {host.machine}", _sent(host)) for host in result.hosts]
    finished = [
        paragraph(f"{host.host}: rarms {run.version} finished its run of plan {run.plan}.")
        for host in result.hosts
        for run in host.finished
    ]
    without_boot = [host.host for host in result.hosts if host.changed and host.version and not host.boot]
    boot = f"{', '.join(without_boot)}: systemd and cron are not available. Run this at each start of the machine: "
    return stack(
        Table(HOSTS, rows),
        *finished,
        paragraph(prose(boot, START_AT_BOOT, ".")) if without_boot else None,
        paragraph(prose("Next: ", DOCTOR)) if any(host.version for host in result.hosts) else None,
    )


def _became(host: HostInstallation) -> str:
    if not host.version:
        return f"rarms {host.before} removed" if host.before else "rarms is not installed"
    if not host.changed:
        return f"rarms {host.version} is already installed"
    was = f", was {host.before}" if host.before and host.before != host.version else ""
    return f"rarms {host.version} installed{was}"


def _sent(host: HostInstallation) -> str:
    return f"{host.sent_bytes / 1e6:.0f} MB" if host.sent_bytes else ""
