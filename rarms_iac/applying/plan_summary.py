"""What a plan promises on a host, and what its threads run at: for the reader, nothing is decided by it."""

from collections.abc import Iterator, Mapping, Sequence

from rarms_iac.diff.claims import NO_CLAIM, claim_of
from rarms_iac.model.capacity import foreign_claims
from rarms_iac.model.changes import Adopt, Change, Delete, Release
from rarms_iac.model.claims import load_of
from rarms_iac.model.plan import Step, ThreadClass, Totals
from rarms_iac.model.state import Partition, State, StoppedBy
from rarms_iac.model.system import System
from rarms_iac.planner.groups import most_critical_first
from rarms_iac.planner.task_classes import ClassValues


def totals_of(
    observed: State, desired: State, application: str, changes: Sequence[Change], steps: Sequence[Step]
) -> Totals:
    """The promises to this application's partitions after these steps, and those to all others then.

    A machine that is taken over or let go of changes sides, and keeps what it has. One that is wanted, or that
    `rarms stop` stopped, and does not run is promised what the layout or its settings give it, as the planner counts.
    """
    claims = {
        partition.mark.name: claim_of(partition) for partition in observed.of(application).partitions if partition.mark
    }
    renamed: dict[str, str] = {
        partition.id: partition.mark.name for partition in observed.of(application).partitions if partition.mark
    }
    for step in steps:
        address = step.address
        if address.partition and not address.task:
            claims.pop(renamed.get(address.machine, ""), None)
            claims[address.partition] = step.claim_after
    others = list(foreign_claims(observed, application))
    for change in changes:
        match change:
            case Adopt(before=Partition(claims_resources=True) as before):
                others.remove(before.claim)
            case Release(before=Partition() as before):
                claims.pop(change.address.partition, None)
                others += [before.claim] if before.claims_resources else []
            case _:
                pass
    removed = {change.address.partition for change in changes if isinstance(change, Delete)}
    stopped = {
        partition.mark.name: partition.claim
        for partition in observed.of(application).partitions
        if partition.mark and partition.mark.stopped_by is not StoppedBy.NOBODY and partition.mark.name not in removed
    }
    layout = stopped | {partition.settings.name: partition.claim for partition in desired.partitions}
    idle = load_of(layout[name] for name, claim in claims.items() if claim == NO_CLAIM and name in layout)
    own, foreign = load_of(claims.values()), load_of(others)
    return Totals(
        percent=own.percent + idle.percent,
        memory=own.memory + idle.memory,
        others_percent=foreign.percent,
        others_memory=foreign.memory,
        idle_percent=idle.percent,
        idle_memory=idle.memory,
    )


Decided = Mapping[tuple[str, str], ClassValues]
"""By partition (empty: the host) and class."""


def threads_of(decided: Decided, system: System, members: Mapping[str, tuple[str, ...]]) -> tuple[ThreadClass, ...]:
    """The robotic classes of every operating system, the host's own first, the highest threads first.

    Args:
        decided: what the planner chose.
        system: what the manifest says.
        members: by partition (empty: the host) the components whose threads run there.
    """
    made = [
        ThreadClass(
            inside=inside,
            task=name,
            category=values.category.value,
            thread_priority=values.thread_priority,
            components=tuple(user for user in _users(system, members.get(inside, ()), name)),
        )
        for (inside, name), values in decided.items()
    ]
    return tuple(
        sorted(made, key=lambda thread_class: (thread_class.inside, -thread_class.thread_priority, thread_class.task))
    )


def _users(system: System, members: tuple[str, ...], task: str) -> Iterator[str]:
    users = [system.components[name] for name in members]
    named = [user for user in users if user.task is not None and user.task.lower() == task.lower()]
    yield from (component.name for component in most_critical_first(named))
