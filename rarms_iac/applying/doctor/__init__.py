"""`rarms doctor`: finds what is wrong with a host before anything is planned for it.

In: a host's State and `HostCondition` (`Examination`). Out: diagnostics in the order of their lines. Begin at
`examine`; `windows` checks the operating system, `machines` every virtual machine. Nothing here changes a host.
"""

from collections.abc import Callable, Iterator

from rarms_iac.applying.doctor import machines, processors, windows
from rarms_iac.applying.doctor.examination import Examination
from rarms_iac.applying.doctor.machines import UNFIT_MACHINE
from rarms_iac.diff.compare_partitions import foreign_marks
from rarms_iac.model.diagnostics import Diagnostic, Finding, in_order

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
    windows.check_powershell_version,
    windows.check_execution_policy,
    windows.check_process_width,
    windows.check_minroot,
    processors.check_unequal_processors,
    windows.check_unread_probes,
    machines.check_cpu_group,
    machines.check_cluster,
    machines.check_machine_state,
    machines.check_guest_answers,
    machines.check_machine_width,
)

DOCTOR_ONLY_CODES = frozenset(
    finding.code
    for checks in (windows, machines)
    for finding in vars(checks).values()
    if isinstance(finding, Finding) and finding not in (UNFIT_MACHINE, machines.CPU_GROUP)  # plans find them
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
