"""What the steps of a host depend on besides its changes."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from rarms_iac.model.capacity import Capacity, fits
from rarms_iac.model.claims import Claim
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.layout import Making
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.state import Disk, HostFacts, Partition, TaskClass
from rarms_iac.model.system import Disruption


@dataclass(frozen=True, slots=True, kw_only=True)
class HostContext:
    """The host, and what only some changes need: what its steps depend on besides the changes."""

    facts: HostFacts
    guest_builds: Mapping[str, int] = field(default_factory=dict)  # by id of a machine: of its Windows; absent: unknown
    making: Mapping[str, Making] = field(default_factory=dict)  # by partition: what only its making needs
    criticality: Mapping[str, int] = field(default_factory=dict)  # by partition: the highest of its members'
    disks: Mapping[str, tuple[Disk, ...]] = field(default_factory=dict)  # by id of a machine: those that go with it
    attached: Mapping[str, int] = field(default_factory=dict)  # by id of a machine: how many disks it has
    # By id of a machine that holds nothing that could be lost: rarms' task classes in its guest.
    restorable: Mapping[str, tuple[TaskClass, ...]] = field(default_factory=dict)
    graces: Mapping[str, Milliseconds] = field(default_factory=dict)  # by partition: for its guest to shut down

    @property
    def forces(self) -> bool:
        """Whether the host can force a guest to shut down that was asked to."""
        return self.facts.provider is not ProviderKind.LINUX


@dataclass(frozen=True, slots=True, kw_only=True)
class StepBudget:
    """The capacity that the steps on a host share, and how much they may disturb."""

    capacity: Capacity
    foreign: tuple[Claim, ...] = ()  # of machines that this application does not manage
    managed: Mapping[str, Partition] = field(default_factory=dict)  # by machine id, before the first step
    criticality: Mapping[str, int] = field(default_factory=dict)  # by partition
    max_disruption: Disruption = Disruption.HOST_RESTART
    graces: Mapping[str, Milliseconds] = field(default_factory=dict)  # by partition: for its guest to shut down
    forces: bool = True  # the host can force a guest to shut down
    remaining: Mapping[str, str] = field(default_factory=dict)  # by partition: another host, where the plan leaves it

    def fits(self, claims: Iterable[Claim]) -> bool:
        """Tell whether these claims of managed partitions fit the host together with the foreign ones.

        It is False also if it is unknown whether virtual processors find logical ones (`model.capacity.fits`).
        """
        return fits(self.capacity, (*self.foreign, *claims))

    def rank(self, partition: str) -> tuple[int, str]:
        """Return criticality, 0 if it is not known, and name: the least critical is sorted first."""
        return self.criticality.get(partition, 0), partition
