"""What a script says of its partitions before its first step: one line each, for the person who reviews it. Pure."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from math import ceil

from rarms_iac.model.operations import CreatePartition, RemovePartition, StartPartition, StopPartition, WriteMark
from rarms_iac.model.plan import Step

_TOLD_BY_A_WORD = (CreatePartition, RemovePartition, StartPartition, StopPartition, WriteMark)


def owner_of(step: Step) -> str:
    """The partition that a step belongs to, or the address of a task class of the system itself."""
    return step.address.partition or str(step.address)


def partition_summaries(steps: Iterable[Step]) -> Iterator[str]:
    """One line for each partition and task class, by name: added, removed, changed or stopped, and how.

    Args:
        steps: of one script, in their order.
    """
    for owner, own in groupby(sorted(steps, key=owner_of), key=owner_of):
        yield _summary(owner, list(own))


def _summary(owner: str, steps: Sequence[Step]) -> str:
    kinds = {type(step.operation) for step in steps}
    changes = [step.title for step in steps if not isinstance(step.operation, _TOLD_BY_A_WORD)]
    words = [word for kind, word in ((CreatePartition, "added"), (RemovePartition, "removed")) if kind in kinds]
    if not words and (changes or kinds <= {WriteMark}):
        words = ["changed"]
    words += ["stopped"] if StopPartition in kinds else []
    words += ["started"] if StartPartition in kinds else []
    line = f"{owner}: {', '.join(words)}"
    if changes and CreatePartition not in kinds:
        line += f" ({'; '.join(changes)})"
    stops = [step for step in steps if isinstance(step.operation, StopPartition)]
    return ". ".join([line, *(_describe_downtime(stop, StartPartition in kinds) for stop in stops[:1])])


def describe_stop(step: Step) -> str:
    """Say how long a stop takes, at least and at most."""
    assert isinstance(step.operation, StopPartition)
    grace = _seconds(step)
    if grace == 0:
        return "Turned off at once."
    return f"Asks the guest to shut down, and turns it off after {grace} s: takes at least 0 s, at most {grace} s."


def _describe_downtime(stop: Step, started: bool) -> str:
    """From the stop to the start; how long the guest needs to start is not known here."""
    grace = _seconds(stop)
    if not started:
        return f"It is off after {grace} s at the latest, and stays off"
    if grace == 0:
        return "It is down for as long as it takes to start"
    return f"It is down for at least as long as it takes to start, and at most {grace} s longer"


def _seconds(stop: Step) -> int:
    assert isinstance(stop.operation, StopPartition)
    return ceil(stop.operation.grace_ms / 1000)
