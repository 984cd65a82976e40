"""What the manual integration guide of a component says, from manifest and data logs."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class GuideFacts:
    """What is to be set for one component."""

    component: str
    partition: str
    beside: tuple[str, ...]  # other components of the partition
    apt: tuple[str, ...]  # `mean_response_time at most 100 ms`
    platform: str
    reserve: int  # whole per cent of each virtual processor
    limit: int
    weight: int
    processors: int  # virtual
    host_processors: int
    memory_mib: int
    task: str | None
    task_values: tuple[str, ...]  # `Priority = 5 (DWORD)`
    command: str
    rests_on: str  # what the reserve comes from
    shortest_ms: float | None  # the shortest response time that a threshold allows
