from dataclasses import replace
from fractions import Fraction

from rarms_iac.model.host import HypervHost, ProviderKind
from rarms_iac.model.layout import Infeasible, Layout
from rarms_iac.model.state import Partition, RunState, State
from rarms_iac.model.system import CpuRequest, Disruption, RunsOn, System
from rarms_iac.planner.layout import Planning, plan_layout
from rarms_iac.planner.reservations import FixedReservations
from tests.builders import a_component, a_cpu, a_host, a_partition, a_system, at_most, codes, the_delivery_robot
from tests.planning import PLACES
from tests.strategies import MIB, Strangers, empty_state, some_settings, state_with


def planned(system: System, states: dict[str, State] | None = None, limit: Disruption | None = None) -> Planning:
    return plan_layout(system, FixedReservations(), states or {}, PLACES, max_disruption=limit)


def layout(system: System, states: dict[str, State] | None = None, limit: Disruption | None = None) -> Layout:
    answer = planned(system, states, limit).answer
    assert isinstance(answer, Layout), answer
    return answer


def misfit(system: System, states: dict[str, State] | None = None) -> tuple[Infeasible, list[str]]:
    found = planned(system, states)
    assert isinstance(found.answer, Infeasible)
    return found.answer, [finding.code for finding in found.findings]


def test_the_delivery_robot_gets_what_it_fixes() -> None:
    found = layout(the_delivery_robot())

    assert {
        partition.name: (partition.settings.reserve, partition.settings.limit, partition.settings.weight)
        for partition in found.partitions
    } == {
        "face-detection": (40, 100, 4000),
        "speech-recognition": (30, 100, 3000),
        "path-planning": (20, 60, 2000),
        "video-streaming": (10, 100, 1000),
    }
    assert found.placement is None, "there was one host to choose"


def test_reserve_is_rounded_up_to_whole_per_cent() -> None:
    (partition,) = layout(a_system(components=[a_component(reserve="0.25 LP", processors=2)])).partitions

    assert (partition.settings.reserve, partition.reserved) == (13, Fraction(26, 100))


def test_manual_partition_has_the_sum_of_members() -> None:
    members = [
        a_component("vision", reserve="30 %", limit="50 %", memory="512 MiB", criticality=2),
        a_component("speech", reserve="20 %", limit="40 %", memory="256 MiB", criticality=3, weight=300),
    ]
    both = a_partition("media", components=["vision", "speech"])

    (partition,) = layout(a_system(components=members, partitions=[both])).partitions
    assert (partition.name, partition.components, partition.criticality) == ("media", ("speech", "vision"), 3)
    settings = partition.settings
    assert (settings.reserve, settings.limit, settings.weight, settings.memory) == (50, 90, 300, 768 * MIB)

    own = replace(both, cpu=a_cpu(reserve="45 %", limit="60 %", weight=50), memory=members[0].memory)
    (partition,) = layout(a_system(components=members, partitions=[own])).partitions
    settings = partition.settings
    assert (settings.reserve, settings.limit, settings.weight, settings.memory) == (45, 60, 50, 512 * MIB)


def test_limit_left_open_by_one_member_is_open() -> None:
    members = [a_component("vision", limit="50 %"), a_component("speech")]

    (partition,) = layout(
        a_system(components=members, partitions=[a_partition("media", components=["vision", "speech"])])
    ).partitions

    assert partition.settings.limit == 100


def test_bound_components_share_a_partition() -> None:
    members = [
        a_component("vision", criticality=1, together=["speech"]),
        a_component("speech", criticality=2),
        a_component("path", criticality=3),
    ]

    found = layout(a_system(components=members))

    assert {partition.name: partition.components for partition in found.partitions} == {
        "path": ("path",),
        "speech": ("speech", "vision"),
    }


def test_kept_and_foreign_capacity_is_not_promised() -> None:
    system = a_system(
        hosts=[a_host(keep_processor="10 %", keep_memory="1 GiB")], components=[a_component(reserve="60 %")]
    )
    holder = Partition(
        settings=replace(some_settings("stranger"), processors=2, reserve=40, memory=1024 * MIB, running=True),
        id="ffff",
        state=RunState.RUNNING,
    )
    host = system.hosts["onboard"]
    assert layout(system).partitions

    def with_stranger(stranger: Partition) -> dict[str, State]:
        return {"onboard": empty_state(host, Strangers((stranger,), ()))}

    found = planned(system, with_stranger(holder))
    assert codes(found.findings) == ["RARMS014"]
    free = 'Of its 2 LP, 0.2 LP are kept for the host. Unmanaged machines hold 0.8 LP: "stranger" 0.8 LP.'
    assert free in found.findings[0].detail
    asleep = replace(holder, settings=replace(holder.settings, running=False), state=RunState.OFF)
    assert layout(system, with_stranger(asleep)).partitions


def test_memory_counts_partitions_outside_the_conflict() -> None:
    needs = {"seams": "1 GiB", "motion": "512 MiB", "messages": "256 MiB"}
    components = [a_component(name, memory=memory) for name, memory in needs.items()]

    found = planned(a_system(hosts=[a_host(memory="1 GiB")], components=components)).findings

    assert found[0].detail == (
        "seams 1 GiB and motion 512 MiB need 1.5 GiB; onboard has 1 GiB to promise. "
        "With messages, it is 1.8 GiB in all."
    )
    assert "768 MiB more memory on onboard" in str(found[0].advice)


def test_overfull_host_is_spread() -> None:
    hosts = [a_host("front"), a_host("rear")]
    system = a_system(hosts=hosts, components=[a_component(name, reserve="50 %") for name in "abcd"])

    found = layout(system)

    assert [(partition.name, partition.host) for partition in found.partitions] == [
        ("a", "front"),
        ("b", "front"),
        ("c", "rear"),
        ("d", "rear"),
    ]
    assert found.placement is not None
    assert found.placement.proven
    assert misfit(a_system(hosts=hosts, components=[a_component(name, reserve="60 %") for name in "abc"]))[1] == [
        "RARMS122"
    ]


def test_least_reservation_in_all_decides_where_hosts_differ() -> None:
    hosts = [a_host("large", logical_processors=8), a_host("small", logical_processors=2)]

    (partition,) = layout(a_system(hosts=hosts, components=[a_component(reserve="20 %")])).partitions

    assert partition.host == "small"


def test_partition_stays_unless_removal_is_allowed() -> None:
    hosts = [a_host("large", logical_processors=8), a_host("small", logical_processors=2)]
    system = a_system(hosts=hosts, components=[a_component(reserve="20 %")])
    states = {"large": state_with(hosts[0], "vision")}

    assert layout(system, states).partitions[0].host == "large"
    assert codes(planned(system, states).findings) == ["RARMS301"]
    assert layout(system, states, Disruption.REMOVAL).partitions[0].host == "small"


def test_smaller_host_is_planned_as_it_is() -> None:
    host = a_host(logical_processors=4)
    states = {"onboard": state_with(host, logical_processors=2)}

    found = planned(a_system(hosts=[host], components=[a_component(reserve="0.5 LP", processors=2)]), states)

    assert isinstance(found.answer, Layout)
    assert codes(found.findings) == ["RARMS126"]


def test_only_common_hosts_are_taken() -> None:
    hosts = [a_host("front"), a_host("rear")]
    system = a_system(hosts=hosts, components=[a_component(hosts=["rear"])])

    assert layout(system).partitions[0].host == "rear"


def test_unmeasured_has_no_layout() -> None:
    apt = {"mean_response_time": at_most(100)}

    assert misfit(a_system(components=[a_component(reserve="measured")]))[1] == ["RARMS100"]
    assert misfit(a_system(components=[a_component(reserve=None, apt=apt)]))[1] == ["RARMS100"]
    assert layout(a_system(components=[a_component(reserve=None)])).partitions[0].settings.reserve == 0


def test_impossible_processors_are_told() -> None:
    assert misfit(a_system(components=[a_component(reserve="1.4 LP", processors=1)]))[1] == ["RARMS060"]
    assert misfit(a_system(components=[a_component(reserve="40 %", processors=4)]))[1] == ["RARMS060"]


def test_a_component_of_the_host_has_no_partition() -> None:
    found = layout(a_system(components=[a_component("watcher", runs_on=RunsOn.HOST)]))

    assert (found.partitions, found.on_hosts) == ((), (("watcher", "onboard"),))


def test_hyperv_settings_come_from_partition_then_host() -> None:
    host = a_host(provider=ProviderKind.HYPERV, settings=HypervHost(switch="lan", image="base.vhdx", generation=1))

    (partition,) = layout(a_system(hosts=[host])).partitions

    assert (partition.settings.generation, partition.making.switch, partition.making.image) == (1, "lan", "base.vhdx")


def test_open_reserve_of_partition_is_its_members() -> None:
    by_hand = replace(a_partition(), cpu=CpuRequest(reserve=None))

    assert layout(a_system(partitions=[by_hand])).partitions[0].settings.reserve == 20
