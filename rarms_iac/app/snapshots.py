"""Files that stand for hosts and guests: `--snapshot [HOST=]FILE`, `--snapshot HOST.guest.PARTITION=FILE`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from rarms_iac.app.files import read_input_file
from rarms_iac.app.requests import SnapshotFile
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.app.wiring import Snapshot, read_script_output
from rarms_iac.diff.readings import is_marked
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.state import State
from rarms_iac.storage.codec import NotDecodable
from rarms_iac.storage.snapshot_file import MAX_BYTES, SnapshotUnreadable, read_snapshot
from rarms_iac.texts.messages import quoted


@dataclass(frozen=True, slots=True, kw_only=True)
class GuestSnapshot:
    """A file that stands for the Windows inside a partition."""

    file: str
    host: str
    partition: str
    snapshot: Snapshot


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
        chosen: names of those that are meant; a file without a name stands for the only one.

    Returns:
        The hosts' snapshots by name, the guests', and what reading them found.

    Raises:
        UseCaseError: one cannot be read, is not a snapshot, or does not say which host it stands for (failed).
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
            snapshot = observation or _as_written(data)
        except (SnapshotUnreadable, NotDecodable) as error:
            raise snapshot_error(option.file, str(error)) from error
        name = option.host or _host_of(option.file, snapshot, hosts, chosen)
        if name in snapshots:
            raise snapshot_error(option.file, f"{name} has more than one snapshot")
        snapshots[name] = read_script_output(data, name) or _of_host(snapshot, name)
    return Snapshots(hosts=snapshots, guests=tuple(guests))


def add_guest_tasks(state: State, guests: Sequence[GuestSnapshot], application: str) -> State:
    """Add the task classes seen inside a host's partitions to its state.

    Args:
        guests: snapshots of its guests, and of others.

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
        raise snapshot_error(guest.file, f"{guest.host} does not have the partition {guest.partition} of {application}")
    if guest.snapshot.computer.lower() == state.facts.computer_name.lower():
        raise snapshot_error(guest.file, f"it was taken on {guest.snapshot.computer}, the host itself, not in a guest")
    inside = tuple(replace(task, inside=guest.partition, machine=machines[0].id) for task in guest.snapshot.tasks)
    tasks = sorted((*state.tasks, *inside), key=lambda task: (task.inside, task.name.lower()))
    return replace(state, tasks=tuple(tasks))


def _guest(option: SnapshotFile, observation: Snapshot | None) -> GuestSnapshot:
    if observation is None:
        raise SnapshotUnreadable("a guest needs the output of observe.ps1")
    if observation.unread_in_guest is not None:
        raise SnapshotUnreadable(observation.unread_in_guest.message)
    if not observation.tasks:
        raise SnapshotUnreadable("it has no task classes: they were not read")
    return GuestSnapshot(file=option.file, host=option.host, partition=option.guest, snapshot=observation)


def _as_written(data: bytes) -> Snapshot:
    state = read_snapshot(data)
    return Snapshot(computer=state.facts.name, state=state)


def _of_host(snapshot: Snapshot, name: str) -> Snapshot:
    facts = replace(snapshot.state.facts, name=name)
    return replace(snapshot, state=replace(snapshot.state, facts=facts))


def _host_of(file: str, snapshot: Snapshot, hosts: Sequence[str], chosen: Sequence[str]) -> str:
    """Return the host that a file without a name stands for: the one it was taken of, or the only one."""
    origin = snapshot.computer.lower()
    if origin in hosts:
        return origin
    if len(chosen) == 1:
        return chosen[0]
    raise snapshot_error(file, f"it is from {quoted(origin)}, which is not in the manifest")


def snapshot_error(file: str, reason: str) -> UseCaseError:
    """Make the error for a file that is not a snapshot of a host.

    Args:
        reason: why, as a sentence without its full stop.

    Returns:
        An error to raise; it ends the use case as failed.
    """
    finding = SnapshotUnreadable.finding.at(
        None,
        "{file}: {reason}.",
        prose(
            "Make a snapshot with ",
            command("snapshot", host="NAME", out="FILE"),
            ", or run the script of ",
            command("snapshot", script=True),
            " there. With several hosts, give the host's name: `--snapshot NAME=FILE`.",
        ),
        file=file,
        reason=reason,
    )
    return UseCaseError(Outcome.FAILED, [finding])
