"""The hosts that a command is about: chosen, manifest, and looked at, live or in a snapshot."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, date, datetime
from pathlib import Path
from types import MappingProxyType

from rarms_iac.app.manifests import Manifest, load_manifest
from rarms_iac.app.requests import DEFAULT_MANIFEST, HostSelection, ManifestSource, refuse_unknown, today_utc
from rarms_iac.app.snapshots import Snapshots, add_guest_tasks, read_snapshots
from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError
from rarms_iac.app.wiring import Snapshot, open_host, open_measuring_host, state_path
from rarms_iac.applying import refusals
from rarms_iac.applying.run_steps import hold
from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.model.journal import Journal, RunOrigin, ScriptRun
from rarms_iac.model.state import Rights, State
from rarms_iac.model.system import System
from rarms_iac.providers.channel import CommandChannel, one_command_only
from rarms_iac.providers.interface import HostError, HostLocked, LiveHost, RecordableHost, RobotHost
from rarms_iac.providers.measuring import MeasuringHost
from rarms_iac.providers.robot import EndedThere
from rarms_iac.storage.snapshot_file import write_snapshot
from rarms_iac.storage.writing import owner
from rarms_iac.texts.messages import natural_order

NO_CHANNELS: Mapping[str, CommandChannel] = MappingProxyType({})


@dataclass(frozen=True, slots=True, kw_only=True)
class Hosts:
    """A manifest, and which of its hosts are meant: live, or as snapshots show them."""

    manifest: Manifest
    selection: HostSelection
    snapshots: Snapshots
    channels: Mapping[str, CommandChannel] = field(default_factory=dict)  # by host: in place of what `connect` says
    looked_at_once: Mapping[str, LiveHost] = field(default_factory=dict)  # as `with_one_look` opened them

    @property
    def system(self) -> System:
        """What the manifest says."""
        return self.manifest.system

    @property
    def chosen(self) -> tuple[str, ...]:
        """The names of the hosts that are meant, in natural order."""
        return tuple(sorted(self.selection.hosts or self.system.hosts, key=natural_order))

    @property
    def folder(self) -> Path:
        """The manifest's folder."""
        return self.manifest.folder

    def only(self, *names: str) -> "Hosts":
        """Keep these of the manifest's hosts, and leave the others out.

        Returns:
            A copy; with no names, all hosts of the manifest.
        """
        return replace(self, selection=replace(self.selection, hosts=names))

    def state_path(self, host: str) -> str:
        """Return the path of a simulated host's file, relative to the folder.

        Returns:
            A path with slashes; overlays have files of their own.
        """
        return state_path(host, self.folder, self.manifest.source.overlays)

    def open(self, host: str) -> LiveHost:
        """Return the live host.

        Returns:
            A host that is not connected to yet: its first method may fail.

        Raises:
            UseCaseError: this version cannot reach it (failed).
        """
        if host in self.looked_at_once:
            return self.looked_at_once[host]
        return open_host(self.system.hosts[host], self.folder, self.state_path(host), self.channels.get(host))

    def robot(self, host: str) -> RobotHost | None:
        """Return the live host if its own rarms does what is asked; None: this rarms does."""
        live = self.open(host)
        return live if isinstance(live, RobotHost) else None

    def can_run_on(self, host: str) -> bool:
        """Tell whether components can be run on a host, from here or by its own rarms.

        Raises:
            UseCaseError: as of `open_to_measure`.
        """
        return self.robot(host) is not None or self.open_to_measure(host) is not None

    def with_one_look(self) -> "Hosts":
        """Have these hosts read and not changed: a distant one is looked at once, for all questions.

        Returns:
            A copy; the first question to a host looks at it, so what it answers is as old as that.
        """
        opened = {name: self.open(name) for name in self.system.hosts}
        for host in opened.values():
            host.look_once()
        return replace(self, looked_at_once=opened)

    def open_to_measure(self, host: str) -> MeasuringHost | None:
        """Return the live host to run components on; None: this version cannot run any there.

        Raises:
            UseCaseError: a channel leads to it, which runs one command at a time (failed).
        """
        if self.robot(host) is not None:
            return None
        if host in self.channels:
            raise UseCaseError(Outcome.FAILED, [refusals.host_failed(one_command_only(host))])
        return open_measuring_host(self.system, host, self.manifest.code_folder, self.state_path(host))

    def reloaded(self) -> "Hosts":
        """Return the same hosts of the manifest as its files are now.

        Raises:
            UseCaseError: it has errors (negative).
        """
        return replace(self, manifest=load_manifest(self.manifest.source))


def load(
    path: str | Path = DEFAULT_MANIFEST,
    *,
    overlays: Sequence[str | Path] = (),
    hosts: Sequence[str] = (),
    today: date | None = None,
    channels: Mapping[str, CommandChannel] = NO_CHANNELS,
) -> Hosts:
    """Read a manifest, and choose hosts of it. Where a program begins.

    Args:
        path: a manifest, or the folder of one.
        overlays: files that are laid over it; a later one wins.
        hosts: names of those that are meant; none: all. They are not looked at yet.
        today: the day by which acceptances expire; None: today in UTC.
        channels: by host, what runs commands there in place of `connect`; an engine such as Ansible has its own.

    Returns:
        What `measure`, `tune`, `plan` and `prove` take.

    Raises:
        RequestError: a host is not in the manifest.
        UseCaseError: the manifest has errors (negative); they are its findings.
    """
    source = ManifestSource(manifest=str(path), overlays=tuple(map(str, overlays)), today=today or today_utc())
    return replace(select_hosts(load_manifest(source), HostSelection(hosts=tuple(hosts))), channels=channels)


def select_hosts(manifest: Manifest, selection: HostSelection) -> Hosts:
    """Choose hosts of a manifest, and read the snapshots that stand for some of them.

    Args:
        selection: names of hosts, none for all of them, and snapshot files.

    Returns:
        The manifest with the chosen hosts. Live hosts are not looked at yet.

    Raises:
        RequestError: a name is not in the manifest; or there are snapshots, and of a chosen host there is none.
        UseCaseError: a snapshot cannot be read (failed).
    """
    system = manifest.system
    named = {snapshot.host for snapshot in selection.snapshots if snapshot.host}
    refuse_unknown((*selection.hosts, *sorted(named)), system.hosts, "host")
    snapshots = read_snapshots(selection.snapshots, sorted(system.hosts), sorted(selection.hosts or system.hosts))
    lacking = [
        name
        for name in sorted(selection.hosts or system.hosts)
        if snapshots.hosts and name not in snapshots.hosts and _would_be_asked(system.hosts[name])
    ]
    if lacking:
        raise RequestError(
            "With --snapshot, rarms does not connect to hosts, so every host needs a snapshot. Missing: "
            f"{', '.join(lacking)}. Give `--snapshot {lacking[0]}=FILE`, or choose hosts with --host."
        )
    return Hosts(manifest=manifest, selection=selection, snapshots=snapshots)


def observe_hosts(hosts: Hosts, *, needed: Collection[str] | None = None) -> Mapping[str, State]:
    """Look at every host of the manifest; those that are not needed help the planner where they can be reached.

    Args:
        needed: names of hosts without which there is no answer; None: the chosen ones.

    Returns:
        The states by host. A host that is not needed is left out where it cannot be read, or hides what is there.

    Raises:
        UseCaseError: such a host cannot be reached or read, or does not have a guest of which there is a snapshot.
    """
    required = hosts.chosen if needed is None else needed
    snapshots, application = hosts.snapshots, hosts.system.application.name
    states: dict[str, State] = {}
    for name in sorted(hosts.system.hosts):
        if snapshots.hosts and name not in snapshots.hosts and _would_be_asked(hosts.system.hosts[name]):
            continue
        try:
            snapshot = snapshots.hosts.get(name)
            state = _state_of(snapshot) if snapshot else observe_host(hosts.open(name))
        except UseCaseError:
            if name in required:
                raise
            continue
        if name in required or state.facts.rights is Rights.PROVEN:
            states[name] = add_guest_tasks(state, snapshots.guests, application)
    return states


def _would_be_asked(host: Host) -> bool:
    """Return whether reading the host starts a program or a connection; a simulated host is a file."""
    return host.provider is not ProviderKind.SIMULATED


def _state_of(snapshot: Snapshot) -> State:
    """Return the state in a snapshot; parts that were not read when it was taken are refused, as a live host's are."""
    with host_errors():
        if snapshot.unread is not None:
            raise snapshot.unread
    return snapshot.state


def observe_host(host: LiveHost) -> State:
    """Look at a live host.

    Returns:
        What is there now: one moment's state.

    Raises:
        UseCaseError: it cannot be read.
    """
    with host_errors():
        return host.observe()


def record_host(host: LiveHost) -> bytes:
    """Look at a live host; return the bytes of a snapshot file: the host's own answer where it gives one.

    Returns:
        UTF-8 text, as `--snapshot` reads it.

    Raises:
        UseCaseError: it cannot be read.
    """
    if not isinstance(host, RecordableHost):
        return write_snapshot(observe_host(host))
    with host_errors():
        return host.recorded()


def refuse_unfinished(hosts: Hosts) -> None:
    """Refuse hosts with an unfinished run: a plan that is made now could never be applied.

    Raises:
        UseCaseError: a chosen host has an unfinished run (refused).
    """
    for name, snapshot in sorted(hosts.snapshots.hosts.items()):
        if name in hosts.chosen and snapshot.unfinished is not None:
            raise UseCaseError(Outcome.REFUSED, [refusals.unfinished(name, snapshot.unfinished)])
    for name, journal in unfinished_runs(hosts):
        raise UseCaseError(Outcome.REFUSED, [refusals.unfinished(name, journal)])


def unfinished_runs(hosts: Hosts) -> Iterator[tuple[str, Journal | ScriptRun]]:
    """Yield the chosen live hosts with an unfinished run, and its journal; hosts with a snapshot are passed over.

    Args:
        hosts: the chosen ones are asked, in name order.

    Yields:
        Pairs of a host's name and its journal.

    Raises:
        UseCaseError: a journal cannot be read.
    """
    for name in hosts.chosen:
        if name not in hosts.snapshots.hosts:
            with host_errors():
                journal = hosts.open(name).unfinished()
            if journal is not None:
                yield name, journal


def last_runs(hosts: Hosts) -> Iterator[tuple[str, Journal | ScriptRun | None]]:
    """Yield the chosen live hosts with the journal of the last run there; hosts with a snapshot are passed over.

    Args:
        hosts: the chosen ones are asked, in name order.

    Yields:
        Pairs of a host's name and its journal; None where there was no run.

    Raises:
        UseCaseError: a journal cannot be read.
    """
    for name in hosts.chosen:
        if name not in hosts.snapshots.hosts:
            yield name, last_run(hosts, name)


def last_run(hosts: Hosts, name: str) -> Journal | ScriptRun | None:
    """Read the journal of the last run on a host.

    Returns:
        The run; None where there was none.

    Raises:
        UseCaseError: the journal cannot be read.
    """
    with host_errors():
        return hosts.open(name).journal()


@contextmanager
def host_errors() -> Iterator[None]:
    """End the use case with a finding if something goes wrong at a host within the context.

    Yields:
        Once, with nothing.

    Raises:
        UseCaseError: a host is held by another run (refused), or did not do what was asked (failed).
    """
    try:
        yield
    except HostLocked as error:
        raise UseCaseError(Outcome.REFUSED, [refusals.lock_held(error.host, error.message)]) from error
    except EndedThere as error:
        raise UseCaseError(Outcome(error.outcome), error.findings) from error
    except HostError as error:
        raise UseCaseError(Outcome.FAILED, [refusals.host_failed(error)]) from error


@contextmanager
def hold_hosts(hosts: tuple[LiveHost, ...], timeout_ms: int) -> Iterator[None]:
    """Hold these hosts, taken in the order of their names.

    Args:
        timeout_ms: how long to wait for each that another run holds; 0: not at all.

    Yields:
        Once, with all of them held.

    Raises:
        UseCaseError: another run holds one of them (refused).
    """
    with host_errors(), hold(hosts, owner(), timeout_ms):
        yield


def run_origin() -> RunOrigin:
    """Name who starts a run, and the time now.

    Returns:
        `user@computer, process 123` with stand-ins where the system does not know them, and the time in UTC.
    """
    return RunOrigin(by=owner(), at=datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S UTC"))
