"""What a reviewer of a plan is told: state and plan in, findings out."""

from collections.abc import Iterable
from dataclasses import replace
from fractions import Fraction
from typing import Any

import pytest

from rarms_iac.applying.review import review_plan
from rarms_iac.applying.review.host_effects import busy_share
from rarms_iac.model.changes import Adopt, Change, Release
from rarms_iac.model.diagnostics import Diagnostic, Severity
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.layout import Layout
from rarms_iac.model.operations import CreatePartition, StartPartition, StopPartition
from rarms_iac.model.plan import Purpose, Step, UndoLevel
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import Disk, HostFacts, Partition, PartitionSettings, State
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner.desired import Desired
from tests import builders_plan as build
from tests.builders import a_component, a_cpu, a_host, a_partition, a_system
from tests.builders_plan import facts, partition, settings
from tests.planning import a_request

STRANGER = partition(settings("stranger", processors=2, reserve=10), application=None)


def findings(
    *changes: Change,
    machines: Iterable[Partition] = (),
    steps: Iterable[Step] | None = None,
    of: HostFacts | None = None,
    purpose: Purpose = Purpose.APPLY,
    layout: Layout | None = None,
    system: System | None = None,
    disks: tuple[Disk, ...] = (),
    switches: tuple[str, ...] | None = None,
    largest_node: int | None = None,
    left: tuple[int | None, int | None] = (None, None),
) -> list[Diagnostic]:
    plan = build.host_plan(changes=changes, steps=steps)
    named = system or a_system(components=[a_component()])
    request = a_request(replace(named, application=replace(named.application, name="robot")))
    observed = State(
        facts=of or facts(),
        partitions=tuple(machines),
        disks=disks,
        switches=switches,
        largest_node=largest_node,
        memory_left=left[0],
        node_left=left[1],
    )
    seen = SeenHost(host=a_host(), application="robot", state=observed)
    desired = Desired(seen=seen, state=observed, layout=layout)
    return list(review_plan(replace(request, purpose=purpose), desired, plan))


def told(found: list[Diagnostic]) -> list[tuple[str, str]]:
    return [(diagnostic.code, diagnostic.address) for diagnostic in found]


def test_a_plan_without_changes_has_no_findings() -> None:
    assert findings(machines=[partition(), STRANGER]) == []


@pytest.mark.parametrize(
    ("limit", "expected"),
    [("30 %", [("RARMS221", "partition/both")]), ("40 %", []), (None, [])],
)
def test_limit_below_members_is_raised_and_told(limit: str | None, expected: list[tuple[str, str]]) -> None:
    both = replace(a_partition("both", components=("vision", "speech")), cpu=a_cpu(reserve=None, limit=limit))
    parts = [a_component("vision", reserve="20 %"), a_component("speech", reserve="20 %")]
    system = a_system(components=parts, partitions=[both])
    raised = 100 if limit is None else 40  # as the planner lays it out: never below the reserve
    raised_partition = build.placed_partition("both", components=("vision", "speech"))
    raised_partition = replace(raised_partition, settings=replace(raised_partition.settings, limit=raised))
    layout = Layout(partitions=(raised_partition,), on_hosts=())

    assert told(findings(system=system, layout=layout)) == expected


@pytest.mark.parametrize(
    ("making", "expected"),
    [
        ({"generation": 2, "image": "D:\\robot.VHD"}, ["RARMS256"]),
        ({"generation": 1, "image": "D:\\robot.vhd"}, []),
        ({"generation": 2, "image": "D:\\robot.vhdx"}, []),
        ({"generation": 2, "switch": "LAB"}, []),
        ({"generation": 2, "switch": "lad"}, ["RARMS042"]),
    ],
)
@pytest.mark.parametrize("known", [True, False])
def test_impossible_machine_is_an_error(making: dict[str, Any], expected: list[str], known: bool) -> None:
    step = build.step(operation=CreatePartition(partition="vision", memory=2**29, **making))

    found = findings(steps=[step], switches=("lab",) if known else None)

    assert [diagnostic.code for diagnostic in found] == (expected if known or expected != ["RARMS042"] else [])


GROWN = replace(build.settings("vision"), memory=5 * 2**30)


@pytest.mark.parametrize(
    ("before", "node", "expected"),
    [
        (None, 5 * 2**30 - 1, ["RARMS403"]),
        (None, 5 * 2**30, []),
        (None, None, []),
        (partition(settings("vision")), 5 * 2**30 - 1, ["RARMS403"]),
        (partition(GROWN), 5 * 2**30 - 1, []),
    ],
    ids=["made", "it fits", "spanning", "grows", "was as large before"],
)
def test_partition_that_gets_larger_than_node_is_error(
    before: Partition | None, node: int | None, expected: list[str]
) -> None:
    after = partition(replace(GROWN, limit=90))
    change = build.update(before, after) if before else build.create(after)

    found = findings(change, machines=[before] if before else [], largest_node=node)

    errors = [finding for finding in found if finding.severity is Severity.ERROR]
    assert [finding.code for finding in errors] == expected
    assert all("5 GiB" in finding.detail for finding in errors)


RUNS = replace(GROWN, running=True)


@pytest.mark.parametrize(
    ("before", "left", "node", "expected"),
    [
        (None, 2 * 2**30, None, ["RARMS403"]),
        (None, 5 * 2**30, None, []),
        (replace(RUNS, memory=4 * 2**30), 2**30, None, []),
        (replace(RUNS, memory=4 * 2**30), 2**30 - 1, None, ["RARMS403"]),
        (None, 9 * 2**30, 3 * 2**30, ["RARMS403"]),
        (None, 9 * 2**30, 5 * 2**30, []),
    ],
    ids=["too little", "as much", "grows", "grows by more", "no node", "a node"],
)
def test_a_partition_starts_only_with_what_is_left(
    before: PartitionSettings | None, left: int, node: int | None, expected: list[str]
) -> None:
    after = partition(RUNS)
    change = build.update(partition(before), after) if before else build.create(after)

    found = findings(
        change,
        machines=[partition(before)] if before else [],
        largest_node=node and 6 * 2**30,
        left=(left, node),
    )

    errors = [finding for finding in found if finding.severity is Severity.ERROR]
    assert [finding.code for finding in errors] == expected


def test_planned_starts_and_leftovers_are_printed() -> None:
    (finding,) = findings(build.create(partition(RUNS)), left=(2 * 2**30, None))

    assert finding.detail == (
        "The plan starts machines with 5 GiB on onboard: vision 5 GiB. onboard reports 2 GiB free for machines."
    )


def test_cpu_group_of_kept_partition_is_told() -> None:
    grouped = replace(partition(), cpu_group="36ab08cb")

    assert told(findings(machines=[grouped])) == [("RARMS235", "partition/vision")]


class TestUnmanaged:
    def test_new_partition_takes_unreserved_share(self) -> None:
        (finding,) = findings(build.create(partition(settings(reserve=60))), machines=[STRANGER])

        assert (finding.code, finding.address) == ("RARMS223", "host/onboard")
        assert "about 2 LP -> 0.5 LP, 0.2 LP reserved" in finding.detail

    def test_several_losing_machines_are_one_finding(self) -> None:
        other = partition(settings("other", processors=2, reserve=10), application=None)

        (finding,) = findings(build.create(partition(settings(reserve=60))), machines=[STRANGER, other])

        assert finding.detail.index('"stranger"') < finding.detail.index('"other"')

    def test_a_larger_weight_takes_too(self) -> None:
        old, new = partition(settings(weight=100)), partition(settings(weight=300))

        assert told(findings(build.update(old, new), machines=[old, STRANGER])) == [("RARMS223", "host/onboard")]

    @pytest.mark.parametrize(
        "change",
        [
            build.update(partition(settings(reserve=50)), partition(settings(reserve=40))),
            build.delete(partition()),
            build.create(partition(settings(running=False))),
        ],
    )
    def test_change_that_gives_back_takes_no_share(self, change: Change) -> None:
        there = [] if change.kind == "create" else [partition(settings(reserve=50))]

        assert findings(change, machines=[STRANGER, *there], steps=[build.step(change.address)]) == []

    def test_machine_that_is_off_loses_no_share(self) -> None:
        off = partition(settings("stranger", running=False), application=None)

        assert findings(build.create(partition()), machines=[off]) == []

    def test_taking_in_and_letting_go_change_no_share(self) -> None:
        ours, other = partition(), partition(application=None)
        because = build.because()
        adopt = Adopt(address=build.address_of(other), before=other, after=ours, reason=because)
        release = Release(address=build.address_of(ours), before=ours, after=other, reason=because)

        assert findings(adopt, machines=[other, STRANGER], purpose=Purpose.IMPORT) == []
        assert findings(release, machines=[ours, STRANGER], purpose=Purpose.RELEASE) == []

    def test_share_is_reserve_plus_weighted_rest(self) -> None:
        first, second = settings("a", reserve=50, weight=100), settings("b", reserve=0, weight=300)

        assert busy_share(first, [first, second], 2) == 1 + Fraction(1, 4)
        assert busy_share(second, [first, second], 2) == Fraction(3, 4)

    def test_a_share_is_never_above_the_limit(self) -> None:
        alone = settings("a", reserve=10, limit=30)

        assert busy_share(alone, [alone], 2) == Fraction(6, 10)


@pytest.mark.parametrize(
    ("purpose", "level", "expected"),
    [
        (Purpose.APPLY, UndoLevel.NONE, [("RARMS225", "partition/vision")]),
        (Purpose.APPLY, UndoLevel.PARTIAL, []),
        (Purpose.DESTROY, UndoLevel.NONE, []),
    ],
)
def test_step_without_undo_is_told_unless_destroying(
    purpose: Purpose, level: UndoLevel, expected: list[tuple[str, str]]
) -> None:
    step = build.step(undo=level, lost="it is not made again")

    assert told(findings(machines=[partition()], steps=[step], purpose=purpose)) == expected


def test_a_partition_wider_than_its_host_is_told() -> None:
    wide = partition(settings(processors=3, reserve=0))

    assert told(findings(build.create(wide))) == [("RARMS245", "partition/vision")]


class TestStops:
    RUNNING = partition(settings(reserve=40))
    LIVE = build.update(RUNNING, partition(settings(reserve=60)))
    STOP = build.step(
        operation=StopPartition(partition="vision", grace_ms=120_000),
        comment="no order of the steps keeps within the host",
    )
    START = build.step(operation=StartPartition(partition="vision"))

    def test_partition_stopped_to_make_room_is_told(self) -> None:
        (finding,) = findings(self.LIVE, machines=[self.RUNNING], steps=[self.STOP, self.START])

        assert (finding.code, finding.address) == ("RARMS041", "partition/vision")
        assert "no order of the steps" in finding.detail

    def test_partition_stopped_by_own_change_is_told_once(self) -> None:
        stopping = replace(self.LIVE, disruption=Disruption.PARTITION_STOP)

        found = findings(stopping, machines=[self.RUNNING], steps=[self.STOP, self.START])

        assert told(found) == [("RARMS041", "partition/vision")]


def promised(reserves: Iterable[int]) -> list[tuple[str, str]]:
    """What is told of single processors that are to be reserved on eight, if those are Hyper-V's."""
    changes = [
        build.create(partition(settings(f"p{number:02}", processors=1, reserve=reserve, ram="1 MiB")))
        for number, reserve in enumerate(reserves)
    ]
    plan = build.host_plan(changes=changes, steps=())
    observed = State(facts=facts(logical_processors=8), partitions=())
    host = replace(plan.host, provider=ProviderKind.HYPERV, logical_processors=8)
    found = review_plan(
        a_request(a_system(components=[a_component()])),
        Desired(seen=SeenHost(host=host, application="robot", state=observed), state=observed),
        replace(plan, host=host),
    )
    return [finding for finding in told(list(found)) if finding[0] == "RARMS154"]


def test_unplaceable_promises_are_refused() -> None:
    fits_only_by_search = [50, 40, 30, 30, 30, 20] * 4

    assert sum(fits_only_by_search) == 800
    assert promised(fits_only_by_search) == [("RARMS154", "host/onboard")]
    assert promised([50, 40, 30, 30, 30, 10] * 4) == []
