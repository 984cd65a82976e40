"""`rarms doctor`: finds what is wrong with a host before anything is planned for it.

In: a `SeenHost`. Out: diagnostics in the order of their lines. Begin at `examine`; `windows` checks the operating
system, `machines` every partition and the logical processors. Nothing here changes a host.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

from rarms_iac.applying.doctor import machines, windows
from rarms_iac.diff.compare import foreign_marks
from rarms_iac.model.diagnostics import Diagnostic, Place, in_order
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.texts.findings import Finding

CHECKS: tuple[Callable[[SeenHost], Iterator[Diagnostic]], ...] = (
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
    machines.check_unequal_processors,
    windows.check_unread_probes,
    machines.check_thread_watcher,
    machines.check_cpu_group,
    machines.check_cluster,
    machines.check_machine_state,
    machines.check_guest_answers,
    machines.check_machine_width,
)

_OF_PLANS_TOO = (machines.UNFIT_MACHINE, machines.CPU_GROUP, machines.UNEQUAL)

DOCTOR_ONLY_CODES = frozenset(
    finding.code
    for checks in (windows, machines)
    for finding in vars(checks).values()
    if isinstance(finding, Finding) and finding not in _OF_PLANS_TOO
)
"""The codes that `rarms doctor` can find and no plan does: an acceptance of one is not unused in a plan."""


def examine(host: SeenHost, place: Place | None = None) -> tuple[Diagnostic, ...]:
    """Find everything that makes a plan for the host invalid or unsafe.

    Args:
        place: the manifest's line of the host, for the findings of checks.

    Returns:
        The diagnostics of all checks, of unknown marks, and of the provider, in order.
    """
    findings = [replace(diagnostic, place=place) for check in CHECKS for diagnostic in check(host)]
    return in_order((*findings, *foreign_marks(host.state), *host.findings))
