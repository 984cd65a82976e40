"""A refusal says who cannot share which host, names no more than it must, and says how sure that is."""

from dataclasses import replace
from fractions import Fraction

import pytest

from rarms_iac.model.layout import Infeasible, Relaxation
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner import planning_findings
from rarms_iac.planner.infeasibility import causes
from rarms_iac.planner.infeasibility.conflict import NODES_FOR_CHANGES, NODES_OF_A_SEARCH, SearchBudget
from rarms_iac.planner.layout import Planning, causes_as_findings, plan_layout
from rarms_iac.planner.reservations import FixedReservations
from rarms_iac.planner.totals import planned_totals
from tests.builders import a_component, a_host, a_system
from tests.planning import PLACES
from tests.strategies import state_with


def planned(system: System) -> Planning:
    return plan_layout(system, FixedReservations(), {}, PLACES, max_disruption=Disruption.REMOVAL)


def five_of_two(hosts: int = 1, others: int = 0) -> System:
    """On a host of two logical processors, five virtual ones of 40 %: their sum is all there is."""
    bound = [a_component(f"p{at}", reserve="20 %", processors=1, memory="64 MiB") for at in range(5)]
    free = [a_component(f"q{at:02}", reserve="1 %", processors=1, memory="64 MiB") for at in range(others)]
    return a_system(
        hosts=[a_host(f"host{at}", logical_processors=2, memory="16 GiB") for at in range(hosts)],
        components=[*(replace(component, hosts=("host0",)) for component in bound), *free],
    )


def test_unplaceable_virtual_processors_are_told() -> None:
    planning = planned(five_of_two())

    assert isinstance(planning.answer, Infeasible)
    assert [(finding.code, finding.detail) for finding in planning.findings] == [
        (
            "RARMS121",
            "p0, p1, p2, p3 and p4 cannot share host0: each virtual processor needs its whole reserve on one of the "
            "two logical processors, and no such placement exists.",
        )
    ]


@pytest.mark.needs("highspy")
@pytest.mark.parametrize("others", [3, 40])
def test_few_among_many_are_named_with_their_host(others: int) -> None:
    planning = planned(five_of_two(hosts=4, others=others))

    answer = planning.answer
    assert isinstance(answer, Infeasible)
    assert answer.proven
    assert answer.causes[0].values["partitions"] == ("p0", "p1", "p2", "p3", "p4")
    assert (planning.findings[0].code, planning.findings[0].address) == ("RARMS121", "host/host0")


def test_sum_on_a_forced_host_is_told() -> None:
    heavy = [a_component(name, reserve="60 %", memory="64 MiB") for name in ("a", "b")]
    light = [a_component(name, reserve="10 %", memory="64 MiB") for name in ("c", "d")]
    system = a_system(
        hosts=[a_host(name, logical_processors=2) for name in ("left", "right")],
        components=[*(replace(component, hosts=("right",)) for component in heavy), *light],
    )

    planning = planned(system)

    assert isinstance(planning.answer, Infeasible)
    assert [(finding.code, finding.address) for finding in planning.findings] == [("RARMS014", "host/right")]
    assert planning.findings[0].detail == "a 1.2 LP and b 1.2 LP need 2.4 LP; right has 2 LP for partitions."
    expected = {"partitions": ("a", "b"), "hosts": ("right",), "needs_lp": 2.4, "has_lp": 2.0, "proven": True}
    assert expected.items() <= planning.findings[0].values.items()


def test_others_on_the_same_host_are_summed() -> None:
    components = [a_component(name, reserve=reserve) for name, reserve in (("a", "60 %"), ("b", "50 %"), ("c", "10 %"))]

    planning = planned(a_system(hosts=[a_host(logical_processors=2, memory="16 GiB")], components=components))

    sums = "a 1.2 LP and b 1 LP need 2.2 LP; onboard has 2 LP for partitions. With c, the total is 2.4 LP."
    assert [finding.detail for finding in planning.findings] == [sums]


def test_overfilling_component_is_named_with_total() -> None:
    parts = [("a", "60 %", "left"), ("b", "50 %", "left"), ("c", "60 %", "right")]
    bound = [replace(a_component(name, reserve=reserve), hosts=(host,)) for name, reserve, host in parts]
    hosts = [a_host(name, logical_processors=2, memory="16 GiB") for name in ("left", "right")]
    system = a_system(hosts=hosts, components=[*bound, a_component("t", reserve="50 %")])

    (finding,) = planned(system).findings

    sums = "a 1.2 LP and b 1 LP need 2.2 LP; left has 2 LP for partitions. With t, the total is 3.2 LP."
    assert finding.detail == sums
    assert planned_totals(system, FixedReservations(), {}).hosts["left"].reserved_lp == Fraction("3.2")


@pytest.mark.parametrize(
    ("changes", "advice"),
    [
        (("arm reserves 20 % instead of 30 %",), "This change would be enough: arm reserves 20 % instead of 30 %."),
        (("one", "two"), "All of these changes together would be enough:\n  - one\n  - two."),
    ],
)
def test_only_way_out_is_sentence_or_list(changes: tuple[str, ...], advice: str) -> None:
    cause = planning_findings.PLACEMENT.at(None, "Nothing fits.", "", address="application")
    answer = Infeasible(proven=True, causes=(cause,), relaxations=(Relaxation(changes=changes),))

    assert [str(finding.advice) for finding in causes_as_findings(answer, five_of_two(), PLACES)] == [advice]


@pytest.mark.parametrize(
    ("proven", "detail"),
    [
        (True, "Nothing fits."),
        (False, "Nothing fits. The search ended at its limit, so a layout may still exist."),
    ],
)
def test_unproven_infeasibility_says_so(proven: bool, detail: str) -> None:
    cause = planning_findings.PLACEMENT.at(None, "Nothing fits.", "", address="application")
    answer = Infeasible(proven=proven, causes=(cause,), relaxations=())

    assert [finding.detail for finding in causes_as_findings(answer, five_of_two(), PLACES)] == [detail]


def test_what_the_limit_left_unsearched_is_printed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(causes, "NODES_FOR_CHANGES", 0)

    (finding,) = planned(five_of_two()).findings

    limit = f"The search for causes and changes is limited to {NODES_OF_A_SEARCH} solver nodes."
    assert f"\n{limit} Not searched to the end: more logical processors" in str(finding.advice)
    assert finding.values["node_limit"] == NODES_OF_A_SEARCH


def test_twice_the_size_is_not_searched_longer() -> None:
    asked = []
    for components, hosts in ((125, 25), (250, 50)):
        budget, questions = SearchBudget.of(NODES_FOR_CHANGES), 0
        while budget.takes("changes", components * hosts):
            questions += 1
        asked.append(questions * components * hosts)
    assert asked[1] == pytest.approx(asked[0], rel=0.1)


def test_only_partitions_that_must_move_are_named() -> None:
    """Of twelve on three hosts two have to leave the first, which a layout made afresh would not keep in place."""
    names = [f"p{at:02}" for at in range(12)]
    system = a_system(
        hosts=[a_host(f"host{at}", logical_processors=2, memory="16 GiB") for at in range(3)],
        components=[a_component(name, reserve="20 %", processors=1, memory="64 MiB") for name in names],
    )
    states = {
        f"host{at}": state_with(system.hosts[f"host{at}"], *on)
        for at, on in enumerate((names[:6], names[6:9], names[9:]))
    }

    planning = plan_layout(system, FixedReservations(), states, PLACES)

    (finding,) = planning.findings
    moved = finding.values["would_move"]
    assert isinstance(moved, tuple)
    assert len(moved) == 2
    assert set(moved) < set(names[:6])


@pytest.mark.parametrize(
    ("processors", "reserve", "end"),
    [
        (4, "1.33 LP", "1.33 LP on 4 VPs is rounded up to 1.36 LP. With 1.32 LP each, a, b and c fit."),
        (2, "1.33 LP", "1.33 LP on 2 VPs is rounded up to 1.34 LP."),
        (2, "1.36 LP", "onboard has 4 LP for partitions."),
        (2, "1.37 LP", "onboard has 4 LP for partitions."),
    ],
    ids=["it would fit", "the sum would fit", "not rounded", "too much without rounding"],
)
def test_rounding_is_told_when_it_decides(processors: int, reserve: str, end: str) -> None:
    names = ("a", "b", "c")
    components = [a_component(name, reserve=reserve, processors=processors, memory="64 MiB") for name in names]

    (finding,) = planned(a_system(hosts=[a_host(logical_processors=4)], components=components)).findings

    assert finding.detail.endswith(end)
