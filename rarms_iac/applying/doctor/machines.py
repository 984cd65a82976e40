"""The doctor's checks of a host's logical processors and of its partitions, managed or not."""

from collections.abc import Iterator

from rarms_iac.model.commands import Wording
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import Partition, ProcessorKind, RunState, Tie
from rarms_iac.texts.findings import Finding, Given
from rarms_iac.texts.messages import counted, in_a_row

UNFIT_MACHINE = Finding.warning("RARMS245", "A machine may fail to start, stop or be measured")
CPU_GROUP = Finding.warning("RARMS235", "A machine is in a CPU group")
UNWATCHED = Finding.warning("RARMS444", "The thread watcher does not run")
UNEQUAL = Finding.warning("RARMS405", "The logical processors of a host are unequal")


def _finding(
    host: SeenHost,
    machine: Partition,
    template: str,
    advice: Wording,
    finding: Finding = UNFIT_MACHINE,
    **facts: Given,
) -> Diagnostic:
    """Return a finding at a partition's name in the manifest, or at the id of a machine that is not managed.

    `{_title}` of the template is the name and the begin of the id, because names are not unique.
    """
    return finding.at(
        None,
        template,
        advice,
        address=f"partition/{machine.mark.name}" if machine.mark else f"machine/{machine.id}",
        related=(),
        host=host.name,
        machine=machine.id,
        name=machine.settings.name,
        _title=f'"{machine.settings.name}" ({machine.id[:8]})',
        **facts,
    )


def check_unequal_processors(host: SeenHost) -> Iterator[Diagnostic]:
    """Find unequal logical processors: a component takes longer on the slower ones."""
    kinds = host.state.facts.processor_kinds
    if kinds:
        yield UNEQUAL.of_host(
            host.name,
            "The logical processors of {host} are of {_kinds} kinds: {_words}. A measurement on one kind is not valid "
            "on the other.",
            (
                "Turn SMT off, or turn off the processors of one kind in the firmware or the operating system. Then "
                "measure again. Otherwise raise the reserves until `rarms prove` passes."
            ),
            processors=tuple(str(kind.processors) for kind in kinds),
            _kinds=len(kinds),
            _words=in_a_row(list(map(_words, kinds))),
        )


def _words(kind: ProcessorKind) -> str:
    facts = (
        (kind.threads, f"in cores with {counted(kind.threads, 'thread')}"),
        (kind.capacity, f"of capacity {kind.capacity}"),
        (kind.base_mhz, f"with a base frequency of {kind.base_mhz} MHz"),
    )
    return " ".join([str(kind.processors), *(words for known, words in facts if known)])


def check_thread_watcher(host: SeenHost) -> Iterator[Diagnostic]:
    """Find that no watcher sets the priorities of threads in partitions that run."""
    running = [partition.settings for partition in host.state.partitions if partition.settings.running]
    names = tuple(settings.name for settings in running if settings.threads)
    if names and host.condition.thread_watcher is False:
        yield UNWATCHED.of_host(
            host.name,
            "The thread watcher does not run on {host}. In {partitions:all}, threads of programs that rarms does not "
            "start keep their usual priority.",
            'Start the watcher: see docs/linux.md, "After the machine starts". Components that rarms starts do not '
            "need it.",
            partitions=names,
        )


def check_cpu_group(host: SeenHost) -> Iterator[Diagnostic]:
    """Find machines in CPU groups: they get only their group's logical processors and cap (windows.md 2)."""
    for machine in host.state.partitions:
        if machine.cpu_group:
            yield _finding(
                host,
                machine,
                (
                    "{_title} on {host} is in the CPU group {group}. The group limits its logical processors and "
                    "processor time. rarms plans with the whole host."
                ),
                (
                    "Remove the machine from the group: `CpuGroups.exe SetVmGroup /VmName:NAME "
                    "/GroupId:00000000-0000-0000-0000-000000000000`. Or check by hand that the group has enough "
                    "processor time for the reserve."
                ),
                CPU_GROUP,
                group=machine.cpu_group,
            )


def check_cluster(host: SeenHost) -> Iterator[Diagnostic]:
    """Find machines of a cluster, which may move them and keeps a copy of their settings (windows.md 5)."""
    for machine in host.state.partitions:
        if Tie.CLUSTER in machine.ties:
            yield _finding(
                host,
                machine,
                (
                    "{_title} on {host} belongs to a failover cluster. The cluster may move the machine and its "
                    "reserve to or from another host."
                ),
                (
                    "Keep robots' partitions out of the cluster. After a change of memory or devices, run "
                    "`Update-ClusterVirtualMachineConfiguration`. After a move, plan again."
                ),
            )


def check_machine_state(host: SeenHost) -> Iterator[Diagnostic]:
    """Find critical machines: they have lost their storage (windows.md 5)."""
    for machine in host.state.partitions:
        if machine.state is RunState.CRITICAL:
            yield _finding(
                host,
                machine,
                (
                    "{_title} on {host} is in a critical state: Hyper-V cannot reach its storage. You can only turn "
                    "the machine off or remove it."
                ),
                (
                    "Check for a disk that is offline, full or disconnected. Restore the storage, then run the same "
                    "command again."
                ),
                state=machine.state.value,
            )


def check_guest_answers(host: SeenHost) -> Iterator[Diagnostic]:
    """Find running guests that do not answer: they cannot be shut down or measured in (windows.md 7)."""
    for machine in host.state.partitions:
        if machine.mark and machine.state is RunState.RUNNING and not machine.can_be_asked:
            yield _finding(
                host,
                machine,
                (
                    "{_title} on {host} runs, but its guest does not respond. rarms cannot shut the guest down "
                    "or start programs in it."
                ),
                (
                    "Wait until the guest has booted. Otherwise check the integration services on the host "
                    "(`Get-VMIntegrationService`, `Enable-VMIntegrationService`) and the services vmicshutdown "
                    "and vmicvmsession in the guest."
                ),
            )


def check_machine_width(host: SeenHost) -> Iterator[Diagnostic]:
    """Find those with more virtual processors than logical ones: they have no guaranteed reserve (windows.md 1.2)."""
    available = host.state.facts.logical_processors
    for machine in host.state.partitions:
        count = machine.settings.processors
        if count > available:
            lost = " and may set it to zero" if machine.settings.reserve else ""
            yield _finding(
                host,
                machine,
                (
                    "{_title} has {processors} virtual processors; {host} has {host_lp} logical processors. The "
                    "hypervisor does not guarantee the reserve of the machine{_lost}."
                ),
                f"Turn the machine off, and give it at most {available} processors.",
                processors=count,
                host_lp=available,
                _lost=lost,
            )
