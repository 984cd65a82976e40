"""What the findings on a plan are given: one host's part of it, and what it rests on."""

from dataclasses import dataclass
from typing import assert_never

from rarms_iac.model.changes import Adopt, Change, Create, Delete, Release, Update
from rarms_iac.model.diagnostics import Places
from rarms_iac.model.layout import Layout
from rarms_iac.model.plan import HostPlan, Purpose
from rarms_iac.model.state import Partition, PartitionSettings, State
from rarms_iac.model.system import System


@dataclass(frozen=True, slots=True, kw_only=True)
class Reviewed:
    """One host's part of a plan, with the host as it was observed."""

    system: System
    places: Places
    purpose: Purpose
    layout: Layout | None  # None: nothing is laid out, as in destroy
    observed: State
    plan: HostPlan
    remove_disks: bool = False  # whether that was asked for

    @property
    def application(self) -> str:
        """Whose plan it is."""
        return self.system.application.name

    def is_ours(self, machine: Partition) -> bool:
        """Whether it carries a mark of this application."""
        return machine.mark is not None and machine.mark.application == self.application

    def settings_after(self) -> tuple[PartitionSettings, ...]:
        """What our partitions on the host are once the plan is done, by name."""
        now = {
            partition.mark.name: partition.settings
            for partition in self.observed.of(self.application).partitions
            if partition.mark
        }
        by_id = {
            partition.id: partition.mark.name
            for partition in self.observed.of(self.application).partitions
            if partition.mark
        }
        for change in self.plan.changes:
            if change.address.partition and not change.address.task:
                now.pop(by_id.get(change.address.machine, change.address.partition), None)
        for change in self.plan.changes:
            after = made_of(change)
            if after is not None:
                now[change.address.partition] = after
        return tuple(settings for _, settings in sorted(now.items()))


def made_of(change: Change) -> PartitionSettings | None:
    """What a partition of ours is after its change; None where it goes, is let go, or is no partition."""
    match change:
        case Create(after=after) | Update(after=after) | Adopt(after=after):
            return after.settings if isinstance(after, Partition) else None
        case Delete() | Release():
            return None
        case _:
            assert_never(change)
