"""Proofs against the hosts as they are now: whether the proven layout was changed or undone since, and when."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from rarms_iac.app.report_model import ComponentProof
from rarms_iac.diff.drift import ResourceDrift
from rarms_iac.model.journal import PastRun, RunKind
from rarms_iac.model.quantities import show_percent
from rarms_iac.model.state import State
from rarms_iac.model.wording import in_a_row, natural_order


@dataclass(frozen=True, slots=True, kw_only=True)
class HostNow:
    """What a host has of the application now, and the application's runs there."""

    name: str
    machine: str  # its own identity
    serial: int  # how many runs of the application there were
    runs: tuple[PastRun, ...]  # those that are remembered, the oldest first
    reserves: Mapping[str, int]  # by partition, in whole per cent of its virtual processors
    changed: frozenset[str]  # partitions that another tool changed

    @property
    def last_run(self) -> str:
        """When the last run of the application began there; empty: none is remembered."""
        return self.runs[-1].started_at if self.runs else ""

    def undone_at(self, serial: int) -> str:
        """Return the time at which the last run undid a state of the host; empty: it did not.

        An undo ends all states since its apply. If the host does not have a record of that apply, it ends all states.

        Args:
            serial: The number of the application's runs until that state.
        """
        if not self.runs or self.runs[-1].run is not RunKind.UNDO:
            return ""
        runs_back = (
            ago
            for ago, run in enumerate(reversed(self.runs))
            if run.run is RunKind.APPLY and run.plan == self.runs[-1].plan
        )
        first = self.serial - next(runs_back, self.serial)
        return self.last_run if first <= serial < self.serial else ""


def host_now(
    name: str, application: str, state: State, runs: Sequence[PastRun], drifted: Collection[ResourceDrift]
) -> HostNow:
    """Gather what proofs are compared with.

    Args:
        runs: those on it that are remembered, of any application, the oldest first.
    """
    partitions = [each for each in state.of(application).partitions if not each.is_test]
    changed = (drift.address.partition for drift in drifted if drift.drift.is_of_the_host and not drift.address.task)
    return HostNow(
        name=name,
        machine=state.facts.id,
        serial=state.serials.get(application, 0),
        runs=tuple(run for run in runs if run.application == application),
        reserves={each.mark.name: each.settings.reserve for each in partitions if each.mark},
        changed=frozenset(partition for partition in changed if partition),
    )


def compared_with_hosts(proofs: Sequence[ComponentProof], hosts: Sequence[HostNow]) -> tuple[ComponentProof, ...]:
    """Leave out the proofs of other machines, and say of each other one why the host no longer has its layout.

    Robots share the names of hosts, and the log: a proof that another machine gave says nothing of this one.

    Args:
        hosts: those that were looked at; the proofs of other hosts stay as they are.
    """
    by_name = {host.name: host for host in hosts}
    machines = {host.name: host.machine for host in hosts if host.machine}
    own = (proof for proof in proofs if not proof.machine or machines.get(proof.host) in {None, proof.machine})
    return tuple(
        replace(proof, outdated=(*proof.outdated, *_changes_since(proof, by_name[proof.host])))
        if proof.host in by_name
        else proof
        for proof in own
    )


def _changes_since(proof: ComponentProof, host: HostNow) -> Iterator[str]:
    if undone_at := host.undone_at(proof.serial):
        yield f"its layout on {host.name} was undone at {undone_at}"
        return
    foreign = f"was changed on {host.name} by another tool after {host.last_run}"
    if host.runs and host.runs[-1].run is RunKind.UNDO:  # it may have set again what another tool had set
        foreign = f"was changed on {host.name} by the undo at {host.last_run} or by another tool after it"
    if proof.partition in host.changed:
        yield f"its partition {foreign}"
    differences = _differences(proof, host)
    neighbours = [text for name, text in differences.items() if name in host.changed - {proof.partition}]
    by_runs = [text for name, text in differences.items() if name not in host.changed]
    if neighbours:
        yield f"its layout {foreign}: {in_a_row(neighbours)}"
    if by_runs:
        when = f" at {host.last_run}" if host.serial > proof.serial else ""
        yield f"its layout on {host.name} was changed{when}: {in_a_row(by_runs)}"


def _differences(proof: ComponentProof, host: HostNow) -> Mapping[str, str]:
    """By partition of then and now: how its reservation differs."""
    own = {proof.partition: proof.reserve} if proof.partition else {}
    then, now = proof.layout or own, host.reserves
    compared = {*then, *now} if proof.layout else {*then}
    return {
        name: _difference(name, then.get(name), now.get(name))
        for name in sorted(compared, key=natural_order)
        if then.get(name) != now.get(name)
    }


def _difference(name: str, then: int | None, now: int | None) -> str:
    if now is None:
        return f"{name} is gone"
    if then is None:
        return f"{name} is new"
    return f"{name} has {show_percent(now)} of its VPs instead of {show_percent(then)}"
