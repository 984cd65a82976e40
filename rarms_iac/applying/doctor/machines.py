"""The doctor's checks of a host's logical processors and of its virtual machines, managed or not."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

from rarms_iac.model.commands import Wording
from rarms_iac.model.diagnostics import Diagnostic, Facts, Finding
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import Partition, ProcessorKind, RunState, Tie
from rarms_iac.model.wording import counted, in_a_row

UNFIT_MACHINE = Finding.warning("RARMS245", "A machine is not as rarms needs it")
CPU_GROUP = Finding.warning("RARMS235", "A machine is in a CPU group")
UNEQUAL = Finding.warning("RARMS405", "The logical processors of a host are unequal")

NO_MORE_FACTS: Facts = MappingProxyType({})


def finding_about(
    host: SeenHost, finding: Finding, detail: str, advice: Wording, values: Facts = NO_MORE_FACTS
) -> Diagnostic:
    """Return a finding about the host itself; `values` without its name."""
    given: Mapping[str, Any] = values
    return finding.of_host(host.name, "{_detail}", advice, _detail=detail, **given)


def _machine_finding(
    host: SeenHost,
    machine: Partition,
    detail: str,
    advice: Wording,
    values: Facts = NO_MORE_FACTS,
    finding: Finding = UNFIT_MACHINE,
) -> Diagnostic:
    """Return a finding at a partition's name in the manifest, or at the id of a machine that is not managed."""
    given: Mapping[str, Any] = {"machine": machine.id, "name": machine.settings.name, **values}
    return finding.at(
        None,
        "{_detail}",
        advice,
        address=f"partition/{machine.mark.name}" if machine.mark else f"machine/{machine.id}",
        _detail=detail,
        host=host.name,
        **given,
    )


def _title(machine: Partition) -> str:
    """Return the name and the begin of the id, because names are not unique."""
    return f'"{machine.settings.name}" ({machine.id[:8]})'


def check_unequal_processors(host: SeenHost) -> Iterator[Diagnostic]:
    """Yield a partition may run on any of them, and a component takes longer on the slower ones."""
    kinds = host.state.facts.processor_kinds
    if kinds:
        yield finding_about(
            host,
            UNEQUAL,
            f"The logical processors of {host.name} are of {len(kinds)} kinds: {in_a_row(list(map(_words, kinds)))}. "
            "A measurement on one kind does not hold on the other.",
            "Turn SMT off, or turn off the processors of one kind in the firmware or the operating system; then "
            "measure again. Otherwise raise the reserves until `rarms prove` passes.",
            {"processors": tuple(str(kind.processors) for kind in kinds)},
        )


def _words(kind: ProcessorKind) -> str:
    facts = (
        (kind.threads, f"in cores with {counted(kind.threads, 'thread')}"),
        (kind.capacity, f"of capacity {kind.capacity}"),
        (kind.base_mhz, f"with a base frequency of {kind.base_mhz} MHz"),
    )
    return " ".join([str(kind.processors), *(words for known, words in facts if known)])


def check_cpu_group(host: SeenHost) -> Iterator[Diagnostic]:
    """Yield a machine in a CPU group draws only on the group's logical processors and cap (windows.md 2)."""
    for machine in host.state.partitions:
        if machine.cpu_group:
            yield _machine_finding(
                host,
                machine,
                f"{_title(machine)} on {host.name} is in the CPU group {machine.cpu_group}. It gets only the "
                "logical processors and the cap of its group; rarms counts it against the whole host.",
                "Take it out of the group (`CpuGroups.exe SetVmGroup /VmName:NAME /GroupId:"
                "00000000-0000-0000-0000-000000000000`), or check by hand that its group has room for its reserve.",
                {"group": machine.cpu_group},
                CPU_GROUP,
            )


def check_cluster(host: SeenHost) -> Iterator[Diagnostic]:
    """Yield a cluster may move a machine, and keeps a copy of its settings (windows.md 5)."""
    for machine in host.state.partitions:
        if Tie.CLUSTER in machine.ties:
            yield _machine_finding(
                host,
                machine,
                f"{_title(machine)} on {host.name} belongs to a failover cluster: it may move to another "
                "host, or come from one, and takes its reserve along.",
                "Keep robots' partitions out of the cluster. After a change of memory or devices run "
                "`Update-ClusterVirtualMachineConfiguration`, and plan again after a move.",
            )


def check_machine_state(host: SeenHost) -> Iterator[Diagnostic]:
    """Yield a critical machine has lost its storage (windows.md 5)."""
    for machine in host.state.partitions:
        if machine.state is RunState.CRITICAL:
            yield _machine_finding(
                host,
                machine,
                f"{_title(machine)} on {host.name} is in a critical state: its storage cannot be reached. It "
                "can only be turned off or removed.",
                "Bring its storage back (a disk that is offline, full or disconnected), then look again.",
                {"state": machine.state.value},
            )


def check_guest_answers(host: SeenHost) -> Iterator[Diagnostic]:
    """Find running guests that do not answer: they cannot be shut down or measured in (windows.md 7)."""
    for machine in host.state.partitions:
        if machine.mark and machine.state is RunState.RUNNING and not machine.can_be_asked:
            yield _machine_finding(
                host,
                machine,
                f"{_title(machine)} on {host.name} runs, and its guest does not answer: it cannot be asked to "
                "shut down, and nothing can be started in it.",
                "Wait until it has booted. Otherwise look on the host (`Get-VMIntegrationService`: what is off, "
                "`Enable-VMIntegrationService` turns on) and in the guest (services vmicshutdown and vmicvmsession).",
            )


def check_machine_width(host: SeenHost) -> Iterator[Diagnostic]:
    """Find those with more virtual processors than logical ones: they have no guaranteed reserve (windows.md 1.2)."""
    available = host.state.facts.logical_processors
    for machine in host.state.partitions:
        count = machine.settings.processors
        if count > available:
            lost = " and may set it to zero" if machine.settings.reserve else ""
            yield _machine_finding(
                host,
                machine,
                f"{_title(machine)} has {count} virtual processors, {host.name} {available} logical "
                f"ones: the hypervisor does not guarantee its reserve{lost}.",
                f"Give it at most {available} processors while it is off.",
                {"processors": count, "host_lp": available},
            )
