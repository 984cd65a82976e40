"""The input of the reviews: one host's part of a plan, and what it rests on."""

from dataclasses import dataclass
from typing import assert_never

from rarms_iac.model.changes import Adopt, Change, Create, Delete, Release, Update
from rarms_iac.model.diagnostics import Places
from rarms_iac.model.layout import Layout
from rarms_iac.model.plan import HostPlan, Purpose
from rarms_iac.model.state import Partition, State
from rarms_iac.model.system import System


@dataclass(frozen=True, slots=True, kw_only=True)
class ReviewedPlan:
    """One host's part of a plan, with the host as it was observed."""

    system: System
    places: Places
    purpose: Purpose
    layout: Layout | None  # None: nothing is laid out, as in destroy
    observed: State
    plan: HostPlan
    remove_disks: bool = False  # whether that was asked for
    after_last_run: frozenset[str] | None = None  # partitions there when its last run ended; None: nobody knows

    @property
    def application(self) -> str:
        """The name of the application that the plan belongs to."""
        return self.system.application.name

    @property
    def host(self) -> str:
        """The host's name in the manifest."""
        return self.plan.host.name

    def is_managed(self, machine: Partition) -> bool:
        """Whether the machine carries a mark of this application."""
        return machine.mark is not None and machine.mark.application == self.application

    def partitions_after(self) -> tuple[Partition, ...]:
        """This application's partitions on the host once the plan is applied, by name."""
        partitions: dict[str, Partition] = {}
        names: dict[str, str] = {}  # by machine id
        for partition in self.observed.of(self.application).partitions:
            if partition.mark:
                partitions[partition.mark.name] = partition
                names[partition.id] = partition.mark.name
        for change in self.plan.changes:
            if change.address.partition and not change.address.task:
                partitions.pop(names.get(change.address.machine, change.address.partition), None)
        for change in self.plan.changes:
            if after := partition_after_change(change):
                partitions[change.address.partition] = after
        return tuple(after for _, after in sorted(partitions.items()))


def partition_after_change(change: Change) -> Partition | None:
    """A partition after its change; None where it is removed or released, or where it is no partition."""
    match change:
        case Create(after=after) | Update(after=after) | Adopt(after=after):
            return after if isinstance(after, Partition) else None
        case Delete() | Release():
            return None
        case _:
            assert_never(change)
