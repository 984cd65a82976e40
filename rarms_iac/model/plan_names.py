"""The names in a plan or journal that was read: names of files, folders and registry keys are made of them."""

from rarms_iac.model.names import BETWEEN, is_name, is_task
from rarms_iac.model.plan import HostPlan


def wrong_name(part: HostPlan) -> str | None:
    """Return a name in a host's part of a plan that no manifest can give; None: there is none.

    Names that machines have on their host are not looked at: others than rarms give them.
    """
    held_back = [held.change for held in part.held_back]
    addresses = [each.address for each in (*part.changes, *held_back, *part.steps, *(part.guest_tasks or ()))]
    operations = [operation for step in part.steps for operation in (step.operation, step.undo.operation)]
    partitions = [address.partition for address in addresses]
    partitions += [getattr(each, "partition", "") or getattr(each, "inside", "") for each in operations]
    tasks = [address.task for address in addresses] + [getattr(each, "task", "") for each in operations]
    wrong = [
        *([] if is_name(part.host.name) else [part.host.name]),
        *(name for name in partitions if name and not is_name(name.removesuffix(BETWEEN))),
        *(name for name in tasks if name and not is_task(name)),
    ]
    return wrong[0] if wrong else None
