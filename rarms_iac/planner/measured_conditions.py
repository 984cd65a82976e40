"""The conditions of measured reservations that a host should still have: the frequency governor, and enough memory."""

from collections.abc import Iterator, Sequence
from math import ceil

from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.layout import LookedUp
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.planner import planning_findings
from rarms_iac.texts.messages import in_a_row
from rarms_iac.texts.quantities import show_bytes, write_bytes

MEMORY_FACTOR = 1.2
"""A partition's memory over the peak that was measured: a plan warns where it is less."""

_MEBIBYTE = 2**20

Measured = tuple[tuple[str, ...], LookedUp]
"""The names of a partition's components, and what their data logs say."""


def other_governor(seen: SeenHost, measured: Sequence[Measured], places: Places) -> Iterator[Diagnostic]:
    """Report that a host sets its processors' frequency otherwise than while its components were measured.

    Args:
        measured: Of the partitions that are to run there.
    """
    now = seen.facts.governor
    others = [(names, found.governors) for names, found in measured if set(found.governors) - {now}]
    if not now or not others:
        return
    components = tuple(sorted({name for names, _ in others for name in names}))
    governors = tuple(sorted({each for _, found in others for each in found} - {now}))
    yield planning_findings.OTHER_GOVERNOR.of_host(
        seen.name,
        "{host} uses the governor {governor}; {components:all} {_were} measured with {_measured}. Jobs may take more "
        "or less time than measured.",
        prose(
            f"Set the governor {governors[0]} on {seen.name}. Or measure again: ",
            command("measure", *components, again=True),
            ".",
        ),
        place=places.key("hosts", seen.name),
        governor=now,
        measured_with=governors,
        components=components,
        _were="was" if len(components) == 1 else "were",
        _measured=in_a_row(governors),
    )


def little_memory(names: tuple[str, ...], memory: int, found: LookedUp, places: Places) -> Iterator[Diagnostic]:
    """Report that a partition's memory is less than `MEMORY_FACTOR` times the peak that was measured.

    Args:
        memory: Of the partition, bytes.
    """
    if memory >= MEMORY_FACTOR * found.memory_peak:
        return
    enough = ceil(MEMORY_FACTOR * found.memory_peak / _MEBIBYTE) * _MEBIBYTE
    yield planning_findings.LITTLE_MEMORY.at(
        places.value("components", names[0], "memory"),
        (
            "{components:all} used up to {_peak} in the measurement, and {_have} {_memory}. The kernel ends "
            "processes at the limit."
        ),
        prose(
            f"Write `memory: {write_bytes(enough)}` or more, 1.2 times the peak. The data log is valid for the "
            "present memory only. Then measure again: ",
            command("measure", *names, together=len(names) > 1),
            ".",
        ),
        address=f"component/{names[0]}",
        components=names,
        memory_bytes=memory,
        peak_bytes=found.memory_peak,
        _have="has" if len(names) == 1 else "have together",
        _memory=show_bytes(memory, found.memory_peak),
        _peak=show_bytes(found.memory_peak, memory),
    )
