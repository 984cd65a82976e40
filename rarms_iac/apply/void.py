"""What makes looking at a host, or planning for it, worth nothing (DESIGN section 5)."""

from collections.abc import Iterable, Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.state import HostFacts, Rights, State
from rarms_iac.model.system import SchedulerType

NO_RIGHTS = Finding(code="RARMS158", severity=Severity.ERROR, summary="Without rights, nothing seen proves nothing")
SCHEDULER = Finding(
    code="RARMS159",
    severity=Severity.ERROR,
    summary="The host's scheduler does not honour reserves",
    acceptable=True,
)


def unproven(observed: Iterable[State], places: Places) -> Iterator[Diagnostic]:
    """The hosts of which we do not know that we see everything: they may look empty and be full."""
    for state in observed:
        if state.facts.rights is not Rights.PROVEN:
            yield no_rights(state.facts, places)


def no_rights(facts: HostFacts, places: Places | None = None) -> Diagnostic:
    """One of them."""
    says = "has no right to" if facts.rights is Rights.MISSING else "could not prove that it may"
    return NO_RIGHTS.at(
        places.key("hosts", facts.name) if places else None,
        f"On {facts.name}, rarms {says} manage machines: those that are there cannot be seen, let alone changed.",
        "Run as an administrator of the host; on a simulated one, say `administrator: true`.",
        address=f"host/{facts.name}",
    )


def ignored(desired: State, places: Places) -> Iterator[Diagnostic]:
    """A host on which the wanted reserves, limits or weights would have no effect, or none that is known."""
    facts = desired.facts
    why = _why_ignored(facts)
    asked = [one.settings.name for one in desired.partitions if one.settings.reserve or one.settings.limit < 100]
    if why and asked:
        yield SCHEDULER.at(
            places.key("hosts", facts.name),
            f"{facts.name} {why}: reserve, limit and weight of {', '.join(asked)} would be stored without effect.",
            "Choose the classic or the core scheduler where its Windows allows that (`bcdedit /set "
            "{hypervisorsettings} hypervisorschedulertype core`, then a restart), take another host, or accept "
            f"RARMS159 at host/{facts.name}.",
            address=f"host/{facts.name}",
        )


def _why_ignored(facts: HostFacts) -> str:
    """In words; nothing where reserves count. A client Windows whose scheduler is not known has the root scheduler."""
    match facts.scheduler:
        case SchedulerType.ROOT:
            return "runs the root scheduler"
        case SchedulerType.UNKNOWN if facts.client:
            return "is a client Windows, and those run the root scheduler"
        case SchedulerType.UNKNOWN:
            return "does not tell which scheduler it runs"
        case SchedulerType.CLASSIC | SchedulerType.CORE | SchedulerType.NONE:
            return ""
