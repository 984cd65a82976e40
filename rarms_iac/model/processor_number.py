"""How many virtual processors a partition has, and where that number comes from."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from rarms_iac.model.system import Component


class ProcessorSource(Enum):
    """Where the number of a partition's virtual processors comes from."""

    MANIFEST = "manifest"  # `processors` of the partition, or of each of its components
    USED = "used"  # the most that its components were seen to use at once
    MEMBERS = "members"  # those of its components together, at most the host's
    HOST = "host"  # the host's: never measured, or what is used could not be seen


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessorNumber:
    """A number of virtual processors with its source."""

    number: int
    source: ProcessorSource


Used = Callable[[tuple[str, ...]], int | None]
"""The most processors that components, by sorted names, were seen to use at once together; None: that was not seen."""


def never_seen(_names: tuple[str, ...]) -> None:
    """Return a `Used` for nothing measured."""


def together(numbers: Sequence[int], host_lp: int) -> int:
    """Add up the virtual processors of components that share a partition.

    Args:
        numbers: of each of them, at least one.

    Returns:
        Their sum, at most the host's number; never fewer than one of them has.
    """
    return max(*numbers, min(sum(numbers), host_lp))


RARE = 0.01
"""A part of the time with a job under way: threads at once for no longer do not count."""


def most_at_once(times: Mapping[int, float], under_way: float) -> int:
    """Find the most threads that ran, or waited for a processor, at once.

    Args:
        times: how long so many did, by their number, in any unit.
        under_way: how long a job was under way, in the same unit.

    Returns:
        The greatest number that lasted for more than `RARE` of that time together with all above it; at least 1.
    """
    so_long = 0.0
    for threads in sorted(times, reverse=True):
        so_long += times[threads]
        if so_long > RARE * under_way:
            return max(1, threads)
    return 1


def processor_number(
    members: Sequence[Component], requested: int | None, host_lp: int, used: Used = never_seen
) -> ProcessorNumber:
    """Say how many virtual processors a partition has.

    Args:
        members: all of its components, at least one.
        requested: what the manifest says of the partition itself; None: nothing.

    Returns:
        What the manifest fixes, else what its components were seen to use, else the host's number.
    """
    if requested is not None:
        return ProcessorNumber(number=requested, source=ProcessorSource.MANIFEST)
    fixed = [member.processors for member in members if member.processors is not None]
    if len(fixed) == len(members):
        return ProcessorNumber(number=together(fixed, host_lp), source=ProcessorSource.MANIFEST)
    most = used(tuple(sorted(member.name for member in members)))
    if most is not None:
        return ProcessorNumber(number=min(most, host_lp), source=ProcessorSource.USED)
    alone = [member.processors or used((member.name,)) for member in members] if len(members) > 1 else []
    known = [number for number in alone if number is not None]
    if known and len(known) == len(members):
        return ProcessorNumber(number=together(known, host_lp), source=ProcessorSource.MEMBERS)
    return ProcessorNumber(number=host_lp, source=ProcessorSource.HOST)
