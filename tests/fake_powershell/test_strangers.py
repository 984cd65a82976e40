"""Machines that look like ours and over which something else decides: replicas, clusters, shielded machines."""

from dataclasses import replace
from functools import cache

import pytest

from rarms_iac.model.plan import Purpose
from rarms_iac.model.system import HypervPartition
from tests.builders import a_component, a_partition
from tests.fake_powershell.cell import Cell, apply, scripts_of
from tests.fake_powershell.cells import Prepared, a_cell_system, a_stranger, a_windows
from tests.fake_powershell.host import Vm, WindowsHost
from tests.fake_powershell.observing import seen


def cell(host: WindowsHost, reserve: int = 10, *, clustered: bool | None = None) -> Cell:
    partition = replace(a_partition("vision"), hyperv=HypervPartition(clustered=clustered))
    return Cell(a_cell_system(a_component("vision", reserve=f"{reserve} %"), partitions=(partition,)), host)


def made() -> WindowsHost:
    return _made().copy()


@cache
def _made() -> WindowsHost:
    host = a_windows()
    assert apply(host, cell(host).plan()).code == 0
    return host


def the_machine(host: WindowsHost) -> Vm:
    return host.machine("vision")


@pytest.mark.parametrize("mode", ["Replica", "TestReplica", "ExtendedReplica"])
def test_replica_is_stranger_whose_name_is_taken(mode: str) -> None:
    host = made()
    the_machine(host).replication_mode = mode
    the_machine(host).state = "Off"

    found = cell(host, 20).prepare()

    assert found.plan is None
    (replica,) = cell(host).observe().partitions
    assert (replica.mark, replica.claims_resources) == (None, False)
    assert "replica of one on another host" in replica.foreign_mark


def test_a_primary_is_ours() -> None:
    host = made()
    the_machine(host).replication_mode = "Primary"

    assert apply(host, cell(host, 20).plan()).code == 0


@pytest.mark.parametrize(
    ("tie", "words"),
    [
        ({"replication_mode": "Replica"}, "a replica of one on another host"),
        ({"clustered": "True"}, "of a failover cluster"),
        ({"shielded": True}, "shielded"),
    ],
    ids=["replica", "cluster", "shielded"],
)
@pytest.mark.parametrize("purpose", [Purpose.APPLY, Purpose.DESTROY])
def test_tied_machine_is_refused_by_name(tie: dict[str, object], words: str, purpose: Purpose) -> None:
    host = made()
    plan = cell(host, 20).plan(purpose=purpose)
    for name, value in tie.items():
        setattr(the_machine(host), name, value)
    before = seen(host)

    ran = apply(host, plan)

    assert ran.code == 3, ran.says
    assert f"machine vision ({the_machine(host).id}) is {words}, and not changed here" in ran.events[-1]["detail"]
    assert seen(host) == before


def test_clustered_machine_needs_permission_and_tells_cluster() -> None:
    host = made()
    the_machine(host).clustered, the_machine(host).cluster_knows = "True", False

    refused = cell(host, 20).prepare()
    plan = cell(host, 20, clustered=True).plan()
    ran = apply(host, plan)

    assert (refused.plan, "RARMS152" in [finding.code for finding in refused.findings]) == (None, True)
    assert ran.code == 0, ran.says
    assert (the_machine(host).reserve, the_machine(host).cluster_knows) == (20, True)
    assert apply(host, plan).code == 0


def test_clustered_machine_is_never_removed() -> None:
    host = made()
    the_machine(host).clustered = "True"

    found = cell(host, clustered=True).prepare(purpose=Purpose.DESTROY)

    assert (found.plan, "RARMS152" in [finding.code for finding in found.findings]) == (None, True)


def test_stopped_replica_takes_no_room() -> None:
    host = made()
    plan = cell(host, 80).plan()
    greedy = a_stranger("greedy", 9, processors=4, reserve=60, state="Off", start_action="Start")
    host.vms[greedy.id] = greedy

    refused = apply(host.copy(), plan)
    greedy.replication_mode = "Replica"
    ran = apply(host, plan)

    assert (refused.code, ran.code) == (1, 0), f"{refused.says}\n{ran.says}"


def test_scripts_of_unclustered_machine_name_no_cluster() -> None:
    host = made()
    prepared = Prepared(cell(host), cell(host, 20).plan())

    assert all(b"FailoverClusters" not in script for script in scripts_of(prepared.plan).values())
