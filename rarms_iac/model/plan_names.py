"""The names in a plan that was read: file names, folders and registry keys are made of them."""

from collections.abc import Iterable, Iterator
from itertools import chain

from rarms_iac.model.changes import Address
from rarms_iac.model.names import is_name
from rarms_iac.model.plan import HostPlan, Plan, Step
from rarms_iac.model.renaming import BETWEEN
from rarms_iac.model.task_names import is_task


def wrong_name_of_plan(plan: Plan) -> str | None:
    """Return a name in a plan that no manifest can give; None: there is none."""
    if not is_name(plan.application):
        return plan.application
    if plan.robot and not is_name(plan.robot):
        return plan.robot
    return next((name for part in plan.hosts if (name := wrong_name(part, part.steps)) is not None), None)


def wrong_name(part: HostPlan, steps: Iterable[Step]) -> str | None:
    """Return a name in a host's part of a plan, or in these steps, that no manifest can give; None: there is none.

    Names that machines have on their host are not looked at: others than rarms give them.
    """
    addresses = tuple(_addresses(part, steps))
    names = chain([part.host.name], *part.components.values(), *(thread.components for thread in part.threads))
    partitions = chain(
        (address.partition for address in addresses),
        (partition.name for partition in part.unused),
        part.stopped,
        part.components,
        (thread.inside for thread in part.threads),
    )
    tasks = chain((address.task for address in addresses), (thread.task for thread in part.threads))
    wrong = chain(
        (name for name in names if not is_name(name)),
        (name for name in partitions if name and not is_name(name.removesuffix(BETWEEN))),
        (name for name in tasks if name and not is_task(name)),
    )
    return next(wrong, None)


def _addresses(part: HostPlan, steps: Iterable[Step]) -> Iterator[Address]:
    yield from (change.address for change in part.changes)
    yield from (held_back.change.address for held_back in part.held_back)
    yield from (task.address for task in part.guest_tasks or ())
    for step in steps:
        yield step.address
        for operation in (step.operation, step.undo.operation):
            partition = getattr(operation, "partition", "") or getattr(operation, "inside", "")
            yield Address(partition=partition, task=getattr(operation, "task", ""))
