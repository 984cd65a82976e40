"""The input of the doctor's checks: a host's State, and its condition beside it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from rarms_iac.model.commands import Wording
from rarms_iac.model.condition import HostCondition, MachineCondition
from rarms_iac.model.diagnostics import Diagnostic, Facts, Finding, Place
from rarms_iac.model.state import Partition, State

NO_MORE_FACTS: Facts = MappingProxyType({})


@dataclass(frozen=True, slots=True, kw_only=True)
class Examination:
    """A host, live or from a snapshot; `condition` is empty where only its State is known."""

    state: State
    condition: HostCondition = field(default_factory=HostCondition)
    provider_findings: tuple[Diagnostic, ...] = ()  # what its provider reported when it observed the host
    place: Place | None = None  # the manifest's line of the host

    @property
    def name(self) -> str:
        """The host's name in the manifest."""
        return self.state.facts.name

    def machines(self) -> Iterator[tuple[Partition, MachineCondition]]:
        """Every machine with its condition, by name."""
        conditions = {machine.id.lower(): machine for machine in self.condition.machines}
        for machine in self.state.partitions:
            yield machine, conditions.get(machine.id.lower(), MachineCondition(id=machine.id))

    def host_finding(self, finding: Finding, detail: str, advice: Wording, values: Facts = NO_MORE_FACTS) -> Diagnostic:
        """Return a finding about the host itself; `values` without its name."""
        given: Mapping[str, Any] = values
        return finding.of_host(self.name, "{_detail}", advice, place=self.place, _detail=detail, **given)

    def machine_finding(
        self, finding: Finding, machine: Partition, detail: str, advice: Wording, values: Facts = NO_MORE_FACTS
    ) -> Diagnostic:
        """Return a finding about a machine: a partition of ours at its name in the manifest, another one at its id.

        `values` go without the names of host and machine.
        """
        given: Mapping[str, Any] = {"machine": machine.id, "name": machine.settings.name, **values}
        return finding.at(
            self.place,
            "{_detail}",
            advice,
            address=f"partition/{machine.mark.name}" if machine.mark else f"machine/{machine.id}",
            _detail=detail,
            host=self.name,
            **given,
        )


def machine_title(machine: Partition) -> str:
    """Return a machine for people: its name and the begin of its id, because names are not unique."""
    return f'"{machine.settings.name}" ({machine.id[:8]})'
