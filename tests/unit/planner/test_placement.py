"""What a plan says of its choice of hosts: optimal by certificate only, moves that were avoided, and gaps."""

import json

from rarms_iac.model.layout import Layout
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner.layout import Planning, plan_layout
from rarms_iac.planner.packing.checker import check
from rarms_iac.planner.problem import HostView
from rarms_iac.planner.reservations import FixedReservations
from tests.builders import a_component, a_host, a_system
from tests.planning import PLACES

SHARES = {"a": 60, "b": 50, "c": 40, "d": 30, "e": 20}


def system_of(shares: dict[str, int], hosts: int = 3) -> System:
    return a_system(
        hosts=[a_host(f"host{at}") for at in range(hosts)],
        components=[a_component(name, reserve=f"{share} %", memory="64 MiB") for name, share in shares.items()],
    )


def planned(running: dict[str, str], shares: dict[str, int] = SHARES) -> Planning:
    views = {
        host: HostView(present=frozenset(name for name, at in running.items() if at == host))
        for host in ("host0", "host1", "host2")
    }
    return plan_layout(system_of(shares), FixedReservations(), views, PLACES, max_disruption=Disruption.REMOVAL)


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
