from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.model.layout import Layout, PlacedPartition
from rarms_iac.model.system import MOST_WEIGHT, USUAL_WEIGHT, Headroom, System, weight_of_criticality
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.reservations import FixedReservations
from tests.builders import a_component, a_system, at_most
from tests.planning import PLACES


def partitions_of(system: System, headroom: Headroom = Headroom.BY_CRITICALITY) -> dict[str, PlacedPartition]:
    wanted = replace(system, policy=replace(system.policy, headroom=headroom))
    answer = plan_layout(wanted, FixedReservations(), {}, PLACES).answer
    assert isinstance(answer, Layout)
    return {partition.name: partition for partition in answer.partitions}


def a_robot(reserve: str = "30 %") -> System:
    return a_system(
        components=[
            a_component("vision", criticality=30, reserve=reserve, apt={"mean_response_time": at_most(100)}),
            a_component("speech", criticality=10, reserve="20 %"),
            a_component("logging", criticality=0, reserve=None),
        ]
    )


def test_by_criticality_more_critical_has_larger_part() -> None:
    found = partitions_of(a_robot())

    assert {name: (partition.settings.limit, partition.settings.weight) for name, partition in found.items()} == {
        "vision": (100, 3000),
        "speech": (100, 1000),
        "logging": (100, 100),
    }
    assert found["vision"].why_limit == "left open: a cap would falsify what was measured"
    assert "100 times the criticality 30" in found["vision"].why_weight


def test_shared_partition_has_its_highest_weight() -> None:
    system = a_robot()
    vision = replace(system.components["vision"], together=("speech",))
    found = partitions_of(replace(system, components={**system.components, "vision": vision}))

    [shared] = [each for each in found.values() if each.settings.weight == 3000]
    assert "100 times the criticality 30 of its most critical member, within" in shared.why_weight


def test_what_one_needs_moves_no_other_share() -> None:
    before, after = partitions_of(a_robot()), partitions_of(a_robot("45 %"))

    assert before["vision"] != after["vision"]
    assert {name: partition for name, partition in before.items() if name != "vision"} == {
        name: partition for name, partition in after.items() if name != "vision"
    }


def test_equal_hands_out_the_same() -> None:
    weights = {partition.settings.weight for partition in partitions_of(a_robot(), Headroom.EQUAL).values()}
    assert weights == {USUAL_WEIGHT}


def test_none_keeps_those_without_apt_to_their_reservation() -> None:
    found = partitions_of(a_robot(), Headroom.NONE)

    assert {name: (partition.settings.limit, partition.settings.weight) for name, partition in found.items()} == {
        "vision": (100, 100),
        "speech": (20, 1),
        "logging": (100, 1),
    }


def test_what_the_manifest_fixes_stands_under_every_policy() -> None:
    system = a_system(components=[a_component("speech", criticality=9, weight=50, limit="80 %"), a_component("vision")])

    for policy in Headroom:
        found = partitions_of(system, policy)["speech"]
        assert (found.settings.limit, found.settings.weight) == (80, 50)
        assert found.why_weight == "the manifest fixes it for speech"


def test_a_new_component_moves_no_other_weight() -> None:
    system = a_robot()
    more = replace(system, components={**system.components, "arm": a_component("arm", criticality=7, reserve="5 %")})

    before, after = partitions_of(system), partitions_of(more)

    assert {name: after[name] for name in before} == before


@given(st.lists(st.integers(0, 1_000_000), min_size=1))
def test_weights_follow_criticalities_to_a_hundred(criticalities: list[int]) -> None:
    weights = [weight_of_criticality(criticality) for criticality in sorted(criticalities)]

    assert weights == sorted(weights)
    assert all(USUAL_WEIGHT <= weight <= MOST_WEIGHT for weight in weights)
    assert len({weight_of_criticality(criticality) for criticality in range(1, 101)}) == 100
