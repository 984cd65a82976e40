"""Proofs against the hosts as they are now: whether the proven layout was changed or undone since, and when."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from rarms_iac.app.compared_host import ComparedHost
from rarms_iac.app.report_model import ComponentProof
from rarms_iac.model.journal import RunKind
from rarms_iac.model.quantities import show_percent
from rarms_iac.model.wording import in_a_row, natural_order


def compared_with_hosts(proofs: Sequence[ComponentProof], hosts: Sequence[ComparedHost]) -> tuple[ComponentProof, ...]:
    """Leave out the proofs of other machines, and say of each other one why the host no longer has its layout.

    Robots share the names of hosts, and the log: a proof that another machine gave says nothing of this one.

    Args:
        hosts: those that were looked at; the proofs of other hosts stay as they are.
    """
    by_name = {host.name: host for host in hosts}
    machines = {host.name: host.seen.facts.id for host in hosts if host.seen.facts.id}
    own = (proof for proof in proofs if not proof.machine or machines.get(proof.host) in {None, proof.machine})
    return tuple(
        replace(proof, outdated=(*proof.outdated, *_changes_since(proof, by_name[proof.host])))
        if proof.host in by_name
        else proof
        for proof in own
    )


def _changes_since(proof: ComponentProof, host: ComparedHost) -> Iterator[str]:
    if undone_at := host.undone_at(proof.serial):
        yield f"its layout on {host.name} was undone at {undone_at}"
        return
    foreign = f"was changed on {host.name} by another tool after {host.last_run_at}"
    if host.own_runs and host.own_runs[-1].run is RunKind.UNDO:  # it may have set again what another tool had set
        foreign = f"was changed on {host.name} by the undo at {host.last_run_at} or by another tool after it"
    if proof.partition in host.changed_partitions:
        yield f"its partition {foreign}"
    differences = _differences(proof, host)
    neighbours = [text for name, text in differences.items() if name in host.changed_partitions - {proof.partition}]
    by_runs = [text for name, text in differences.items() if name not in host.changed_partitions]
    if neighbours:
        yield f"its layout {foreign}: {in_a_row(neighbours)}"
    if by_runs:
        when = f" at {host.last_run_at}" if host.serial > proof.serial else ""
        yield f"its layout on {host.name} was changed{when}: {in_a_row(by_runs)}"


def _differences(proof: ComponentProof, host: ComparedHost) -> Mapping[str, str]:
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
