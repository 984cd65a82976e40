"""The doctor's checks of the host's own operating system and of what rarms reaches it with."""

from collections.abc import Iterator

from rarms_iac.applying.preconditions import no_rights, scheduler_findings
from rarms_iac.model.commands import APPLY, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import ProviderKind, SchedulerType
from rarms_iac.model.mmcss import OFF, USUAL, taken_for
from rarms_iac.model.seen_host import PolicyScope, SeenHost
from rarms_iac.model.state import RegistryValue, Rights, RunState, ValueKind
from rarms_iac.texts.findings import Finding
from rarms_iac.texts.messages import in_a_row, quoted
from rarms_iac.texts.quantities import show_bytes

LACKS = Finding.error("RARMS233", "The host does not meet the requirements of rarms")

RESPONSIVENESS_VALUE = Finding.warning("RARMS230", "Windows replaces the value of SystemResponsiveness")
CORE_SCHEDULER = Finding.warning("RARMS234", "A virtual processor may use two logical processors")
EXECUTION_POLICY = Finding.warning("RARMS241", "The execution policy blocks scripts")
MINROOT = Finding.note("RARMS243", "The host's own Windows has fewer processors than the hypervisor")
UNREAD_PROBE = Finding.note("RARMS249", "A part of the host could not be read")

NOT_ELEVATED = Finding.warning("RARMS319", "The user cannot change the host")
LITTLE_MEMORY = Finding.warning("RARMS320", "The host has too little free memory to start its partitions")
NO_COUNTERS = Finding.warning("RARMS321", "The hypervisor's counters are missing")
SCRIPT_RUNNING = Finding.warning("RARMS323", "A script of rarms is running on the host")

_FORBIDDING_POLICIES = ("Restricted", "AllSigned")
_NEEDED_POWERSHELL = (5, 1)


def check_preconditions(host: SeenHost) -> Iterator[Diagnostic]:
    """Find missing rights, and a scheduler that ignores reserves: plans ask for the same.

    Linux schedules control groups itself; whether they may be made is asked where they are made.
    """
    facts = host.state.facts
    if facts.provider is ProviderKind.LINUX or host.condition.role is False:
        return
    if facts.rights is not Rights.PROVEN:
        yield no_rights(facts)
    yield from scheduler_findings(facts, "its machines", None)


def check_hypervisor(host: SeenHost) -> Iterator[Diagnostic]:
    """Find a missing role or hypervisor. Windows has the role and starts the hypervisor before it (windows.md 2, 5)."""
    condition = host.condition
    if condition.role is False:
        yield LACKS.of_host(
            host.name,
            (
                "{host} does not have the role Hyper-V: its Windows has no WMI namespace root\\virtualization\\v2 "
                "(error 0x8004100e)."
            ),
            (
                "Install the role. On a server, run `Install-WindowsFeature -Name Hyper-V -IncludeManagementTools "
                "-Restart`. On a client, run `Enable-WindowsOptionalFeature -Online -FeatureName Microsoft-Hyper-V "
                "-All`. If this Windows runs inside a machine, check the host of that machine instead."
            ),
            role=False,
        )
    elif condition.hypervisor_running is False:
        yield LACKS.of_host(
            host.name,
            "{host} has the role Hyper-V, but Windows started without the hypervisor. No machine can start.",
            (
                "Run `bcdedit /set hypervisorlaunchtype auto` in an elevated prompt. Turn on virtualization in "
                "the firmware (VT-x or AMD-V, and NX). Restart the host."
            ),
            role=True,
        )


def check_elevation(host: SeenHost) -> Iterator[Diagnostic]:
    """Find a caller without elevation: scripts write HKLM, which Hyper-V Administrators may not (windows.md 5)."""
    if host.state.facts.rights is Rights.PROVEN and host.condition.elevated is False:
        group = " as a member of Hyper-V Administrators" if host.condition.hyperv_administrator else ""
        yield NOT_ELEVATED.of_host(
            host.name,
            (
                "{host} was read{_group} without elevation. This is enough to plan. Scripts that change the host "
                "also write to HKLM and %ProgramData%\\rarms. Only an elevated administrator can write there."
            ),
            prose(
                "Run ",
                APPLY,
                ' from a prompt opened with "Run as administrator", or over ssh as an administrator of the host.',
            ),
            hyperv_administrator=bool(host.condition.hyperv_administrator),
            _group=group,
        )


def check_free_memory(host: SeenHost) -> Iterator[Diagnostic]:
    """Compare free memory with the need of the partitions that are off; without it none starts (windows.md 5)."""
    available = host.state.memory_left
    off = [
        machine for machine in host.state.partitions if machine.mark and machine.state in (RunState.OFF, RunState.SAVED)
    ]
    wanted = sum(machine.settings.memory for machine in off)
    if available is not None and wanted > available:
        yield LITTLE_MEMORY.of_host(
            host.name,
            "{host} has {_has} of memory left for machines, but {_names} {_verb} {_needs} to start.",
            (
                "Stop other programs and machines on the host, give partitions less memory in the manifest, or "
                "add memory."
            ),
            partitions=tuple(machine.settings.name for machine in off),
            has_memory_bytes=available,
            needs_memory_bytes=wanted,
            _has=show_bytes(available, wanted),
            _names=in_a_row([machine.settings.name for machine in off]),
            _verb="needs" if len(off) == 1 else "need",
            _needs=show_bytes(wanted, available),
        )


def check_counters(host: SeenHost) -> Iterator[Diagnostic]:
    """Find missing counters of the hypervisor: measuring records them as proof of contention (windows.md 8)."""
    if host.condition.counters is False and host.condition.hypervisor_running:
        yield NO_COUNTERS.of_host(
            host.name,
            (
                "{host}: WMI does not have the counters of the hypervisor's logical processors. They show "
                "whether a partition gets its reserve."
            ),
            "Register the counters again in an elevated prompt: `lodctr /R`, then `winmgmt /resyncperf`.",
        )


def check_running_script(host: SeenHost) -> Iterator[Diagnostic]:
    """Find a script of rarms that runs: the host is neither as before nor as after it."""
    if host.condition.script_running:
        yield SCRIPT_RUNNING.of_host(
            host.name,
            (
                "A script of rarms is running on {host}. %ProgramData%\\rarms\\owner.txt names its owner. rarms "
                "may have read the host in the middle of a change."
            ),
            "Wait until the script has ended, then run the same command again.",
        )


def check_responsiveness(host: SeenHost) -> Iterator[Diagnostic]:
    """Check SystemResponsiveness, the part of a processor that MMCSS leaves to everybody else (windows.md 6.1)."""
    value = host.condition.responsiveness
    if value is None:
        return
    effective = effective_responsiveness(value)
    if effective == OFF:
        problem = f"{value.data}, which switches the multimedia class scheduler off"
    elif value.kind is not ValueKind.DWORD:
        problem = f"{quoted(value.data)}, of the type {value.kind.value} and not dword"
    elif value.data != effective:
        problem = f"{value.data}, which Windows treats as {effective}"
    else:
        return
    yield RESPONSIVENESS_VALUE.of_host(
        host.name,
        (
            "{host}: SystemResponsiveness is {_problem}. Task classes of components with `runs_on: host` depend on "
            "this value."
        ),
        "Set a DWORD of 10, 20, ... 90 and restart the host. With 20, other threads keep a fifth of a processor.",
        value=str(value.data),
        type=value.kind.value,
        taken_percent=effective,
        _problem=problem,
    )


def effective_responsiveness(value: RegistryValue) -> int:
    """Return the per cent that Windows takes the value for; its default where the type is not DWORD."""
    if value.kind is not ValueKind.DWORD or not isinstance(value.data, int):
        return USUAL
    return taken_for(value.data)


def check_module(host: SeenHost) -> Iterator[Diagnostic]:
    """Find a missing module Hyper-V: scripts are made of its cmdlets."""
    if host.condition.module == ():
        yield LACKS.of_host(
            host.name,
            "{host}: PowerShell does not have the module Hyper-V.",
            (
                "Install the module. On a server, run `Install-WindowsFeature Hyper-V-PowerShell`. To install the "
                "role, too, run `Install-WindowsFeature -Name Hyper-V -IncludeManagementTools`. On a client Windows, "
                "install the feature `Microsoft-Hyper-V-Management-PowerShell`."
            ),
        )


def check_core_scheduler(host: SeenHost) -> Iterator[Diagnostic]:
    """Find the core scheduler with SMT: it never shares a core between machines (windows.md 2)."""
    facts = host.state.facts
    if facts.smt and facts.scheduler is SchedulerType.CORE:
        yield CORE_SCHEDULER.of_host(
            host.name,
            (
                "{host} has SMT and the core scheduler. Machines never share a core. A virtual processor uses "
                "both threads of a core if its machine does not use SMT."
            ),
            (
                "Give partitions an even number of processors, and set HwThreadCountPerCore to 0 or 2. Plans "
                "count whole cores."
            ),
            scheduler=facts.scheduler.value,
        )


def check_powershell_version(host: SeenHost) -> Iterator[Diagnostic]:
    """Find a PowerShell that runs no scripts of rarms; a version that is not a number is too old."""
    version = host.condition.powershell
    if version is not None and _version_numbers(version) < _NEEDED_POWERSHELL:
        yield LACKS.of_host(
            host.name,
            "{host} runs PowerShell {version}; the scripts of rarms need 5.1 or 7.",
            (
                "Install Windows Management Framework 5.1 or PowerShell 7 on the host. Windows 10 and Server 2016 "
                "include 5.1."
            ),
            version=version,
        )


def _version_numbers(version: str) -> tuple[int, ...]:
    major, _, rest = version.partition(".")
    minor = rest.partition(".")[0]
    return int(major) if major.isdecimal() else 0, int(minor) if minor.isdecimal() else 0


def check_execution_policy(host: SeenHost) -> Iterator[Diagnostic]:
    """Find an execution policy that forbids our scripts: the first scope that sets one decides.

    Group policy beats `-ExecutionPolicy` (windows.md 9).
    """
    policies = host.condition.policies
    # How the PowerShell that looked was started says nothing of the next one.
    scopes = [
        scope
        for scope in PolicyScope
        if scope is not PolicyScope.PROCESS and policies.get(scope, "Undefined") != "Undefined"
    ]
    if policies and not scopes and host.state.facts.client:
        problem = "no scope sets an execution policy, so a client Windows runs no scripts"
        yield _policy_finding(host, problem, is_group_policy=False)
    elif scopes and policies[scopes[0]] in _FORBIDDING_POLICIES:
        problem = f"the execution policy of {scopes[0].value} is {policies[scopes[0]]}"
        yield _policy_finding(host, problem, is_group_policy=scopes[0].is_group_policy)


def _policy_finding(host: SeenHost, problem: str, *, is_group_policy: bool) -> Diagnostic:
    if is_group_policy:
        effect = "The group policy overrides the policy of rarms. Unsigned scripts do not run."
        advice = "Allow RemoteSigned on this host in the group policy, or put signed scripts into .rarms/signed."
    else:
        effect = "This affects only scripts that you start by hand. `rarms apply` sets the policy of its own processes."
        advice = (
            "Start such scripts with `powershell -NoProfile -ExecutionPolicy RemoteSigned -File SCRIPT`. If the "
            "script came by mail or a browser, first run `Unblock-File SCRIPT`."
        )
    return EXECUTION_POLICY.of_host(
        host.name,
        "{host}: {reason}. {_effect}",
        advice,
        reason=problem,
        _effect=effect,
    )


def check_process_width(host: SeenHost) -> Iterator[Diagnostic]:
    """Find a look by a 32-bit process, which is shown another registry (windows.md 6.6)."""
    bits = host.condition.bits
    if bits is not None and bits < 64:
        yield LACKS.of_host(
            host.name,
            (
                "rarms used a {bits}-bit PowerShell to read {host}. This PowerShell reads a different part of the "
                "registry, so the task classes shown are wrong."
            ),
            (
                "Start the 64-bit PowerShell: `%windir%\\System32\\WindowsPowerShell\\v1.0\\powershell.exe`. Do not "
                "start the PowerShell in SysWOW64 or that of a 32-bit program."
            ),
            bits=bits,
        )


def check_minroot(host: SeenHost) -> Iterator[Diagnostic]:
    """Find minroot, under which the root partition has only some of the logical processors (windows.md 2)."""
    total, visible = host.state.facts.logical_processors, host.condition.seen_processors
    if visible is not None and visible != total:
        yield MINROOT.of_host(
            host.name,
            (
                "The Windows of {host} itself has {seen_lp} logical processors; its hypervisor has {host_lp}. "
                "Machines can use all {host_lp}."
            ),
            (
                "If `bcdedit /set hypervisorrootproc` is set on purpose, no action is needed. Components with "
                "`runs_on: host` can use only the processors of Windows."
            ),
            host_lp=total,
            seen_lp=visible,
        )


def check_unread_probes(host: SeenHost) -> Iterator[Diagnostic]:
    """Report what could not be read, so that silence means something."""
    for subject, why in sorted(host.condition.unread.items()):
        yield UNREAD_PROBE.of_host(
            host.name,
            "{host}: {subject} could not be read: {reason}.",
            (
                "Run the command as a member of Administrators in an elevated PowerShell. If the host does not "
                "have this part, no action is needed."
            ),
            subject=subject,
            reason=why,
        )
