"""The only module that names concrete providers."""

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import assert_never

from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import Connect, Host, ProviderKind
from rarms_iac.model.journal import Journal, ScriptRun
from rarms_iac.model.names import is_name
from rarms_iac.model.seen_host import Condition
from rarms_iac.model.state import State, TaskClass
from rarms_iac.model.system import System
from rarms_iac.providers.channel import CommandChannel, ssh_channel
from rarms_iac.providers.interface import HostDamaged, HostFailed, LiveHost
from rarms_iac.providers.measuring import MeasuringHost, PartitionWork
from rarms_iac.running.orders import ProcessPlace
from rarms_iac.storage.codec import NotDecodable
from rarms_iac.storage.records import Damaged

HOSTS = ".rarms/hosts"
SIGNED = ".rarms/signed"
"""Scripts of this manifest's plans as they were signed, by their names."""


def open_host(host: Host, folder: Path, state_path: str, channel: CommandChannel | None = None) -> LiveHost:
    """Open a host of any provider.

    Args:
        state_path: where a simulated host's file lies below it (`state_path`).
        channel: reaches the host in place of what `connect` says; a simulated host needs none.

    Returns:
        A host that is not connected to yet.

    Raises:
        HostFailed: what describes a Linux host says WinRM, which no checked manifest does.
    """
    match host.provider:
        case ProviderKind.SIMULATED:
            from rarms_iac.providers.simulated.provider import SimulatedHostProvider

            return SimulatedHostProvider(host, folder / state_path)
        case ProviderKind.HYPERV:
            from rarms_iac.providers.hyperv.provider import open_hyperv

            return open_hyperv(host, folder / SIGNED, channel)
        case ProviderKind.LINUX if (way := channel or way_to_robot(host)) is not None:
            from rarms_iac.providers.robot import RobotByChannel

            return RobotByChannel(host, way)
        case ProviderKind.LINUX if host.connect is not None:
            raise HostFailed(host.name, "WinRM cannot connect to a Linux host", "Use `connect: {ssh: user@host}`.")
        case ProviderKind.LINUX:
            from rarms_iac.providers.cgroups.provider import LinuxHostProvider

            return LinuxHostProvider(host)


def way_to_robot(host: Host) -> CommandChannel | None:
    """Return ssh to a Linux host; None: it is this machine, or is not reached by ssh."""
    is_robot = host.provider is ProviderKind.LINUX and isinstance(host.connect, Connect)
    return ssh_channel(host.name, host.connect) if is_robot and isinstance(host.connect, Connect) else None


def state_folder(host: Host) -> Path | None:
    """Find where a host that is not a simulated one keeps journal and state, so that a change of them can be noticed.

    Returns:
        A folder of this machine, which need not exist; None: it lies elsewhere, or is not a folder.
    """
    if host.provider is not ProviderKind.LINUX or host.connect is not None:
        return None
    from rarms_iac.providers.cgroups.provider import STATE_FOLDER

    return STATE_FOLDER / host.linux.slice


def start_after_boot(owner: str, timeout_ms: int) -> Mapping[str, tuple[str, ...]]:
    """Start the partitions of this machine, a Linux host, that are off though no run stopped them.

    Args:
        timeout_ms: how long to wait for each slice that another run holds.

    Returns:
        The names of those that it started, by slice. Each slice is as its last run's journal describes it.

    Raises:
        HostError: another run holds a slice, or the machine does not start a partition; or, after all are started, one
            did not give back what it had for its start.
    """
    from rarms_iac.applying.run_steps import take_back_starts
    from rarms_iac.providers.cgroups.provider import LinuxHostProvider

    started: dict[str, tuple[str, ...]] = {}
    failed: HostFailed | None = None
    for slice_name, journal in _journals_here():
        host = LinuxHostProvider(journal.started.host_plan.host)
        with host.lock(owner, timeout_ms):
            if (problem := take_back_starts(host, journal)) is not None:  # the partitions start all the same
                failed = failed or HostFailed(host.name, problem.detail, problem.advice)
            started[slice_name] = host.start_after_boot()
    if failed is not None:
        raise failed
    return started


def unfinished_hosts_here() -> Iterator[tuple[LiveHost, Journal]]:
    """Yield this machine, a Linux host, once for each slice with an unfinished run, and that run.

    Raises:
        HostDamaged: a journal cannot be read.
    """
    from rarms_iac.providers.cgroups.provider import LinuxHostProvider

    for _, journal in _journals_here():
        if journal.unfinished:
            yield LinuxHostProvider(journal.started.host_plan.host), journal


def _journals_here() -> Iterator[tuple[str, Journal]]:
    """Yield the slices that rarms keeps on this machine, each with its last run."""
    from rarms_iac.providers.cgroups.provider import STATE_FOLDER
    from rarms_iac.providers.journaled import LocalFiles, journal_in

    for path in sorted(STATE_FOLDER.glob("*/journal.jsonl")):
        try:
            journal = journal_in(LocalFiles().content(path), path)
        except (Damaged, NotDecodable, OSError) as problem:
            advice = f"Restore {path} from a copy, or move it away to continue without it."
            raise HostDamaged(path.parent.name, f"{path} cannot be read: {problem}", advice) from problem
        if journal is not None:
            yield path.parent.name, journal


def open_measuring_host(system: System, name: str, folder: Path, state_path: str) -> MeasuringHost | None:
    """Open a host to measure on.

    Args:
        state_path: where a simulated host's file lies below it (`state_path`).

    Returns:
        The host; None: this version cannot measure on hosts of its provider.
    """
    host = system.hosts[name]
    match host.provider:
        case ProviderKind.SIMULATED:
            from rarms_iac.providers.simulated.measuring import SimulatedMeasuringHost
            from rarms_iac.providers.simulated.scheduling.simulation import SchedulerSimulation

            return SimulatedMeasuringHost(host, folder / state_path, SchedulerSimulation)
        case ProviderKind.LINUX if host.connect is None:
            from rarms_iac.providers.cgroups.measuring import LinuxMeasuringHost

            return LinuxMeasuringHost(host, folder.resolve())
        case ProviderKind.HYPERV:
            from rarms_iac.providers.hyperv.measuring import HypervMeasuringHost
            from rarms_iac.providers.hyperv.provider import transport_to

            named = {name: request.guest.credential for name, request in system.partitions.items()}
            credentials = {name: credential for name, credential in named.items() if credential}
            if not credentials and not host.hyperv.credential:
                return None  # it is not said how guests are entered
            return HypervMeasuringHost(host, transport_to(host), folder / SIGNED, folder.resolve(), credentials)
        case ProviderKind.LINUX:
            return None
        case _:
            assert_never(host.provider)


def place_on(host: Host, partition: PartitionWork, application: str) -> ProcessPlace:
    """Find where the processes of a component belong on this machine, a Linux host.

    Args:
        partition: the name, one component, and the task classes of all members.

    Returns:
        The control group, and the words of the component's task class.

    Raises:
        HostError: the partition is not there or does not run, or control groups cannot be read or used.
    """
    from rarms_iac.providers.cgroups.measuring import LinuxMeasuringHost

    return LinuxMeasuringHost(host, Path()).place(partition, application)


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """What a file shows of a host, or of the Windows inside a guest: what `observe.ps1` printed, or a `State` alone."""

    computer: str
    state: State
    tasks: tuple[TaskClass, ...] = ()  # of the Windows that the script ran in
    condition: Condition = Condition()
    findings: tuple[Diagnostic, ...] = ()  # what the provider finds odd
    unfinished: ScriptRun | None = None
    unread: HostFailed | None = None  # what a plan depends on and was not read, of a host
    unread_in_guest: HostFailed | None = None  # the same of the Windows inside a guest


def read_script_output(data: bytes, host: str) -> Snapshot | None:
    """Read the output of `observe.ps1`, for a host of this name; None where the bytes are something else.

    Args:
        data: UTF-8 or UTF-16, as PowerShell wrote it.

    Returns:
        What it shows.

    Raises:
        NotDecodable: it is such output, and not as the script writes it.
    """
    from rarms_iac.providers.hyperv.condition import condition_of, findings_of, unread_error
    from rarms_iac.providers.hyperv.observation import document_of, is_observation, observation_of
    from rarms_iac.providers.hyperv.parse import last_run_of, tasks_of, to_state

    try:
        document = document_of(data)
    except NotDecodable:
        return None  # the reader of snapshots of other forms reports what is wrong with it
    if not is_observation(document):
        return None
    observation = observation_of(document)
    run = last_run_of(observation)
    return Snapshot(
        computer=observation.computer,
        state=to_state(observation, host),
        tasks=tasks_of(observation),
        condition=condition_of(observation),
        findings=findings_of(observation, host),
        unfinished=run if isinstance(run, ScriptRun) and run.unfinished else None,
        unread=unread_error(observation, host),
        unread_in_guest=unread_error(observation, host, guest=True),
    )


def transport_scripts() -> dict[str, str]:
    """Return the texts that travel over ssh to a Hyper-V host ahead of every script of a plan, for a reader.

    Returns:
        By file name, in the order in which they run: the loader, which is the command itself, and the receiver; then
        what runs in their place where the module is installed. ASCII text with LF; over the wire it has CRLF.
    """
    from rarms_iac.providers.hyperv.transport import render_installed_receiver, render_loader, render_receiver

    texts = {
        "loader.ps1": render_loader(),
        "bootstrap.ps1": render_receiver(),
        "receive.ps1": render_installed_receiver(),
    }
    return {name: text.decode("ascii").replace("\r\n", "\n") for name, text in texts.items()}


def state_path(host: str, folder: Path, overlays: Sequence[str]) -> str:
    """Return the path of a simulated host's file: one for each host name and set of overlays, as each is a machine.

    Args:
        overlays: paths of the overlays, in their order.

    Returns:
        A path below the folder, with slashes; the overlays' names and a digest of their paths are in it.
    """
    if not overlays:
        return f"{HOSTS}/{host}.json"
    paths = [_below(overlay, folder) for overlay in overlays]
    digest = hashlib.sha256("\n".join(paths).encode("utf-8", "backslashreplace")).hexdigest()[:8]
    names = [Path(path).stem for path in paths]
    readable = [name for name in names if is_name(name)]
    return f"{HOSTS}/{'+'.join([*readable, digest])}/{host}.json"


def unfinished_simulated_hosts(folder: Path) -> tuple[LiveHost, ...]:
    """Find the simulated hosts below this folder whose last run did not end.

    Args:
        folder: the folder of a manifest. Journals say all that is needed, so the manifest is not read.

    Returns:
        The hosts, in the order of their files. Journals that cannot be read are passed over: a command that names such
        a host
            gets the finding of the damage.
    """
    from rarms_iac.providers.journaled import LocalFiles, journal_in

    found: list[LiveHost] = []
    for path in sorted((folder / HOSTS).rglob("*.journal.jsonl")):
        try:
            journal = journal_in(LocalFiles().content(path), path)
        except (Damaged, NotDecodable, OSError):
            continue  # a command that names the host gets the finding of the damage
        if journal is not None and journal.unfinished:
            part = journal.started.host_plan
            found.append(open_host(part.host, folder, part.state_path))
    return tuple(found)


def _below(path: str, folder: Path) -> str:
    """Return the path as seen from the folder, so that it is the same from any folder."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # another drive
        return Path(path).resolve().as_posix()
