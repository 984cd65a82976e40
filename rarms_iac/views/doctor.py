"""What the doctor found: a short table of facts a host, then the findings."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rarms_iac.model.condition import HostCondition
from rarms_iac.model.diagnostics import Diagnostic, Severity, Sources
from rarms_iac.model.quantities import show_bytes, show_processors
from rarms_iac.model.state import HostFacts, State
from rarms_iac.views.as_json import as_json
from rarms_iac.views.diagnostics.layout import columns, visible
from rarms_iac.views.diagnostics.text import as_text
from rarms_iac.views.output.hosts import DoctorOutput, ExaminedOutput

HEALTHY = "Nothing here makes a plan void or unsafe."


@dataclass(frozen=True, slots=True, kw_only=True)
class Examined:
    """A host as it was looked at, and what was found there."""

    state: State
    condition: HostCondition
    findings: tuple[Diagnostic, ...]


def doctor_text(
    application: str, hosts: Sequence[Examined], sources: Sources, accepted: Sequence[Diagnostic] = ()
) -> str:
    """The whole answer as text without colour, ending with a line end."""
    lines = [line for host in hosts for line in (*_facts(host, application), "")]
    found = [finding for host in hosts for finding in host.findings]
    told = as_text(found, sources, accepted=accepted) if found or accepted else HEALTHY + "\n"
    return "\n".join([*lines, told])


def _facts(examined: Examined, application: str) -> Iterator[str]:
    facts = examined.state.facts
    yield f"Host {facts.name} ({facts.provider.value})"
    rows = [(name, visible(says, keep="")) for name, says in _rows(examined, application) if says]
    widest = max(columns(name) for name, _ in rows)
    for name, says in rows:
        yield f"  {name}{' ' * (widest - columns(name))}  {says}"


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
    seen = condition.seen_processors
    parts = [show_processors(facts.logical_processors)]
    parts += ["SMT"] if facts.smt else []
    parts += [f"{seen} of them seen by its own Windows"] if seen not in {None, facts.logical_processors} else []
    return ", ".join(parts)


def _machines(state: State, application: str) -> str:
    if not state.partitions:
        return "none seen"
    ours = len(state.of(application).partitions)
    running = sum(partition.settings.running for partition in state.partitions)
    return f"{len(state.partitions)}: {ours} of {application}, {running} running"


def doctor_json(application: str, hosts: Sequence[Examined], accepted: Sequence[Diagnostic] = ()) -> str:
    """The same for programs."""
    found = [finding for host in hosts for finding in host.findings]
    return as_json(
        DoctorOutput(
            application=application,
            hosts=tuple(_examined(host, application) for host in hosts),
            accepted=tuple(accepted),
            counts={
                f"{severity.value}s": sum(diagnostic.severity is severity for diagnostic in found)
                for severity in Severity
            },
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
