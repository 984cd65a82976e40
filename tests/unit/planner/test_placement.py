"""What a plan says of its choice of hosts: how good it is, what moves, and how far from the bound it may be."""

from dataclasses import replace

from rarms_iac.model.layout import Layout, Placement
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner.layout import Planning, plan_layout
from rarms_iac.planner.reservations import FixedReservations
from tests.builders import a_component, a_host, a_system
from tests.planning import PLACES
from tests.strategies import state_with

SHARES = {"a": 60, "b": 50, "c": 40, "d": 30, "e": 20}


def system_of(shares: dict[str, int], hosts: int = 3) -> System:
    return a_system(
        hosts=[a_host(f"host{at}") for at in range(hosts)],
        components=[a_component(name, reserve=f"{share} %", memory="64 MiB") for name, share in shares.items()],
    )


def planned(
    running: dict[str, str],
    shares: dict[str, int] = SHARES,
    hosts: int = 3,
    max_disruption: Disruption = Disruption.REMOVAL,
) -> Planning:
    system = system_of(shares, hosts)
    states = {
        name: state_with(host, *(partition for partition, at in running.items() if at == name))
        for name, host in system.hosts.items()
    }
    return plan_layout(system, FixedReservations(), states, PLACES, max_disruption=max_disruption)


def hosts_of(planning: Planning) -> dict[str, str]:
    assert isinstance(planning.answer, Layout)
    return {name: partition.host for partition in planning.answer.partitions for name in partition.components}


def placement_of(planning: Planning) -> Placement:
    assert isinstance(planning.answer, Layout)
    assert planning.answer.placement is not None
    return planning.answer.placement


def test_a_layout_that_runs_and_fits_stays() -> None:
    running = {"a": "host2", "b": "host1", "c": "host2", "d": "host1", "e": "host0"}

    planning = planned(running)

    assert hosts_of(planning) == running
    placement = placement_of(planning)
    assert (placement.verdict, placement.reserved, placement.moves) == ("optimal", 400, 0)
    assert not planning.findings


def test_one_point_moves_only_what_must() -> None:
    """Two partitions fill a host; one grows by a point, so that one of them must leave, and no other."""
    running = {"a": "host0", "c": "host0", "b": "host1", "d": "host1", "e": "host2"}

    planning = planned(running, {**SHARES, "c": 41})

    assert sum(hosts_of(planning)[name] != host for name, host in running.items()) == 1
    placement = placement_of(planning)
    assert (placement.moves, placement.moves_bound) == (1, 1)


def test_host_order_moves_nothing() -> None:
    shares = {"a": 60, "b": 60}

    assert hosts_of(planned({"a": "host1", "b": "host0"}, shares, hosts=2)) == {"a": "host1", "b": "host0"}
    assert hosts_of(planned({}, shares, hosts=2)) == {"a": "host0", "b": "host1"}


def test_no_choice_says_nothing() -> None:
    planning = plan_layout(system_of({"a": 30}, hosts=1), FixedReservations(), {}, PLACES)

    assert isinstance(planning.answer, Layout)
    assert planning.answer.placement is None
    assert not planning.findings


def test_staying_partitions_are_counted() -> None:
    """Thirty-five that stay where they are, and the five that have a choice beside them."""
    fixed = {f"p{at:02}": f"host{at % 3}" for at in range(35)}

    planning = planned(fixed, {**dict.fromkeys(fixed, 2), **SHARES}, max_disruption=Disruption.LIVE)

    assert {name: host for name, host in hosts_of(planning).items() if name in fixed} == fixed
    placement = placement_of(planning)
    assert (placement.verdict, placement.reserved) == ("optimal", 2 * (70 + 200))


def test_unproved_layout_says_its_distance() -> None:
    placement = Placement(reserved=420, reserved_bound=400, moves=3, moves_bound=1)

    assert placement.verdict == "within the bound"
    assert not placement.proven
    assert replace(placement, reserved=400, moves=1).verdict == "optimal"
