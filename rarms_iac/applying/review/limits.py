"""Limits of the manifest that a plan does not set, or that hold nothing back."""

from collections.abc import Iterator

from rarms_iac.applying.plan_request import PlanRequest
from rarms_iac.model.diagnostics import Diagnostic, Finding
from rarms_iac.model.host import Host
from rarms_iac.model.quantities import show_amount
from rarms_iac.model.wording import counted, list_names
from rarms_iac.planner.desired import Desired
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.sizes import OPEN, limit_in_manifest

NO_EFFECT = Finding.note("RARMS401", "A limit has no effect")

_REMOVE = "Remove the limit."


def review_limits_without_effect(request: PlanRequest, desired: Desired) -> Iterator[Diagnostic]:
    """Note each limit that another one replaces, that its partition does not get, or that is no less than its VPs."""
    system = request.system
    blocks = [each.cpu for each in system.components.values()] + [each.cpu for each in system.partitions.values()]
    if not any(block.limit for block in blocks):
        return  # only then the whole system is worth grouping again
    groups = {group.name: group for group in groups_of(system)}
    for partition in desired.partitions:
        group, processors = groups[partition.name], partition.settings.processors
        for section, name, reason, advice in _without_effect(group, system.hosts[desired.host], processors):
            limit = (system.partitions[name] if section == "partitions" else system.components[name]).cpu.limit
            assert limit is not None, "each has one"
            yield NO_EFFECT.at(
                request.places.value(section, name, "cpu", "limit"),
                'The limit of {limit} of "{name}" has no effect: {reason}.',
                advice,
                address=f"partition/{partition.name}",
                name=name,
                limit=show_amount(limit),
                reason=reason,
            )


def _without_effect(group: Group, host: Host, processors: int) -> Iterator[tuple[str, str, str, str]]:
    """Section and name of each such limit, the reason, and what to do."""
    own = group.request.cpu.limit is not None
    limited = [member.name for member in group.members if member.cpu.limit is not None]
    open_members = [member.name for member in group.members if member.cpu.limit is None]
    if own and len(group.members) > 1:
        for name in limited:
            yield "components", name, f"the partition {group.name} has a limit of its own", _REMOVE
    elif not own and open_members:
        for name in limited:
            reason = f"it shares the partition {group.name} with {list_names(open_members)} without a limit"
            yield "components", name, reason, "Give the partition a limit, or remove this one."
    if limit_in_manifest(group, host, processors) != OPEN:
        return
    reason = f"the partition {group.name} has {counted(processors, 'VP')} and can use no more than {processors} LP"
    for name in [group.name] if own else limited:
        yield "partitions" if own else "components", name, reason, _REMOVE
