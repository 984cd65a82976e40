"""What the doctor's checks are given, and what several of them ask of it."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from rarms_iac.model.condition import HostCondition, MachineCondition
from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.model.state import Partition, State


@dataclass(frozen=True, slots=True, kw_only=True)
class Examination:
    """A host, live or as it was written down; `condition` is empty where only its State is known."""

    state: State
    condition: HostCondition = field(default_factory=HostCondition)
    told: tuple[Diagnostic, ...] = ()  # what its provider found where it looked
    place: Place | None = None  # the manifest's line of the host

    @property
    def address(self) -> str:
        """As `policy.accept` names the host."""
        return f"host/{self.state.facts.name}"

    def machines(self) -> Iterator[tuple[Partition, MachineCondition]]:
        """Every machine with what is odd about it, by name."""
        odd = {machine.id.lower(): machine for machine in self.condition.machines}
        for partition in self.state.partitions:
            yield partition, odd.get(partition.id.lower(), MachineCondition(id=partition.id))


def address_of(machine: Partition) -> str:
    """A partition of ours by its name in the manifest, any other machine by its id."""
    return f"partition/{machine.mark.name}" if machine.mark else f"machine/{machine.id}"


def called(machine: Partition) -> str:
    """A machine for people: names are not unique."""
    return f'"{machine.settings.name}" ({machine.id[:8]})'
