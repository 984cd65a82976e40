"""Starting partitions after a start of the machine: `rarms start --boot`."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from rarms_iac.app.hosts import host_errors
from rarms_iac.app.wiring import start_after_boot
from rarms_iac.storage.writing import owner


@dataclass(frozen=True, slots=True, kw_only=True)
class StartedPartitions:
    """The partitions of this machine that were started, by slice."""

    started: Mapping[str, tuple[str, ...]]
    kind: Literal["started"] = "started"


def start_partitions_after_boot(timeout_ms: int) -> StartedPartitions:
    """Start what is off on this machine, a Linux host, though no run stopped it. No manifest is read.

    Args:
        timeout_ms: how long to wait for each slice that another run holds; 0: not at all.

    Returns:
        What was started; where rarms keeps nothing, there is nothing.

    Raises:
        UseCaseError: another run holds a slice (refused), or a partition does not start (failed).
    """
    with host_errors():
        return StartedPartitions(started=start_after_boot(owner(), timeout_ms))
