"""The doctor's checks of the virtual machines on a host, managed or not."""

from collections.abc import Iterator

from rarms_iac.applying.doctor.examination import Examination, machine_title
from rarms_iac.model.diagnostics import Diagnostic, Finding
from rarms_iac.model.state import RunState

UNFIT_MACHINE = Finding.warning("RARMS245", "A machine is not as rarms needs it")


CPU_GROUP = Finding.warning("RARMS235", "A machine is in a CPU group")


def check_cpu_group(host: Examination) -> Iterator[Diagnostic]:
    """Yield a machine in a CPU group draws only on the group's logical processors and cap (windows.md 2)."""
    for machine in host.state.partitions:
        if machine.cpu_group:
            yield host.machine_finding(
                CPU_GROUP,
                machine,
                f"{machine_title(machine)} on {host.name} is in the CPU group {machine.cpu_group}. It gets only the "
                "logical processors and the cap of its group; rarms counts it against the whole host.",
                "Take it out of the group (`CpuGroups.exe SetVmGroup /VmName:NAME /GroupId:"
                "00000000-0000-0000-0000-000000000000`), or check by hand that its group has room for its reserve.",
                {"group": machine.cpu_group},
            )


def check_cluster(host: Examination) -> Iterator[Diagnostic]:
    """Yield a cluster may move a machine, and keeps a copy of its settings (windows.md 5)."""
    for machine, condition in host.machines():
        if condition.clustered:
            yield host.machine_finding(
                UNFIT_MACHINE,
                machine,
                f"{machine_title(machine)} on {host.name} belongs to a failover cluster: it may move to another "
                "host, or come from one, and takes its reserve along.",
                "Keep robots' partitions out of the cluster. After a change of memory or devices run "
                "`Update-ClusterVirtualMachineConfiguration`, and plan again after a move.",
            )


def check_machine_state(host: Examination) -> Iterator[Diagnostic]:
    """Yield a critical machine has lost its storage (windows.md 5)."""
    for machine, _ in host.machines():
        if machine.state is RunState.CRITICAL:
            yield host.machine_finding(
                UNFIT_MACHINE,
                machine,
                f"{machine_title(machine)} on {host.name} is in a critical state: its storage cannot be reached. It "
                "can only be turned off or removed.",
                "Bring its storage back (a disk that is offline, full or disconnected), then look again.",
                {"state": machine.state.value},
            )


def check_guest_answers(host: Examination) -> Iterator[Diagnostic]:
    """Find running guests that do not answer: they cannot be shut down or measured in (windows.md 7)."""
    for machine, _ in host.machines():
        if machine.mark and machine.state is RunState.RUNNING and not machine.can_be_asked:
            yield host.machine_finding(
                UNFIT_MACHINE,
                machine,
                f"{machine_title(machine)} on {host.name} runs, and its guest does not answer: it cannot be asked to "
                "shut down, and nothing can be started in it.",
                "Wait until it has booted. Otherwise look on the host (`Get-VMIntegrationService`: what is off, "
                "`Enable-VMIntegrationService` turns on) and in the guest (services vmicshutdown and vmicvmsession).",
            )


def check_machine_width(host: Examination) -> Iterator[Diagnostic]:
    """Find those with more virtual processors than logical ones: they have no guaranteed reserve (windows.md 1.2)."""
    available = host.state.facts.logical_processors
    for machine, _ in host.machines():
        count = machine.settings.processors
        if count > available:
            lost = " and may set it to zero" if machine.settings.reserve else ""
            yield host.machine_finding(
                UNFIT_MACHINE,
                machine,
                f"{machine_title(machine)} has {count} virtual processors, {host.name} {available} logical "
                f"ones: the hypervisor does not guarantee its reserve{lost}.",
                f"Give it at most {available} processors while it is off.",
                {"processors": count, "host_lp": available},
            )
