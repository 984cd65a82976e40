"""What can be told from the manifest alone: one check a file, each with its finding (DESIGN section 9)."""

from collections.abc import Callable, Iterator
from datetime import date
from functools import partial
from pathlib import Path

from rarms_iac.manifest.acceptance import FINDINGS as ABOUT_ACCEPTANCES
from rarms_iac.manifest.acceptance import check_acceptances
from rarms_iac.manifest.checks import (
    apart_in_one_partition,
    connect_to_simulated,
    dedicated_shares,
    device_name,
    host_component_in_partition,
    host_component_with_cpu,
    index_without_field,
    measured_without_apt,
    measured_without_log,
    memory_not_whole_mebibytes,
    memory_over_host,
    miss_rate_without_deadline,
    more_processors_than_host,
    moved_from_existing,
    moved_in_a_circle,
    no_common_host,
    no_components,
    no_sample_in_time,
    nothing_kept_for_host,
    nothing_to_run,
    order_not_expressed,
    partition_like_host,
    partition_memory_below_members,
    partition_of_another_name,
    path_on_windows,
    pattern_is_not_re2,
    pattern_without_group,
    platform_of_different_hosts,
    promised_less,
    reserve_beyond_parallelism,
    reserve_over_host,
    reserve_over_limit,
    reserve_over_processors,
    responsiveness_not_as_is,
    secret_in_clear,
    secret_in_environment,
    several_partitions,
    shared_task,
    shipped_task,
    task_differs_in_case,
    task_like_a_value,
    test_partition_name,
    timeout_before_threshold,
    together_and_apart,
    together_is_separated,
    too_few_samples,
    two_wishes_for_cpu,
    unknown_name,
    unknown_task,
    unused_interference,
    unused_task,
)
from rarms_iac.manifest.checks.measured_without_log import DataLogs, LogsInFolder
from rarms_iac.model.diagnostics import Diagnostic, Places, in_order
from rarms_iac.model.system import System

__all__ = ["CHECKS", "LOOKED_FOR", "DataLogs", "LogsInFolder", "checks_beside", "run_checks"]

CHECKS = (
    apart_in_one_partition,
    connect_to_simulated,
    dedicated_shares,
    device_name,
    host_component_in_partition,
    host_component_with_cpu,
    index_without_field,
    measured_without_apt,
    memory_not_whole_mebibytes,
    memory_over_host,
    miss_rate_without_deadline,
    more_processors_than_host,
    moved_from_existing,
    moved_in_a_circle,
    no_common_host,
    no_components,
    no_sample_in_time,
    nothing_kept_for_host,
    nothing_to_run,
    order_not_expressed,
    partition_like_host,
    partition_memory_below_members,
    partition_of_another_name,
    path_on_windows,
    pattern_is_not_re2,
    pattern_without_group,
    platform_of_different_hosts,
    promised_less,
    reserve_beyond_parallelism,
    reserve_over_host,
    reserve_over_limit,
    reserve_over_processors,
    responsiveness_not_as_is,
    secret_in_clear,
    secret_in_environment,
    several_partitions,
    shared_task,
    shipped_task,
    task_differs_in_case,
    task_like_a_value,
    test_partition_name,
    timeout_before_threshold,
    together_and_apart,
    together_is_separated,
    too_few_samples,
    two_wishes_for_cpu,
    unknown_name,
    unknown_task,
    unused_interference,
    unused_task,
)
"""Every check that asks the manifest alone."""

LOOKED_FOR = frozenset(
    one.code for one in (*(check.FINDING for check in (*CHECKS, measured_without_log)), *ABOUT_ACCEPTANCES)
)
"""The codes that `run_checks` can give: an acceptance of another code may yet be needed by another command."""


def run_checks(system: System, places: Places, today: date, *, logs: DataLogs | None = None) -> tuple[Diagnostic, ...]:
    """Everything wrong or odd about what the manifest means, in order.

    Args:
        system: what the manifest says, its structure checked.
        places: where it says so.
        today: the day in UTC that acceptances expire against.
        logs: the data logs, where nobody plans yet; without, it is for the planner to miss one.
    """

    def told() -> Iterator[Diagnostic]:
        for check in CHECKS:
            yield from check.check(system, places)
        if logs is not None:
            yield from measured_without_log.check(system, places, logs)
        yield from check_acceptances(system.policy, places, today)

    return in_order(tuple(told()))


def checks_beside(folder: Path) -> Callable[[System, Places, date], tuple[Diagnostic, ...]]:
    """`run_checks` for a manifest in that folder, whose data logs lie in `measurements/` beside it."""
    return partial(run_checks, logs=LogsInFolder(folder / "measurements"))
