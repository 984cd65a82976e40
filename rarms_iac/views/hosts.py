"""Hosts for a reader: what the doctor found on them, and what drifted; each also as JSON for programs."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from rarms_iac.app.doctor import Examinations, ExaminedHost
from rarms_iac.app.drift import HostDrift
from rarms_iac.diff.drift import DriftKind, ResourceDrift
from rarms_iac.model.changes import Change
from rarms_iac.model.condition import HostCondition
from rarms_iac.model.diagnostics import Diagnostic, Sources
from rarms_iac.model.quantities import show_bytes, show_processors
from rarms_iac.model.state import HostFacts, State
from rarms_iac.model.wording import counted
from rarms_iac.views.changes import attributes_of, members_of, reserved_after
from rarms_iac.views.console import STRONG, paragraph, stack, styled, table
from rarms_iac.views.finding_forms import OutputFormat, count_severities, findings_as
from rarms_iac.views.findings import findings_text
from rarms_iac.views.output.common import as_json
from rarms_iac.views.output.hosts import (
    DoctorOutput,
    DriftedHostOutput,
    DriftedResourceOutput,
    DriftOutput,
    ExaminedHostOutput,
)
from rarms_iac.views.plan_json import change_output

if TYPE_CHECKING:
    from rich.console import RenderableType


HEALTHY = "Nothing here makes a plan ineffective or unsafe."


def doctor_as(form: OutputFormat, application: str, examined: Examinations, sources: Sources) -> "RenderableType":
    """Give an examination that form: text to be laid out, or else the text itself."""
    match form:
        case OutputFormat.TEXT:
            return doctor_text(application, examined.hosts, sources, examined.accepted)
        case OutputFormat.JSON:
            return doctor_json(application, examined.hosts, examined.accepted)
        case _:
            return findings_as(form, examined.findings, sources, accepted=examined.accepted)


def doctor_text(
    application: str, hosts: Sequence[ExaminedHost], sources: Sources, accepted: Sequence[Diagnostic] = ()
) -> "RenderableType":
    """Show the facts of each host, then the findings of all."""
    parts: list[RenderableType] = []
    for host in hosts:
        facts = host.state.facts
        rows = [row for row in _rows(host, application) if row[1]]
        parts += [styled((f"Host {facts.name} ({facts.provider.value})", STRONG)), table(rows, wrap=(1,), indent=2), ""]
    findings = [finding for host in hosts for finding in host.findings]
    healthy = not findings and not accepted
    return stack(*parts, HEALTHY if healthy else findings_text(findings, sources, accepted=accepted))


def _rows(examined: ExaminedHost, application: str) -> Iterator[tuple[str, str]]:
    facts, condition = examined.state.facts, examined.condition
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
    yield "machines", _machines(examined.state, application)


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


def _machines(state: State, application: str) -> str:
    if not state.partitions:
        return "none seen"
    managed = len(state.of(application).partitions)
    running = sum(partition.settings.running for partition in state.partitions)
    return f"{len(state.partitions)}: {managed} of {application}, {running} running"


def doctor_json(application: str, hosts: Sequence[ExaminedHost], accepted: Sequence[Diagnostic] = ()) -> str:
    """The same for programs."""
    findings = [finding for host in hosts for finding in host.findings]
    return as_json(
        DoctorOutput(
            application=application,
            hosts=tuple(_examined_output(host, application) for host in hosts),
            accepted=tuple(accepted),
            counts=count_severities(findings),
        )
    )


def _examined_output(examined: ExaminedHost, application: str) -> ExaminedHostOutput:
    facts, condition = examined.state.facts, examined.condition
    return ExaminedHostOutput(
        name=facts.name,
        provider=facts.provider.value,
        computer=facts.computer_name,
        os_build=facts.os_build,
        client=facts.client,
        scheduler=facts.scheduler.value,
        logical_processors=facts.logical_processors,
        seen_processors=condition.seen_processors,
        smt=facts.smt,
        memory=facts.memory,
        memory_available=condition.memory_available,
        rights=facts.rights.value,
        powershell=condition.powershell,
        module=condition.module,
        machines=len(examined.state.partitions),
        managed=len(examined.state.of(application).partitions),
        running=sum(machine.settings.running for machine in examined.state.partitions),
        findings=examined.findings,
    )


TITLES = {
    DriftKind.HOST_CHANGED: "changed on the host",
    DriftKind.NOT_APPLIED: "not applied yet",
    DriftKind.BOTH: "changed on the host, and not applied yet",
    DriftKind.MISSING: "not there",
    DriftKind.REMOVED: "removed from the host",
    DriftKind.UNUSED: "unused",
}


def drift_text(
    hosts: Sequence[HostDrift], unfinished: Collection[str] = (), problems: Sequence[Diagnostic] = ()
) -> "RenderableType":
    """Show of each difference what is there, and what the manifest wants.

    Args:
        hosts: what drifted on each.
        unfinished: names of hosts with an unfinished run: nothing can be planned there before it is finished.
        problems: why nobody knows what the manifest wants; empty: it was compared.
    """
    parts = [part for host in hosts if host.drifted for part in _host(host)]
    if unfinished:
        parts.append(paragraph(f"A run is unfinished on {', '.join(sorted(unfinished))}: `rarms apply` finishes it."))
    elif not problems and any(drifted.kind is not DriftKind.UNUSED for host in hosts for drifted in host.drifted):
        parts.append(paragraph("`rarms plan` shows what would make it as the manifest wants it."))
    if problems:
        codes = ", ".join(dict.fromkeys(f"{problem.code} ({problem.summary.lower()})" for problem in problems))
        parts.append(paragraph(f"The manifest was not compared: {codes}. `rarms plan` tells more."))
    return stack(*parts, paragraph(styled((_summary(hosts, compared=not problems), STRONG))))


def _host(host: HostDrift) -> "Iterator[RenderableType]":
    yield styled((f"Host {host.facts.name} ({show_processors(host.facts.logical_processors)})", STRONG))
    for drifted in host.drifted:
        change = host.changes.get(drifted.address)
        differing = "; ".join(
            f"{attribute.name} is {attribute.before}, wanted {attribute.after}"
            for attribute in (attributes_of(change, host.facts) if change is not None else ())
            if attribute.differs and attribute.before is not None and attribute.after is not None
        )
        name = str(drifted.address).removeprefix("partition/")
        beside = "" if drifted.address.task else members_of(drifted.address.partition, host.components)
        wanted = f"{beside}{_amount_wanted(change)}: {TITLES[drifted.kind]}; {differing or drifted.message}"
        text = styled((name, STRONG), wanted)
        yield paragraph(text, indent=2, more=4)
    yield ""


def _amount_wanted(change: Change | None) -> str:
    """`, 1.16 LP wanted`, of a partition that is to be there."""
    reserved = None if change is None else reserved_after(change)
    return "" if reserved is None else f", {show_processors(reserved)} wanted"


def _summary(hosts: Sequence[HostDrift], *, compared: bool) -> str:
    changed, waiting, unused = _counts(drifted for host in hosts for drifted in host.drifted)
    if not changed and not waiting:
        extra = f" {counted(unused, 'partition')} unused." if unused else ""
        wanted = ", and as the manifest wants it" if compared else ""
        return f"No drift. What rarms wrote is as it was{wanted}.{extra}"
    parts = [f"{changed} changed on the host", f"{waiting} not applied yet"]
    return f"Drift: {', '.join(parts)}."


def _counts(drifted: Iterable[ResourceDrift]) -> tuple[int, int, int]:
    """How many were changed on the host, are not applied yet, and are unused."""
    kinds = [resource.kind for resource in drifted]
    changed, unused = sum(kind.is_of_the_host for kind in kinds), kinds.count(DriftKind.UNUSED)
    return changed, len(kinds) - changed - unused, unused


def drift_json(application: str, hosts: Sequence[HostDrift], *, compared: bool = True) -> str:
    """The same for programs; `compared`: whether it is known what the manifest wants."""
    return as_json(
        DriftOutput(
            application=application,
            compared=compared,
            hosts=tuple(map(_host_output, hosts)),
            drifted=tuple(_drift_output(host, drifted) for host in hosts for drifted in host.drifted),
        )
    )


def _host_output(host: HostDrift) -> DriftedHostOutput:
    changed, waiting, unused = _counts(host.drifted)
    return DriftedHostOutput(
        name=host.facts.name,
        host_processors=host.facts.logical_processors,
        host_changed=changed,
        not_applied=waiting,
        unused=unused,
    )


def _drift_output(host: HostDrift, drifted: ResourceDrift) -> DriftedResourceOutput:
    change = host.changes.get(drifted.address)
    reserved = None if change is None else reserved_after(change)
    return DriftedResourceOutput(
        host=host.facts.name,
        address=str(drifted.address),
        components=() if drifted.address.task else host.components.get(drifted.address.partition, ()),
        wanted_processors=None if reserved is None else float(reserved),
        drift=drifted.kind.value,
        message=drifted.message,
        attributes=() if change is None else change_output(change).attributes,
    )


def snapshot_script_text(path: str, name: str) -> str:
    """Say how the script that looks, written to a path, is run on its host."""
    return (
        f"Wrote {path}. Run it on the host as administrator, and take what it prints along:\n"
        f"  powershell -NoProfile -ExecutionPolicy RemoteSigned -File {name} > host.json\n"
        "Plan from it with: rarms plan --snapshot HOST=host.json"
    )
