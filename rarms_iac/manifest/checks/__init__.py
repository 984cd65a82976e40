"""Everything that can be judged from the manifest alone: one module a topic, one function a check.

A checked `System` comes in, ordered findings go out. `CHECKS` lists every check with its finding; a check yields a
`Violation` for each case, and `run_checks` makes findings with places of them. Begin with `violation.Violation` and any
topic: `names`, `partitions`, `hosts`, `processors`, `tasks`, `measurement`, `secrets`.
"""

from collections.abc import Iterator, Mapping
from datetime import date
from itertools import islice

from rarms_iac.manifest.acceptance import FINDINGS as ABOUT_ACCEPTANCES
from rarms_iac.manifest.acceptance import check_acceptances
from rarms_iac.manifest.checks import hosts, measurement, names, partitions, processors, secrets, tasks
from rarms_iac.manifest.checks.violation import Check, of_components, of_hosts, of_partitions
from rarms_iac.model.diagnostics import MOST_OF_A_KIND, Diagnostic, Finding, Places, following, in_order
from rarms_iac.model.system import System

CHECKS: Mapping[Finding, Check] = {
    names.OLDER_THAN_REQUIRED: names.older_than_required,
    names.UNKNOWN_NAME: names.unknown_name,
    names.DEVICE_NAME: names.device_name,
    names.POWERSHELL_NAME: names.powershell_name,
    names.PARTITION_LIKE_HOST: names.partition_like_host,
    names.TEST_PARTITION_NAME: names.test_partition_name,
    names.MOVED_IN_A_CIRCLE: names.moved_in_a_circle,
    names.MOVED_FROM_EXISTING: names.moved_from_existing,
    names.NO_COMPONENTS: names.no_components,
    names.UNUSED_INTERFERENCE: names.unused_interference,
    partitions.SEVERAL_PARTITIONS: partitions.several_partitions,
    partitions.HOST_COMPONENT_IN_PARTITION: partitions.host_component_in_partition,
    partitions.HOST_COMPONENT_WITH_CPU: of_components(partitions.host_component_with_cpu),
    partitions.PARTITION_OF_ANOTHER_NAME: of_partitions(partitions.partition_of_another_name),
    partitions.TOGETHER_AND_APART: partitions.together_and_apart,
    partitions.TOGETHER_WITH_ITSELF: of_components(partitions.together_with_itself),
    partitions.DEDICATED_SHARES: partitions.dedicated_shares,
    partitions.APART_IN_ONE_PARTITION: of_partitions(partitions.apart_in_one_partition),
    partitions.TOGETHER_IS_SEPARATED: partitions.together_is_separated,
    partitions.NO_COMMON_HOST: partitions.no_common_host,
    hosts.NOTHING_KEPT_FOR_HOST: hosts.nothing_kept_for_host,
    hosts.CONNECT_TO_SIMULATED: of_hosts(hosts.connect_to_simulated),
    hosts.NOT_BY_WINRM: of_hosts(hosts.not_by_winrm),
    hosts.PLATFORM_OF_DIFFERENT_HOSTS: hosts.platform_of_different_hosts,
    hosts.PATH_ON_WINDOWS: hosts.path_on_windows,
    hosts.SECURE_BOOT_OF_GENERATION_1: hosts.secure_boot_of_generation_1,
    hosts.RESPONSIVENESS_NOT_AS_IS: hosts.responsiveness_not_as_is,
    processors.RESERVE_OVER_LIMIT: processors.reserve_over_limit,
    processors.RESERVE_OVER_HOST: processors.reserve_over_host,
    processors.RESERVE_BEYOND_PARALLELISM: processors.reserve_beyond_parallelism,
    processors.RESERVE_OVER_PROCESSORS: processors.reserve_over_processors,
    processors.MORE_PROCESSORS_THAN_HOST: processors.more_processors_than_host,
    processors.DIFFERENT_CPU: of_partitions(processors.different_cpu),
    processors.HELD_BACK: processors.held_back,
    processors.WEIGHT_ON_LINUX: processors.weight_on_linux,
    processors.RESERVE_ROUNDED_UP: processors.reserve_rounded_up,
    processors.CRITICALITIES_ALIKE: processors.criticalities_alike,
    partitions.PARTITION_MEMORY_BELOW_MEMBERS: of_partitions(partitions.partition_memory_below_members),
    partitions.MEMORY_OVER_HOST: partitions.memory_over_host,
    partitions.MEMORY_NOT_OF_HYPERV: partitions.memory_not_of_hyperv,
    tasks.SHIPPED_TASK: tasks.shipped_task,
    tasks.UNKNOWN_TASK: tasks.unknown_task,
    tasks.TASK_DIFFERS_IN_CASE: tasks.task_differs_in_case,
    tasks.SHARED_TASK: tasks.shared_task,
    tasks.UNUSED_TASK: tasks.unused_task,
    tasks.TASK_LIKE_A_VALUE: tasks.task_like_a_value,
    measurement.NO_SAMPLE_IN_TIME: of_components(measurement.no_sample_in_time),
    measurement.TIMEOUT_BEFORE_THRESHOLD: of_components(measurement.timeout_before_threshold),
    measurement.INDEX_WITHOUT_FIELD: of_components(measurement.index_without_field),
    measurement.MISS_RATE_WITHOUT_DEADLINE: of_components(measurement.miss_rate_without_deadline),
    measurement.PATTERN_IS_NOT_RE2: measurement.pattern_is_not_re2,
    measurement.PATTERN_WITHOUT_GROUP: measurement.pattern_without_group,
    measurement.TOO_FEW_SAMPLES: measurement.samples_not_to_be_had,
    measurement.MEASURED_WITHOUT_APT: of_components(measurement.measured_without_apt),
    measurement.WEAK_LOADS: measurement.weak_loads,
    measurement.NOTHING_TO_RUN: of_components(measurement.nothing_to_run),
    secrets.SECRET_IN_CLEAR: secrets.secret_in_clear,
    secrets.SECRET_IN_ENVIRONMENT: of_components(secrets.secret_in_environment),
}
"""Every check that asks the manifest alone, by its finding."""

CODES = frozenset(finding.code for finding in (*CHECKS, *ABOUT_ACCEPTANCES))
"""The codes that `run_checks` can give: an acceptance of another code may yet be needed by another command."""


def run_checks(system: System, places: Places, today: date) -> tuple[Diagnostic, ...]:
    """Report everything that is wrong or odd about what the manifest means, in order.

    Args:
        system: what the manifest says, its structure checked.
        places: where it says so.
        today: the day in UTC that acceptances expire against.

    Returns:
        Of a kind that the policy accepts somewhere all of them, of another the first `MOST_OF_A_KIND` and how many
        follow: places are looked up for those that can be shown, not for every one of 390,000.
    """

    def findings() -> Iterator[Diagnostic]:
        for finding, check in CHECKS.items():
            violations = check(system)
            most = None if finding.code in system.policy.accept else MOST_OF_A_KIND
            shown = [violation.as_diagnostic(finding, places) for violation in islice(violations, most)]
            yield from shown
            if more := sum(1 for _ in violations):
                yield following(shown[-1], more)
        yield from check_acceptances(system.policy, places, today)

    return in_order(tuple(findings()))
