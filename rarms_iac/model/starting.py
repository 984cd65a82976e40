"""The larger reservation that a partition has while it starts: `cpu: { starting: { reserve: 1 LP, for: 30 s } }`."""

from dataclasses import dataclass, replace

from rarms_iac.model.quantities import LogicalProcessors, per_virtual_processor
from rarms_iac.model.state import PartitionSettings

WHOLE = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class Starting:
    """What a partition reserves for some time from its start on."""

    reserve: LogicalProcessors
    time_ms: int


def settings_at_start(settings: PartitionSettings, starting: Starting | None) -> PartitionSettings | None:
    """Return the settings of a partition for the time of its start.

    A limit below the larger reservation is raised with it.

    Args:
        settings: The lasting ones.

    Returns:
        None where it starts with no more than it keeps.
    """
    if starting is None:
        return None
    reserve = min(WHOLE, per_virtual_processor(starting.reserve, settings.processors))
    if reserve <= settings.reserve:
        return None
    return replace(settings, reserve=reserve, limit=max(settings.limit, reserve))
