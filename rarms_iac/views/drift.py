"""What drifted: the host changed, or the manifest was not applied yet."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rarms_iac.diff.drift import DriftKind, ResourceDrift
from rarms_iac.model.changes import Address, Change
from rarms_iac.model.state import HostFacts
from rarms_iac.views.as_json import as_json
from rarms_iac.views.changes import attributes_of
from rarms_iac.views.console import STRONG, counted, paragraph, stack, styled
from rarms_iac.views.output.hosts import DriftedOutput, DriftOutput
from rarms_iac.views.plan_json import change_output

if TYPE_CHECKING:
    from rich.console import RenderableType


@dataclass(frozen=True, slots=True, kw_only=True)
class HostDrift:
    """What drifted on one host, and the changes that would bring it back, by address."""

    facts: HostFacts
    drifted: tuple[ResourceDrift, ...]
    changes: Mapping[Address, Change] = field(default_factory=dict)


TITLES = {
    DriftKind.HOST_CHANGED: "changed on the host",
    DriftKind.NOT_APPLIED: "not applied yet",
    DriftKind.BOTH: "changed on the host, and not applied yet",
    DriftKind.MISSING: "not there",
    DriftKind.REMOVED: "removed from the host",
    DriftKind.UNUSED: "unused",
}


def drift_text(hosts: Sequence[HostDrift]) -> "RenderableType":
    """Show of each difference what is there, and what the manifest wants."""
    parts = [part for host in hosts if host.drifted for part in _host(host)]
    if any(drifted.kind is not DriftKind.UNUSED for host in hosts for drifted in host.drifted):
        parts.append(paragraph("`rarms plan` shows what would make it as the manifest wants it."))
    return stack(*parts, paragraph(styled((_summary(hosts), STRONG))))


def _host(host: HostDrift) -> "Iterator[RenderableType]":
    yield styled((f"Host {host.facts.name}", STRONG))
    for drifted in host.drifted:
        change = host.changes.get(drifted.address)
        differing = "; ".join(
            f"{attribute.name} is {attribute.before}, wanted {attribute.after}"
            for attribute in (attributes_of(change, host.facts) if change is not None else ())
            if attribute.differs and attribute.before is not None and attribute.after is not None
        )
        name = str(drifted.address).removeprefix("partition/")
        text = styled((name, STRONG), f": {TITLES[drifted.kind]}; {differing or drifted.message}")
        yield paragraph(text, indent=2, more=4)
    yield ""


def _summary(hosts: Sequence[HostDrift]) -> str:
    kinds = [one.kind for host in hosts for one in host.drifted]
    changed = sum(kind.is_of_the_host for kind in kinds)
    waiting = sum(not kind.is_of_the_host and kind is not DriftKind.UNUSED for kind in kinds)
    unused = kinds.count(DriftKind.UNUSED)
    if not changed and not waiting:
        extra = f" {counted(unused, 'partition')} unused." if unused else ""
        return f"No drift. What rarms wrote is as it was, and as the manifest wants it.{extra}"
    parts = [f"{changed} changed on the host", f"{waiting} not applied yet"]
    return f"Drift: {', '.join(parts)}."


def drift_json(application: str, hosts: Sequence[HostDrift]) -> str:
    """The same for programs."""
    return as_json(
        DriftOutput(
            application=application,
            drifted=tuple(_drifted(host, drifted) for host in hosts for drifted in host.drifted),
        )
    )


def _drifted(host: HostDrift, drifted: ResourceDrift) -> DriftedOutput:
    change = host.changes.get(drifted.address)
    return DriftedOutput(
        host=host.facts.name,
        address=str(drifted.address),
        drift=drifted.kind.value,
        says=drifted.message,
        attributes=() if change is None else change_output(change).attributes,
    )
