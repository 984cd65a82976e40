"""What a plan says of its choice of hosts: how good it is, what moves, and how far from the bound it may be."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

import pytest

from rarms_iac.model.host import Host, HypervHost, ProviderKind
from rarms_iac.model.layout import Infeasible, Layout, Placement
from rarms_iac.model.state import Partition, RunState, State
from rarms_iac.model.system import Component, CpuRequest, Disruption, Policy, RunsOn, System, Threshold
from rarms_iac.planner import problem as searched
from rarms_iac.planner.layout import Planning, gather_unmeasured, plan_layout
from rarms_iac.planner.packing.pack import pack
from rarms_iac.planner.packing.values import Bin, Item, NoPacking, Packing
from rarms_iac.planner.problem import problem_of, solve
from rarms_iac.planner.reservations import FixedReservations, MeasuredReservations
from rarms_iac.planner.verdicts import MeasuredTogether
from rarms_iac.statistics.curves import curve_of
from tests.builders import (
    PathPlaces,
    a_component,
    a_cpu,
    a_host,
    a_partition,
    a_run,
    a_simulation,
    a_system,
    at_least,
    at_most,
    codes,
    the_delivery_robot,
)
from tests.builders_measured import a_log, a_series, a_setting
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
    free = 'Of its 2 LP, 0.2 LP are kept for the host. Unmanaged machines reserve 0.8 LP: "stranger" 0.8 LP.'
    assert free in found.findings[0].detail
    asleep = replace(holder, settings=replace(holder.settings, running=False), state=RunState.OFF)
    assert layout(system, with_stranger(asleep)).partitions


def test_memory_counts_partitions_outside_the_conflict() -> None:
    needs = {"seams": "1 GiB", "motion": "512 MiB", "messages": "256 MiB"}
    components = [a_component(name, memory=memory) for name, memory in needs.items()]

    found = planned(a_system(hosts=[a_host(memory="1 GiB")], components=components)).findings

    assert found[0].detail == (
        "seams 1 GiB and motion 512 MiB need 1.5 GiB; onboard has 1 GiB for partitions. "
        "With messages, the total is 1.8 GiB."
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


def test_unmeasured_components_are_one_finding() -> None:
    system = a_system(components=[a_component(name, reserve="measured") for name in ("speech", "vision")])
    found = planned(system).findings

    (together,) = gather_unmeasured(found)

    assert together.detail == "speech and vision are not measured on onboard yet."
    assert together.values["components"] == ("speech", "vision")
    assert gather_unmeasured(found[:1]) == found[:1]


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


SHARES = {"a": 60, "b": 50, "c": 40, "d": 30, "e": 20}


def system_of(shares: dict[str, int], hosts: int = 3) -> System:
    return a_system(
        hosts=[a_host(f"host{at}") for at in range(hosts)],
        components=[a_component(name, reserve=f"{share} %", memory="64 MiB") for name, share in shares.items()],
    )


def placed(
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

    planning = placed(running)

    assert hosts_of(planning) == running
    placement = placement_of(planning)
    assert (placement.verdict, placement.reserved, placement.moves) == ("optimal", 400, 0)
    assert not planning.findings


def test_one_point_moves_only_what_must() -> None:
    """Two partitions fill a host; one grows by a point, so that one of them must leave, and no other."""
    running = {"a": "host0", "c": "host0", "b": "host1", "d": "host1", "e": "host2"}

    planning = placed(running, {**SHARES, "c": 41})

    assert sum(hosts_of(planning)[name] != host for name, host in running.items()) == 1
    placement = placement_of(planning)
    assert (placement.moves, placement.moves_bound) == (1, 1)


def test_host_order_moves_nothing() -> None:
    shares = {"a": 60, "b": 60}

    assert hosts_of(placed({"a": "host1", "b": "host0"}, shares, hosts=2)) == {"a": "host1", "b": "host0"}
    assert hosts_of(placed({}, shares, hosts=2)) == {"a": "host0", "b": "host1"}


def test_no_choice_says_nothing() -> None:
    planning = plan_layout(system_of({"a": 30}, hosts=1), FixedReservations(), {}, PLACES)

    assert isinstance(planning.answer, Layout)
    assert planning.answer.placement is None
    assert not planning.findings


def test_staying_partitions_are_counted() -> None:
    """Thirty-five that stay where they are, and the five that have a choice beside them."""
    fixed = {f"p{at:02}": f"host{at % 3}" for at in range(35)}

    planning = placed(fixed, {**dict.fromkeys(fixed, 2), **SHARES}, max_disruption=Disruption.LIVE)

    assert {name: host for name, host in hosts_of(planning).items() if name in fixed} == fixed
    placement = placement_of(planning)
    assert (placement.verdict, placement.reserved) == ("optimal", 2 * (70 + 200))


def test_unproved_layout_says_its_distance() -> None:
    placement = Placement(reserved=420, reserved_bound=400, moves=3, moves_bound=1)

    assert placement.verdict == "within the bound"
    assert not placement.proven
    assert replace(placement, reserved=400, moves=1).verdict == "optimal"


@pytest.mark.parametrize(
    ("provider", "alike"), [(ProviderKind.SIMULATED, True), (ProviderKind.LINUX, True), (ProviderKind.HYPERV, False)]
)
def test_unchecked_search_differs_only_with_bounds(provider: ProviderKind, alike: bool) -> None:
    components = [a_component(name, reserve="60 %", memory="64 MiB") for name in ("speech", "vision")]
    problem = problem_of(
        a_system(hosts=[a_host(provider=provider)], components=components), FixedReservations(), {}, may_move=True
    )

    unchecked = problem.without_checks()

    assert ((problem.items, problem.bins) == (unchecked.items, unchecked.bins)) is alike


@pytest.mark.parametrize("provider", list(ProviderKind))
def test_certain_misfit_is_searched_once(provider: ProviderKind, monkeypatch: pytest.MonkeyPatch) -> None:
    components = [a_component(name, reserve="80 %", memory="64 MiB") for name in ("speech", "vision")]
    problem = problem_of(
        a_system(hosts=[a_host(provider=provider)], components=components), FixedReservations(), {}, may_move=True
    )
    searches: list[object] = []

    def counted(items: Sequence[Item], bins: Sequence[Bin]) -> Packing | NoPacking:
        searches.append(bins)
        return pack(items, bins)

    monkeypatch.setattr(searched, "pack", counted)

    answer = solve(problem)

    assert isinstance(answer, Infeasible)
    assert answer.proven
    assert len(searches) == 1


JOBS = [10.0, 10.2, 9.8] * 400
OTHER = a_component("other", reserve="20 %")


def measured(*, work_ms: float = 4.0, load: str = "busy-loop") -> MeasuredTogether:
    """40 % of two processors is enough for each threshold; a job takes so much processor time, on one of them."""
    series = replace(a_series("vision", JOBS), elapsed_ms=10_000.0)
    return MeasuredTogether(
        path=f"measurements/onboard/vision/{load}.jsonl",
        interference=load,
        processors=2,
        measured=(40,),
        curves=lambda component, index: curve_of([a_setting(40, series)], component, index, a_run()),
        records=a_log(()),
        cpu_ms=lambda _component: work_ms,
        used=1,
    )


def vision(apt: Mapping[str, Threshold], **changes: object) -> Component:
    component = a_component("vision", reserve="measured", apt=apt, run=a_run())
    return replace(component, **changes)  # type: ignore[arg-type]  # by name, as the builders take them


def found(
    component: Component,
    *,
    others: Sequence[Component] = (OTHER,),
    loads: Sequence[str] = ("busy-loop",),
    work_ms: float = 4.0,
    host: Host | None = None,
) -> list[tuple[str, str]]:
    """Severity and detail of what is said of neighbours."""
    system: System = a_system(
        hosts=[host or a_host()], components=[component, *others], policy=Policy(interference=tuple(loads))
    )
    logs = tuple(measured(work_ms=work_ms, load=load) for load in loads)
    source = MeasuredReservations(kinds={"onboard": "onboard"}, logs={("onboard", ("vision",)): logs})
    planning = plan_layout(system, source, {}, PathPlaces())
    return [
        (finding.severity.value, finding.detail)
        for finding in planning.findings
        if finding.code in {"RARMS313", "RARMS324"}
    ]


TAIL = {"p95_response_time": at_most(60)}
MEAN = {"mean_response_time": at_most(60)}
PERIODIC = a_run(every="50 ms")


def test_steady_loads_alone_warn_of_a_tail() -> None:
    ((severity, detail),) = found(vision(TAIL))

    assert severity == "warning"
    assert "may answer 110 ms after their due time: 10 ms of work by its reservation, and a window of 100 ms" in detail
    assert detail.endswith("too late for p95_response_time.")


def test_bursts_note_neighbours_of_a_tail() -> None:
    ((severity, detail),) = found(vision(TAIL), loads=("busy-loop", "bursts-20"))

    assert severity == "note"
    assert detail == (
        "p95_response_time of vision depends on the 1 other partition on onboard. Their work within a window of "
        "100 ms changes the measured value."
    )


@pytest.mark.parametrize(
    ("component", "count"),
    [
        (vision({"p95_response_time": at_most(111)}), 0),  # 10 ms of work and a window
        (vision(MEAN), 0),  # the next job begins when the last one ended: the share it gets is the share it has
        (vision(MEAN, run=PERIODIC), 1),
        (vision({"mean_response_time": at_most(111)}, run=PERIODIC), 0),
        (vision({"maximum_response_time": at_most(60)}), 1),
        (vision({"deadline_miss_rate": at_most(5)}, run=a_run(every="50 ms", deadline="50 ms")), 1),
        (vision({"success_rate": at_least(90)}, simulation=a_simulation(within="60 ms")), 1),
        (vision({"success_rate": at_least(90)}), 0),  # nothing says by when
    ],
)
def test_too_little_for_window_is_told(component: Component, count: int) -> None:
    assert len(found(component)) == count


def test_who_is_alone_on_host_has_no_neighbours() -> None:
    assert found(vision(TAIL), others=()) == []


def test_long_job_sees_whole_windows() -> None:
    assert found(vision({"p95_response_time": at_most(260)}), work_ms=100.0) == []


def test_linux_keeps_no_long_claim() -> None:
    linux = replace(a_host(), provider=ProviderKind.LINUX)

    assert found(vision(TAIL), host=linux) == []
