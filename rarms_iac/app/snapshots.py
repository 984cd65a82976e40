"""Files that stand for hosts and guests: `--snapshot [HOST=]FILE`, `--snapshot HOST.guest.PARTITION=FILE`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from rarms_iac.app.files import read_input_file
from rarms_iac.app.requests import SnapshotFile
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.app.wiring import ScriptObservation, read_script_output
from rarms_iac.diff.readings import is_marked
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.journal import ScriptRun
from rarms_iac.model.state import State
from rarms_iac.model.wording import quoted
from rarms_iac.providers.interface import HostFailed
from rarms_iac.storage.codec import NotDecodable
from rarms_iac.storage.snapshot_file import MAX_BYTES, SnapshotUnreadable, read_snapshot


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """A file that stands for a host."""

    file: str
    data: bytes
    state: State
    findings: tuple[Diagnostic, ...] = ()  # what the provider finds odd in it
    unfinished: ScriptRun | None = None
    unread: HostFailed | None = None  # what a plan rests on and was not read


@dataclass(frozen=True, slots=True, kw_only=True)
class GuestSnapshot:
    """A file that stands for the Windows inside a partition."""

    file: str
    host: str
    partition: str
    observation: ScriptObservation


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshots:
    """All files of a request, each read once."""

    hosts: Mapping[str, Snapshot]
    guests: tuple[GuestSnapshot, ...] = ()

    @property
    def findings(self) -> tuple[Diagnostic, ...]:
        """The findings of all hosts' snapshots, by host."""
        return tuple(finding for _, snapshot in sorted(self.hosts.items()) for finding in snapshot.findings)


def read_snapshots(options: Sequence[SnapshotFile], hosts: Sequence[str], chosen: Sequence[str]) -> Snapshots:
    """Read snapshots, as rarms or observe.ps1 wrote them.

    Args:
        options: the files, each with its host where that is given.
        hosts: names of all hosts of the manifest.
        chosen: names of those that are meant; a file without a name stands for the only one.

    Returns:
        The hosts' snapshots by name, the guests', and what reading them found.

    Raises:
        UseCaseError: one cannot be read, is no snapshot, or does not say which host it stands for (failed).
    """
    snapshots: dict[str, Snapshot] = {}
    guests: list[GuestSnapshot] = []
    for option in options:
        data = read_input_file(option.file, MAX_BYTES, command("snapshot", out="FILE"))
        try:
            observation = read_script_output(data, option.host)
            if option.guest:
                guests.append(_guest(option, observation))
                continue
            snapshot = _snapshot(option, data, observation)
        except (SnapshotUnreadable, NotDecodable) as error:
            raise snapshot_error(option.file, str(error)) from error
        name = option.host or _host_of(snapshot, observation, hosts, chosen)
        if name in snapshots:
            raise snapshot_error(option.file, f"{name} has another one already")
        snapshots[name] = _with_host_name(snapshot, data, name)
    return Snapshots(hosts=snapshots, guests=tuple(guests))


def add_guest_tasks(state: State, guests: Sequence[GuestSnapshot], application: str) -> State:
    """Add the task classes seen inside a host's partitions to its state.

    Args:
        state: of the host.
        guests: snapshots of its guests, and of others.
        application: whose partitions they name.

    Returns:
        The state with the classes of these guests.

    Raises:
        UseCaseError: the host has no such partition, or the file was taken on the host itself.
    """
    for guest in guests:
        if guest.host == state.facts.name:
            state = _with_guest(state, guest, application)
    return state


def _with_guest(state: State, guest: GuestSnapshot, application: str) -> State:
    machines = [partition for partition in state.partitions if is_marked(partition, application, guest.partition)]
    if len(machines) != 1:
        raise snapshot_error(guest.file, f"{guest.host} has no partition {guest.partition} of {application}")
    if guest.observation.computer.lower() == state.facts.computer_name.lower():
        raise snapshot_error(
            guest.file, f"it was taken on {guest.observation.computer}, the host itself, not in a guest"
        )
    inside = tuple(replace(task, inside=guest.partition, machine=machines[0].id) for task in guest.observation.tasks)
    tasks = sorted((*state.tasks, *inside), key=lambda task: (task.inside, task.name.lower()))
    return replace(state, tasks=tuple(tasks))


def _guest(option: SnapshotFile, observation: ScriptObservation | None) -> GuestSnapshot:
    if observation is None:
        raise SnapshotUnreadable("it is not what observe.ps1 prints, and nothing else looks into a guest")
    if observation.unread_in_guest is not None:
        raise SnapshotUnreadable(observation.unread_in_guest.message)
    if not observation.tasks:
        raise SnapshotUnreadable("it shows no task classes, and every Windows has some: they were not read")
    return GuestSnapshot(file=option.file, host=option.host, partition=option.guest, observation=observation)


def _snapshot(option: SnapshotFile, data: bytes, observation: ScriptObservation | None) -> Snapshot:
    if observation is None:
        return Snapshot(file=option.file, data=data, state=read_snapshot(data))
    return Snapshot(
        file=option.file,
        data=data,
        state=observation.state,
        findings=observation.findings,
        unfinished=observation.unfinished,
        unread=observation.unread,
    )


def _with_host_name(snapshot: Snapshot, data: bytes, name: str) -> Snapshot:
    """The snapshot of the host that it stands for; what is told of it names that host."""
    observation = read_script_output(data, name)
    state = replace(snapshot.state, facts=replace(snapshot.state.facts, name=name))
    if observation is None:
        return replace(snapshot, state=state)
    return replace(snapshot, state=state, findings=observation.findings, unread=observation.unread)


def _host_of(
    snapshot: Snapshot, observation: ScriptObservation | None, hosts: Sequence[str], chosen: Sequence[str]
) -> str:
    """The host that a file without a name stands for: the one it was taken of, or the only one."""
    origin = observation.computer.lower() if observation else snapshot.state.facts.name
    if origin in hosts:
        return origin
    if len(chosen) == 1:
        return chosen[0]
    raise snapshot_error(snapshot.file, f"it was taken of {quoted(origin)}, which the manifest does not have")


def snapshot_error(file: str, reason: str) -> UseCaseError:
    """Make the error for a file that is not a snapshot of a host.

    Args:
        file: as it was named.
        reason: why, as a sentence without its full stop.

    Returns:
        An error to raise; it ends the use case as failed.
    """
    finding = SnapshotUnreadable.finding.at(
        None,
        f"{file}: {reason}.",
        prose(
            "Make one with ",
            command("snapshot", host="NAME", out="FILE"),
            ", or run the script of ",
            command("snapshot", script=True),
            " there, and name its host where there are several: `--snapshot NAME=FILE`.",
        ),
        values={"file": file, "reason": reason},
    )
    return UseCaseError(Outcome.FAILED, [finding])
