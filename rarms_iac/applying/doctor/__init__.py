"""`rarms doctor`: finds what is wrong with a host before anything is planned for it.

In: a host's State and `HostCondition` (`Examination`). Out: diagnostics in the order of their lines. Begin at
`examine`; `windows` checks the operating system, `machines` every virtual machine. Nothing here changes a host.
"""

from collections.abc import Callable, Iterator

from rarms_iac.applying.doctor import machines, windows
from rarms_iac.applying.doctor.examination import Examination
from rarms_iac.diff.compare_partitions import foreign_marks
from rarms_iac.model.diagnostics import Diagnostic, in_order

CHECKS: tuple[Callable[[Examination], Iterator[Diagnostic]], ...] = (
    windows.check_hypervisor,
    windows.check_preconditions,
    windows.check_elevation,
    windows.check_free_memory,
    windows.check_counters,
    windows.check_running_script,
    windows.check_responsiveness,
    windows.check_module,
    windows.check_core_scheduler,
    windows.check_power_plan,
    windows.check_pending_restart,
    windows.check_powershell_version,
    windows.check_execution_policy,
    windows.check_process_width,
    windows.check_minroot,
    windows.check_unread_probes,
    machines.check_cpu_group,
    machines.check_dynamic_memory,
    machines.check_automatic_checkpoints,
    machines.check_cluster,
    machines.check_machine_state,
    machines.check_guest_answers,
    machines.check_machine_width,
)

DOCTOR_ONLY_CODES = frozenset(
    finding.code
    for finding in (
        windows.RESPONSIVENESS_VALUE,
        windows.NO_MODULE,
        windows.CORE_SCHEDULER,
        windows.POWER_PLAN,
        windows.PENDING_RESTART,
        windows.OLD_POWERSHELL,
        windows.EXECUTION_POLICY,
        windows.NARROW_PROCESS,
        windows.MINROOT,
        windows.UNREAD_PROBE,
        machines.CPU_GROUP,
        machines.DYNAMIC_MEMORY,
        machines.AUTOMATIC_CHECKPOINTS,
        machines.CLUSTERED,
        machines.MACHINE_STATE,
        windows.NO_HYPERVISOR,
        windows.NOT_ELEVATED,
        windows.LITTLE_MEMORY,
        windows.NO_COUNTERS,
        windows.SCRIPT_RUNNING,
        machines.MUTE_GUEST,
    )
)
"""The codes that `rarms doctor` can find and no plan does: an acceptance of one is not unused in a plan."""


def examine(host: Examination) -> tuple[Diagnostic, ...]:
    """Find everything that makes a plan for the host invalid or unsafe.

    Args:
        host: what was observed, live or from a snapshot.

    Returns:
        The diagnostics of all checks, of unknown marks, and of the provider, in order.
    """
    findings = [diagnostic for check in CHECKS for diagnostic in check(host)]
    return in_order((*findings, *foreign_marks(host.state), *host.provider_findings))
