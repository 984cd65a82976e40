"""What the doctor found: a short table of facts a host, then the findings."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rarms_iac.model.condition import HostCondition
from rarms_iac.model.diagnostics import Diagnostic, Sources
from rarms_iac.model.quantities import show_bytes, show_processors
from rarms_iac.model.state import HostFacts, State
from rarms_iac.views.as_json import as_json
from rarms_iac.views.console import STRONG, stack, styled, table
from rarms_iac.views.finding_forms import count_severities
from rarms_iac.views.findings import findings_text
from rarms_iac.views.output.hosts import DoctorOutput, ExaminedOutput

if TYPE_CHECKING:
    from rich.console import RenderableType

HEALTHY = "Nothing here makes a plan void or unsafe."


@dataclass(frozen=True, slots=True, kw_only=True)
class Examined:
    """A host as it was looked at, and what was found there."""

    state: State
    condition: HostCondition
    findings: tuple[Diagnostic, ...]


def doctor_text(
    application: str, hosts: Sequence[Examined], sources: Sources, accepted: Sequence[Diagnostic] = ()
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


def _rows(examined: Examined, application: str) -> Iterator[tuple[str, str]]:
    facts, condition = examined.state.facts, examined.condition
    yield "computer", facts.computer_name
    yield "Windows", _windows(facts)
    yield "PowerShell", condition.powershell or ""
    yield "module Hyper-V", _module(condition)
    yield "scheduler", "" if facts.scheduler.value == "none" else facts.scheduler.value
    yield "processors", _processors(facts, condition)
    yield "memory", show_bytes(facts.memory)
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


def doctor_json(application: str, hosts: Sequence[Examined], accepted: Sequence[Diagnostic] = ()) -> str:
    """The same for programs."""
    findings = [finding for host in hosts for finding in host.findings]
    return as_json(
        DoctorOutput(
            application=application,
            hosts=tuple(_examined(host, application) for host in hosts),
            accepted=tuple(accepted),
            counts=count_severities(findings),
        )
    )


def _examined(examined: Examined, application: str) -> ExaminedOutput:
    facts, condition = examined.state.facts, examined.condition
    return ExaminedOutput(
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
        rights=facts.rights.value,
        powershell=condition.powershell,
        module=condition.module,
        machines=len(examined.state.partitions),
        managed=len(examined.state.of(application).partitions),
        running=sum(machine.settings.running for machine in examined.state.partitions),
        findings=examined.findings,
    )
