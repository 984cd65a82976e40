"""What a Linux host refuses: settings that no control group can have, and what it has no room for. Pure."""

from rarms_iac.model.quantities import show_bytes
from rarms_iac.model.state import Partition, PartitionSettings, State
from rarms_iac.running.kernel_files import MOST_PROCESSORS

LONGEST_NAME = 100
_SHORTEST_PERIOD_US, _LONGEST_PERIOD_US = 1_000, 1_000_000
"""The kernel refuses other periods (Documentation/scheduler/sched-bwc.rst)."""


def out_of_range(settings: PartitionSettings) -> str:
    """Describe the first setting that no control group can have; empty where all are possible.

    NOTE: a limit below the reserve is possible. It may have been written by hand, and the undo of its repair does.
    """
    if not 0 < len(settings.name) <= LONGEST_NAME or "/" in settings.name or settings.name in {".", ".."}:
        return f"a partition's name has 1 to {LONGEST_NAME} characters and no slash"
    if not 1 <= settings.processors <= MOST_PROCESSORS:
        return f"a partition has 1 to {MOST_PROCESSORS} processors, not {settings.processors}"
    if not 0 <= settings.reserve <= 100 or not 0 <= settings.limit <= 100:
        return f"reserve and limit are 0 to 100 %, not {settings.reserve} % and {settings.limit} %"
    if settings.limit < 1:
        return "with a limit of 0 % nothing would run: the limit is at least 1 %"
    if not 1 <= settings.weight <= 10_000:
        return f"a weight is 1 to 10000, not {settings.weight}"
    if not 0 <= settings.memory < 2**63:
        return f"memory is at least 0 B and less than 8 EiB, not {settings.memory} B"
    if not _SHORTEST_PERIOD_US <= (settings.quota_period_us or _SHORTEST_PERIOD_US) <= _LONGEST_PERIOD_US:
        return f"a quota has a period of 1 ms to 1 s, not {settings.quota_period_us} us"
    return "a control group has no dynamic memory" if settings.dynamic_memory else ""


def lack_of_memory(wanted: PartitionSettings, machine: str, state: State) -> str:
    """Describe the memory that is missing for a partition beside those that run; empty: there is enough.

    Args:
        machine: its id.
    """
    taken = sum(other.settings.memory for other in _others_running(machine, state))
    if taken + wanted.memory <= state.facts.memory:
        return ""
    free = max(0, state.facts.memory - taken)
    needed, room = show_bytes(wanted.memory, free), show_bytes(free, wanted.memory)
    return f"{wanted.name} needs {needed}, and of {show_bytes(state.facts.memory)} {room} are free"


def lack_of_reserve(wanted: PartitionSettings, machine: str, state: State) -> str:
    """Describe why a reserve does not fit beside those of the partitions that run; empty: it fits.

    Args:
        machine: its id.
    """
    available = state.facts.logical_processors
    if not wanted.reserve:
        return ""
    if wanted.processors > available:
        return f"{wanted.name} has {wanted.processors} processors with a reserve, and the host has {available}"
    taken = sum(other.settings.reserve * other.settings.processors for other in _others_running(machine, state))
    if taken + wanted.reserve * wanted.processors <= 100 * available:
        return ""
    return (
        f"the reserve of {wanted.name}, {wanted.reserve} % of each of {wanted.processors} processors, "
        f"does not fit {available} logical processors beside what runs"
    )


def _others_running(machine: str, state: State) -> list[Partition]:
    return [other for other in state.partitions if other.id != machine and other.settings.running]
