"""The planner obeys the checks that come after it: a plan is refused only where every layout would be."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import date
from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rarms_iac.applying.desired_hosts import partitions_after
from rarms_iac.applying.make_plan import PlanningResult, make_plan
from rarms_iac.manifest.acceptance import with_acceptances_in_force
from rarms_iac.model.changes import Create, Delete
from rarms_iac.model.diagnostics import Severity
from rarms_iac.model.host import HypervHost, LinuxHost, Mechanism, ProviderKind, SchedulerType
from rarms_iac.model.loads import BUSY_LOOP
from rarms_iac.model.plan import Plan
from rarms_iac.model.state import HostFacts, Partition, State
from rarms_iac.model.system import Acceptance, Disruption, Policy, System
from tests import builders_plan as build
from tests.builders import a_component, a_host, a_system
from tests.effort import examples
from tests.planning import a_request
from tests.strategies import facts_for

NAMES = ("a", "b", "c")


@dataclass(frozen=True)
class Situation:
    """Two hosts and three components."""

    system: System
    states: Mapping[str, State]


@st.composite
def situations(draw: st.DrawFn) -> Situation:
    kind = draw(st.sampled_from((ProviderKind.HYPERV, ProviderKind.LINUX)))
    hosts, states = [], {}
    for name in ("left", "right"):
        if kind is ProviderKind.LINUX:
            mechanism = draw(st.sampled_from((Mechanism.SHARE, Mechanism.DEADLINE)))
            host = a_host(name, provider=kind, logical_processors=2, settings=LinuxHost(mechanism=mechanism))
        else:
            image = draw(st.sampled_from(("", "base.vhd", "base.vhdx")))
            switch = draw(st.sampled_from(("", "cell")))
            windows = HypervHost(image=image, switch=switch)
            host = a_host(name, provider=kind, logical_processors=2, settings=windows)
        hosts.append(host)
        states[name] = State(
            facts=_facts(draw, facts_for(host, provider=kind)),
            partitions=tuple(_foreign(number) for number in NAMES if draw(st.integers(0, 5)) == 0),
            tasks=(),
            switches=draw(st.sampled_from((("cell",), ()))) if kind is ProviderKind.HYPERV else None,
            largest_node=draw(st.sampled_from((None, 2**25))) if kind is ProviderKind.HYPERV else None,
        )
    components = [
        a_component(
            name,
            reserve=f"{draw(st.integers(5, 60))} %",
            processors=draw(st.integers(1, 2)),
            memory="64 MiB",
            hosts=("left", "right"),
            task="MotionControl" if kind is ProviderKind.LINUX and draw(st.booleans()) else None,
        )
        for name in NAMES[: draw(st.integers(1, 3))]
    ]
    return Situation(a_system(hosts=hosts, components=components), states)


def _facts(draw: st.DrawFn, facts: HostFacts) -> HostFacts:
    if facts.provider is ProviderKind.LINUX:
        return replace(facts, deadline_percent=draw(st.sampled_from((None, 0, 50))), scheduler=SchedulerType.NONE)
    scheduler = draw(st.sampled_from((SchedulerType.CORE, SchedulerType.ROOT)))
    return replace(facts, scheduler=scheduler, disk_folder="C:\\disks")


def _foreign(name: str) -> Partition:
    return replace(
        build.partition(build.settings(name, processors=1, reserve=0, ram="64 MiB"), application=None), id=f"id-{name}"
    )


def planned(
    system: System, states: Mapping[str, State], limit: Disruption = Disruption.PARTITION_STOP
) -> PlanningResult:
    return make_plan(a_request(system, limit), states)


def is_refused_by_all_layouts(situation: Situation) -> bool:
    components = situation.system.components
    return all(
        planned(
            replace(
                situation.system,
                components={
                    name: replace(components[name], hosts=(host,)) for name, host in zip(components, hosts, strict=True)
                },
            ),
            situation.states,
        ).plan
        is None
        for hosts in product(("left", "right"), repeat=len(components))
    )


@pytest.mark.needs("highspy")  # without the solver a layout is looked for in so many steps, and may not be found
@settings(deadline=None, max_examples=examples(40))
@given(situations())
def test_plan_is_refused_only_if_no_layout_works(situation: Situation) -> None:
    result = planned(situation.system, situation.states)

    if result.plan is None:
        assert any(finding.severity is Severity.ERROR for finding in result.findings)
        assert is_refused_by_all_layouts(situation), [finding.detail for finding in result.findings]


@settings(deadline=None, max_examples=examples(30))
@given(situations())
def test_applied_and_emptied_hosts_can_be_planned(situation: Situation) -> None:
    first = planned(situation.system, situation.states)
    if first.plan is None:
        return

    after = applied(situation, first.plan)
    again = planned(situation.system, after)

    assert again.plan is not None, [finding.detail for finding in again.findings]
    placed = {host.host.name: {change.address.partition for change in host.changes} for host in first.plan.hosts}
    for host in again.plan.hosts:
        assert not {change.address.partition for change in host.changes} & placed[host.host.name]
    assert planned(situation.system, situation.states).plan == first.plan


def applied(situation: Situation, plan: Plan) -> Mapping[str, State]:
    application = situation.system.application.name
    states = {}
    for host in plan.hosts:
        before = situation.states[host.host.name]
        foreign = tuple(each for each in before.partitions if each not in before.of(application).partitions)
        own = tuple(_made(each) for each in partitions_after(before, application, host.changes))
        states[host.host.name] = replace(before, partitions=(*foreign, *own))
    return states


def _made(partition: Partition) -> Partition:
    """The partition with the machine that the host made for it."""
    assert partition.mark is not None
    machine = f"id-of-{partition.settings.name}"
    return replace(partition, id=machine, mark=replace(partition.mark, machine=machine[:36]))


def test_refusal_names_partition_that_would_have_to_move() -> None:
    """Two small partitions stand on both hosts, so that the large one that is new has room on neither."""
    hosts = [a_host(name) for name in ("left", "right")]
    small = [a_component(name, reserve="30 %", processors=2, memory="64 MiB") for name in ("a", "b")]
    large = a_component("c", reserve="80 %", processors=2, memory="64 MiB")
    states = {host.name: State(facts=facts_for(host), partitions=(), tasks=()) for host in hosts}
    for name, host in (("a", "left"), ("b", "right")):
        there = [replace(each, hosts=(host,)) for each in small if each.name == name]
        only = Situation(a_system(hosts=hosts, components=there), states)
        plan = planned(only.system, only.states).plan
        assert plan is not None
        made = applied(only, plan)[host]
        states[host] = replace(made, partitions=tuple(replace(each, id=f"id-of-{name}") for each in made.partitions))
    system = a_system(hosts=hosts, components=[*small, large])

    refused = planned(system, states)
    moved = make_plan(a_request(system, Disruption.REMOVAL), states)

    assert refused.plan is None
    (finding,) = [finding for finding in refused.findings if finding.severity is Severity.ERROR]
    assert finding.values["would_move"] in {("a",), ("b",)}
    assert "The partitions fit if they may move" in finding.detail
    assert "--max-disruption removal" in str(finding.advice)
    assert moved.plan is not None


@pytest.mark.parametrize(("limit", "hosts"), [(Disruption.PARTITION_STOP, ()), (Disruption.REMOVAL, ("right",))])
def test_what_stays_is_not_made_elsewhere(limit: Disruption, hosts: tuple[str, ...]) -> None:
    both = [a_host(name) for name in ("left", "right")]
    states = {host.name: State(facts=facts_for(host), partitions=(), tasks=()) for host in both}
    component = a_component("a", reserve="30 %", memory="64 MiB", hosts=("left",))
    there = Situation(a_system(hosts=both, components=[component]), states)
    plan = planned(there.system, there.states).plan
    assert plan is not None
    moved = Situation(a_system(hosts=both, components=[replace(component, hosts=("right",))]), applied(there, plan))

    held = make_plan(replace(a_request(moved.system, limit), hosts=hosts), moved.states).plan
    allowed = planned(moved.system, moved.states, Disruption.REMOVAL).plan

    assert held is not None
    assert [change for host in held.hosts for change in host.changes] == []
    (made,) = [entry for host in held.hosts for entry in host.held_back if isinstance(entry.change, Create)]
    assert made.why == "it is on left, and this plan does not remove it there"
    assert allowed is not None
    assert [type(change) for host in allowed.hosts for change in host.changes] == [Delete, Create]


@pytest.mark.parametrize(("hosts", "why"), [(None, "it may be on right, which was not read"), (("left",), "")])
def test_unseen_host_may_have_the_partition(hosts: tuple[str, ...] | None, why: str) -> None:
    both = [a_host(name) for name in ("left", "right")]
    system = a_system(hosts=both, components=[a_component("a", reserve="30 %", memory="64 MiB", hosts=hosts)])
    seen = {"left": State(facts=facts_for(both[0]), partitions=(), tasks=())}

    plan = make_plan(a_request(system, hosts=("left",)), seen).plan

    assert plan is not None
    (left,) = plan.hosts
    assert [entry.why for entry in left.held_back] == ([why] if why else [])
    assert [type(change) for change in left.changes] == ([] if why else [Create])


@pytest.mark.parametrize(("until", "goes_to"), [(date(2026, 1, 1), "left"), (date(2025, 12, 31), "right")])
def test_the_search_counts_no_acceptance_that_has_expired(until: date, goes_to: str) -> None:
    """Both hosts suit the partition; the first by name has a scheduler that ignores reserves."""
    hosts = [a_host(name, provider=ProviderKind.HYPERV, settings=HypervHost()) for name in ("left", "right")]
    schedulers = {"left": SchedulerType.ROOT, "right": SchedulerType.CORE}
    states = {
        host.name: State(
            facts=facts_for(host, provider=ProviderKind.HYPERV, scheduler=schedulers[host.name]),
            partitions=(),
            tasks=(),
        )
        for host in hosts
    }
    acceptance = Acceptance(code="RARMS159", at=("host/left",), reason="a test bench", until=until)
    policy = Policy(interference=(BUSY_LOOP,), accept={"RARMS159": acceptance})
    system = a_system(hosts=hosts, components=[a_component("a", reserve="30 %", memory="64 MiB")], policy=policy)

    plan = planned(with_acceptances_in_force(system, date(2026, 1, 1)), states).plan

    assert plan is not None
    assert [host.host.name for host in plan.hosts if host.changes] == [goes_to]
