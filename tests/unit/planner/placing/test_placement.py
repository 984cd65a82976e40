"""What a plan says of its choice of hosts: optimal by certificate only, moves that were avoided, and gaps."""

import json
from dataclasses import replace
from fractions import Fraction
from random import Random

from rarms_iac.model.capacity import Capacity
from rarms_iac.model.layout import Layout
from rarms_iac.model.plan import Claim
from rarms_iac.model.quantities import Bytes, LogicalProcessors
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner.certifying.checker import check
from rarms_iac.planner.layout import Planning, plan_layout
from rarms_iac.planner.placing.first_fit import Bin, Item
from rarms_iac.planner.placing.place import place
from rarms_iac.planner.problem import HostView
from rarms_iac.planner.reservations import FixedReservations
from tests.builders import a_component, a_host, a_system
from tests.planning import PLACES


def a_bin(name: str, processors: int) -> Bin:
    return Bin(
        name=name,
        capacity=Capacity(
            logical_processors=processors, processors=LogicalProcessors(Fraction(processors)), memory=Bytes(99)
        ),
    )


SHARES = {"a": 60, "b": 50, "c": 40, "d": 30, "e": 20}


def system_of(shares: dict[str, int], hosts: int = 3) -> System:
    return a_system(
        hosts=[a_host(f"host{at}") for at in range(hosts)],
        components=[a_component(name, reserve=f"{share} %", memory="64 MiB") for name, share in shares.items()],
    )


def planned(running: dict[str, str], shares: dict[str, int] = SHARES, hosts: int = 3) -> Planning:
    views = {
        f"host{number}": HostView(present=frozenset(name for name, at in running.items() if at == f"host{number}"))
        for number in range(hosts)
    }
    return plan_layout(system_of(shares, hosts), FixedReservations(), views, PLACES, max_disruption=Disruption.REMOVAL)


def hosts_of(planning: Planning) -> dict[str, str]:
    assert isinstance(planning.answer, Layout)
    return {name: one.host for one in planning.answer.partitions for name in one.components}


def moved(running: dict[str, str], where: dict[str, str]) -> int:
    return sum(where[name] != host for name, host in running.items())


def what_is_said(running: dict[str, str], shares: dict[str, int], hosts: int = 3) -> tuple[str, str]:
    """What a plan says of moves that were avoided, and what the same planned for empty hosts shows to be true."""
    now, anew = planned(running, shares, hosts), planned({}, shares, hosts)
    made = moved(running, hosts_of(now))
    more = moved(running, hosts_of(anew)) - made
    assert isinstance(now.answer, Layout)
    assert now.answer.placement is not None
    assert now.answer.placement.avoided == max(0, more)
    moves = "1 more move" if more == 1 else f"{more} more moves"
    true = f"Packing anew would have made {moves} than the {made} of this layout." if more > 0 else ""
    said = [one.detail for one in now.findings if one.code == "RARMS300"]
    return (said[0][: len(true)] if said else ""), true


def test_a_layout_that_runs_and_fits_stays_and_its_certificate_is_accepted() -> None:
    running = {"a": "host2", "b": "host1", "c": "host2", "d": "host1", "e": "host0"}

    answer = planned(running).answer

    assert isinstance(answer, Layout)
    assert {name: one.host for one in answer.partitions for name in one.components} == running
    assert answer.placement is not None
    assert (answer.placement.verdict, answer.placement.moves) == ("optimal", 0)
    assert answer.placement.avoided > 0
    certificate = json.loads(answer.placement.certificate)
    check(certificate["problem"], certificate["claim"])


def test_moves_that_were_avoided_are_told() -> None:
    running = {"a": "host2", "b": "host1", "c": "host2", "d": "host1", "e": "host0"}

    told = [one for one in planned(running).findings if one.code == "RARMS300"]

    assert len(told) == 1
    assert "the 0 of this layout. No layout that reserves as little moves fewer." in told[0].detail


def test_packing_anew_is_what_a_plan_for_empty_hosts_makes() -> None:
    """One size changes by a point under a layout that runs, be it the first by name or one that somebody made."""
    told = set()
    for seed in range(30):
        random = Random(seed)
        shares = {f"c{at}": random.randint(15, 55) for at in range(random.randint(4, 7))}
        first = planned({}, shares)
        if not isinstance(first.answer, Layout):
            continue
        hosts = random.sample(["host0", "host1", "host2"], 3)
        running = {name: hosts[int(host[-1])] for name, host in hosts_of(first).items()}
        shares[random.choice(sorted(shares))] += random.choice((-1, 1))
        said, true = what_is_said(running, shares)
        assert said == true
        told.add(true)

    assert "" in told, "nothing is said where packing anew moves nothing more"
    assert len(told) > 3


def test_equal_hosts_in_another_order_are_moves_only_against_the_first_by_name() -> None:
    shares = {"a": 60, "b": 60}

    assert what_is_said({"a": "host0", "b": "host1"}, shares, hosts=2) == ("", "")
    said, true = what_is_said({"a": "host1", "b": "host0"}, shares, hosts=2)
    assert said == true == "Packing anew would have made 2 more moves than the 0 of this layout."


def test_beyond_what_is_packed_exactly_the_same_is_true() -> None:
    shares = {f"c{at:02}": 8 + at % 5 for at in range(33)}
    running = {
        name: f"host{2 - int(host[-1])}" for name, host in hosts_of(planned({}, shares, 5)).items() if host < "host3"
    }

    said, true = what_is_said(running, shares, 5)

    assert said == true != ""


def test_beyond_it_nothing_is_said_of_what_only_a_search_could_tell() -> None:
    """Not all have room where they cost least: what packing anew comes to is not looked for."""
    cheap, dear = (Claim(processors=1, reserve=reserve, memory=Bytes(1)) for reserve in (10, 20))
    bins = [a_bin("host0", 1), a_bin("host1", 9)]
    items = [Item(name=f"c{at:02}", claims={"host0": cheap, "host1": dear}, now="host1") for at in range(31)]
    empty = [replace(one, now="") for one in items]

    assert place(items, bins).avoided == 0
    assert place(empty, bins).hosts is not None


def test_one_point_more_moves_no_more_than_must_move() -> None:
    """Two partitions fill a host; one grows by a point, so that one of them must leave, and no other."""
    running = {"a": "host0", "c": "host0", "b": "host1", "d": "host1", "e": "host2"}

    answer = planned(running, {**SHARES, "c": 41}).answer

    assert isinstance(answer, Layout)
    where = {name: one.host for one in answer.partitions for name in one.components}
    assert sum(where[name] != host for name, host in running.items()) == 1
    assert answer.placement is not None
    assert (answer.placement.moves, answer.placement.moves_bound) == (1, 1)


def test_where_nothing_is_to_be_chosen_nothing_is_said() -> None:
    planning = plan_layout(system_of({"a": 30}, hosts=1), FixedReservations(), {}, PLACES)

    assert isinstance(planning.answer, Layout)
    assert planning.answer.placement is None
    assert not planning.findings


def test_more_than_thirty_where_each_costs_least_are_certified() -> None:
    system = system_of({f"p{at:02}": 5 for at in range(40)})

    answer = plan_layout(system, FixedReservations(), {}, PLACES).answer

    assert isinstance(answer, Layout)
    assert answer.placement is not None
    assert answer.placement.verdict == "optimal"
    certificate = json.loads(answer.placement.certificate)
    assert certificate["partitions"] == sorted(system.components)
    check(certificate["problem"], certificate["claim"])


def test_of_those_that_can_be_in_one_place_only_no_certificate_tells() -> None:
    """Thirty-five that stay where they are, and the five that have a choice beside them."""
    fixed = {f"p{at:02}": f"host{at % 3}" for at in range(35)}
    system = system_of({**dict.fromkeys(fixed, 2), **SHARES})
    views = {
        host: HostView(present=frozenset(name for name, at in fixed.items() if at == host))
        for host in ("host0", "host1", "host2")
    }

    answer = plan_layout(system, FixedReservations(), views, PLACES, max_disruption=Disruption.LIVE).answer

    assert isinstance(answer, Layout)
    assert {name: one.host for one in answer.partitions for name in one.components if name in fixed} == fixed
    assert answer.placement is not None
    assert (answer.placement.verdict, answer.placement.reserved) == ("optimal", 2 * (70 + 200))
    certificate = json.loads(answer.placement.certificate)
    assert certificate["partitions"] == sorted(SHARES)
    check(certificate["problem"], certificate["claim"])
