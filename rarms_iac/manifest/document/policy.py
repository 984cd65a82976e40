"""`policy`, `tasks`: what rarms may do and prefers."""

from typing import Annotated

from pydantic import Field

from rarms_iac.manifest.document.base import Block, KeysLike, Maybe, needed, optional
from rarms_iac.manifest.document.texts import CODE_PATTERN, Code, Day, Filled, Name
from rarms_iac.model.system import Disruption, Headroom, Minimise, TaskCategory

Level = Annotated[int, Field(ge=1, le=8)]


class AcceptanceBlock(Block):
    """A finding that is known and borne."""

    at: Annotated[list[Filled], Field(min_length=1)] = needed("Where: addresses as the finding names them.")
    reason: str = optional("Why it is borne.", "")
    until: Maybe[Day] = optional("The last day (UTC) it is borne: `2027-01-31`; absent: for good.")


class PolicyBlock(Block):
    """What rarms may do and prefers."""

    interference: Name = optional("The load that reservations must stand up to.", "busy-loop")
    minimise: Annotated[Minimise, Field(strict=False)] = optional(
        "`combining`: rather reserve more than combine; `reservation`: rather combine than reserve more.", "combining"
    )
    headroom: Annotated[Headroom, Field(strict=False)] = optional(
        "Who gets what is left over: `by_criticality`, `equal` or `none`.", "by_criticality"
    )
    max_disruption: Annotated[Disruption, Field(strict=False)] = optional(
        "The most that a change may disturb: `live`, `partition_stop`, `host_restart` or `removal`.", "host_restart"
    )
    accept: Maybe[Annotated[dict[Code, AcceptanceBlock], KeysLike(CODE_PATTERN)]] = optional(
        "Findings that are known and borne, by their id."
    )


class TaskBlock(Block):
    """What is fixed of a robotic task class; the rest is left to the planner."""

    category: Maybe[Annotated[TaskCategory, Field(strict=False)]] = optional(
        "The band of thread priorities: `High` (one priority for all), `Medium` or `Low`."
    )
    priority: Maybe[Level] = optional(
        "1 to 8, larger goes first; orders threads in category Medium only, where 8 counts as 7."
    )
    background_priority: Maybe[Level] = optional("1 to 8, larger goes first; orders threads in category Low only.")
    replace_shipped: bool = optional("Needed to change a task class that comes with Windows.", False)
