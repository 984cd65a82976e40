"""Every check of the doctor, one a file."""

from rarms_iac.apply.doctor.checks import (
    automatic_checkpoints,
    clustered_machine,
    cpu_group,
    dynamic_memory,
    execution_policy,
    half_width_process,
    machine_not_at_rest,
    minroot,
    no_module,
    not_looked_at,
    old_powershell,
    pending_restart,
    power_plan,
    responsiveness,
    threads_of_a_core,
    void_host,
    wide_machine,
)

OWN = (
    responsiveness,
    no_module,
    threads_of_a_core,
    cpu_group,
    power_plan,
    dynamic_memory,
    automatic_checkpoints,
    pending_restart,
    old_powershell,
    execution_policy,
    half_width_process,
    minroot,
    clustered_machine,
    machine_not_at_rest,
    wide_machine,
    not_looked_at,
)
"""In the order of their codes."""

CHECKS = (void_host, *OWN)
"""Those, and the one that asks what plans ask, too."""

ASKED_BY_THE_DOCTOR = frozenset(one.FINDING.code for one in OWN if one is not wide_machine)
"""The codes that `rarms doctor` can find and no plan does: an acceptance of one is not unused in a plan."""

__all__ = ["ASKED_BY_THE_DOCTOR", "CHECKS"]
