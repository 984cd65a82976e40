"""How a Linux host keeps a reservation, and what its kernel would refuse."""

from collections.abc import Iterable
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.model.host import Host, LinuxHost, Mechanism, ProviderKind
from rarms_iac.model.layout import Layout, PlacedPartition
from rarms_iac.model.system import MOST_WEIGHT, USUAL_WEIGHT, Component, Headroom, System, weight_of_criticality
from rarms_iac.planner.layout import Planning, plan_layout
from rarms_iac.planner.mechanism import deadline_percent, quota_period_us
from rarms_iac.planner.reservations import FixedReservations
from tests.builders import a_component, a_host, a_partition, a_system, at_most
from tests.planning import PLACES
from tests.strategies import state_with


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
    assert found["vision"].why_limit == "no limit: a limit would make its measurements invalid"
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
        assert found.why_weight == "fixed in the manifest for speech"


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


APT = {"mean_response_time": at_most(88), "maximum_response_time": at_most(400)}
VISION = a_component("vision", reserve="35 %", apt=APT)
SPEECH = a_component("speech", reserve="20 %")


def a_linux_host(mechanism: Mechanism) -> Host:
    return a_host(provider=ProviderKind.LINUX, settings=LinuxHost(mechanism=mechanism))


def planned(
    host: Host, components: Iterable[Component], *, together: Iterable[str] = (), percent: int | None = None
) -> Planning:
    partitions = [a_partition("both", components=together)] if together else []
    states = {host.name: state_with(host, deadline_percent=percent)}
    system = a_system(hosts=[host], components=components, partitions=partitions)
    return plan_layout(system, FixedReservations(), states, PLACES)


def vision_with(mechanism: Mechanism, *, processors: int | None = None) -> PlacedPartition:
    vision = a_component("vision", reserve="35 %", apt=APT, processors=processors)
    answer = planned(a_linux_host(mechanism), [vision, SPEECH]).answer
    assert isinstance(answer, Layout)
    return next(partition for partition in answer.partitions if partition.name == "vision")


def test_linux_share_caps_nothing() -> None:
    found = vision_with(Mechanism.AUTOMATIC)

    settings = found.settings
    assert (settings.limit, settings.weight, settings.quota_period_us, settings.generation) == (100, 100, 0, 0)
    assert found.why_weight == "Linux shares what is not reserved in proportion to the reservations"
    assert found.mechanism == "kept as a share, so that idle processors are used (chosen by rarms)"


def test_quota_limits_within_the_threshold() -> None:
    found = vision_with(Mechanism.QUOTA)

    assert (found.settings.reserve, found.settings.limit, found.settings.quota_period_us) == (35, 35, 8_800)
    assert "the mechanism is quota" in found.why_limit
    assert found.mechanism.endswith("(set in the manifest)")


def test_fewer_processors_are_a_linux_quota() -> None:
    found = vision_with(Mechanism.SHARE, processors=1)

    assert (found.settings.processors, found.settings.limit, found.settings.quota_period_us) == (1, 100, 8_800)


@pytest.mark.parametrize(
    ("apt_ms", "quota_percent", "period_us"),
    [(88, 70, 8_800), (2, 70, 1_429), (5_000, 70, 100_000), (None, 70, 100_000), (10, 5, 20_000)],
)
def test_period_is_a_tenth_of_the_threshold(apt_ms: float | None, quota_percent: int, period_us: int) -> None:
    assert quota_period_us(apt_ms, quota_percent) == period_us


def test_deadline_gives_one_thread_everything() -> None:
    found = vision_with(Mechanism.DEADLINE)

    assert (found.settings.reserve, found.settings.limit, found.settings.quota_period_us) == (35, 100, 0)
    assert (deadline_percent(35, 2), deadline_percent(60, 2)) == (70, 95)
    assert planned(a_linux_host(Mechanism.DEADLINE), [VISION, SPEECH]).findings == ()


@pytest.mark.parametrize(
    ("components", "together", "percent", "message"),
    [
        ([VISION, SPEECH], ("vision", "speech"), None, "both has 2 components, but a deadline applies to one thread."),
        (
            [a_component("vision", task="MotionControl")],
            (),
            None,
            "vision has a task class, but a thread has either a deadline or a priority.",
        ),
        (
            [VISION, SPEECH],
            (),
            0,
            (
                "The control groups of onboard have only some of its 2 processors. The kernel refuses "
                "SCHED_DEADLINE to a thread that cannot run on all processors."
            ),
        ),
        (
            [VISION, SPEECH],
            (),
            50,
            "Deadlines on onboard need 40 % (speech) + 70 % (vision) = 110 % of a processor. "
            "The kernel admits 100 %: 50 % of each of 2 (sched_rt_runtime_us).",
        ),
    ],
)
def test_deadline_that_kernel_would_refuse_is_refused_before(
    components: list[Component], together: tuple[str, ...], percent: int | None, message: str
) -> None:
    findings = planned(a_linux_host(Mechanism.DEADLINE), components, together=together, percent=percent).findings

    assert [(finding.code, finding.detail) for finding in findings] == [("RARMS314", message)]
