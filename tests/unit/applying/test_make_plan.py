"""A partition that the manifest no longer names: removed where it holds nothing that could be lost, otherwise kept."""

import re
from collections.abc import Iterable
from dataclasses import replace

import pytest

from rarms_iac.applying import refusals
from rarms_iac.applying.desired_hosts import threads_of, totals_after
from rarms_iac.applying.make_plan import make_plan
from rarms_iac.applying.plan_request import PlanRequest
from rarms_iac.applying.preconditions import marks_of_other_robots
from rarms_iac.applying.review.host_effects import classes_above, review_task_classes
from rarms_iac.model.changes import Address, Delete, Reason, Update
from rarms_iac.model.host import Host, LinuxHost, ProviderKind
from rarms_iac.model.layout import Layout
from rarms_iac.model.plan import HostPlan, Purpose, ThreadClass, UndoLevel
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import (
    NO_GENERATION,
    Disk,
    DiskKind,
    RegistryValue,
    Responsiveness,
    StartAction,
    State,
    StopAction,
    TaskClass,
    TaskRecord,
    ValueKind,
)
from rarms_iac.model.system import Application, Disruption, PartitionRequest, Policy, StartMode, System, Unused
from rarms_iac.model.totals import Totals
from rarms_iac.planner.desired import Desired
from rarms_iac.planner.task_classes import classes_of
from rarms_iac.providers.interface import HostFailed, HostUnreachable
from rarms_iac.providers.simulated.content import SHIPPED
from rarms_iac.views.console import UNLIMITED, render
from rarms_iac.views.plan import plan_text
from tests import builders_plan as build
from tests.builders import a_component, a_host, a_partition, a_system, codes
from tests.builders_plan import facts, partition, settings
from tests.lab import a_lab, without_serials
from tests.planning import PLACES, a_request, route
from tests.pure_host import PureHost
from tests.strategies import empty_state

VISION = a_component("vision", criticality=9, reserve="40 %", memory="512 MiB")
SPEECH = a_component("speech", criticality=5, reserve="30 %", memory="512 MiB")


def both(*, host: Host | None = None, partitions: Iterable[PartitionRequest] = ()) -> System:
    return a_system(hosts=[host or a_host("onboard")], components=[VISION, SPEECH], partitions=partitions)


def vision_alone(policy: Policy | None = None, host: Host | None = None) -> System:
    return a_system(hosts=[host or a_host("onboard")], components=[VISION], policy=policy)


def test_simulated_removal_can_be_undone() -> None:
    with a_lab(both()) as lab:
        lab.apply(lab.plan())
        before = lab.observe()

        plan = lab.wanting(vision_alone()).plan()
        (change,) = plan.hosts[0].changes
        lab.apply(plan)
        after = lab.observe()
        lab.undo()

        assert isinstance(change, Delete)
        assert change.disruption is Disruption.PARTITION_STOP
        stop, removal = plan.hosts[0].steps
        assert (stop.undo.level, removal.undo.level) == (UndoLevel.PARTIAL, UndoLevel.FULL)
        assert [partition.settings.name for partition in after["onboard"].partitions] == ["vision"]
        assert without_serials(lab.observe()) == without_serials(before)


def test_its_reserve_is_in_no_sum() -> None:
    with a_lab(both()) as lab:
        lab.apply(lab.plan())
        totals = lab.wanting(vision_alone()).plan().hosts[0].totals

    assert totals is not None
    assert totals.reserved_lp == totals_alone()


def totals_alone() -> object:
    with a_lab(vision_alone()) as lab:
        totals = lab.plan().hosts[0].totals
    assert totals is not None
    return totals.reserved_lp


def test_its_mark_remembers_that_it_is_protected() -> None:
    with a_lab(both(partitions=[a_partition("speech", protect=True)])) as lab:
        lab.apply(lab.plan())
        assert lab.steps_left() == 0

        assert codes(lab.wanting(vision_alone()).prepare().findings) == ["RARMS152"]


def test_new_protection_changes_the_mark() -> None:
    with a_lab(both()) as lab:
        lab.apply(lab.plan())
        protecting = lab.wanting(both(partitions=[a_partition("speech", protect=True)]))

        (change,) = protecting.plan().hosts[0].changes
        protecting.apply(protecting.plan())

        assert change.reason.message == "its mark is protected, as in the manifest"
        assert protecting.steps_left() == 0


HYPERV = a_host("onboard", provider=ProviderKind.HYPERV)
"""A host on which a partition may hold what could be lost."""


def on_hyperv() -> State:
    """Both partitions, applied; speech has a disk, and is saved when its host stops."""
    host = PureHost(empty_state(HYPERV))
    host.walk(route(both(host=HYPERV), host.state).steps)
    speech = next(partition for partition in host.state.partitions if partition.settings.name == "speech")
    saved = replace(speech, settings=replace(speech.settings, stop_action=StopAction.SAVE))
    others = [partition for partition in host.state.partitions if partition is not speech]
    disk = Disk(path="D:\\speech.vhdx", kind=DiskKind.DYNAMIC, machine=speech.id)
    return replace(host.state, partitions=(*others, saved), disks=(disk,))


def test_hyperv_stops_and_lists_unnamed_partition() -> None:
    state = on_hyperv()
    found = route(vision_alone(host=HYPERV), state)
    (change,) = found.difference.changes
    assert isinstance(change, Update)
    assert change.reason.message == "it is no longer in the manifest"

    host = PureHost(state, made=50)
    host.walk(found.steps)
    stopped = next(partition for partition in host.state.partitions if partition.settings.name == "speech")
    assert not stopped.settings.running
    assert stopped.settings.start_action is StartAction.NOTHING

    planned = make_plan(a_request(vision_alone(host=HYPERV)), {"onboard": host.state}).plan
    assert planned is not None
    (part,) = planned.hosts
    assert part.changes == ()
    assert [(unused.name, unused.memory_on_disk, unused.disks) for unused in part.unused] == [
        ("speech", 512 * 2**20, ("D:\\speech.vhdx",))
    ]
    assert part.totals is not None
    assert part.totals.reserved_lp == totals_alone()


def test_policy_and_limit_together_remove_unnamed_partition() -> None:
    remove = vision_alone(Policy(unused=Unused.REMOVE), HYPERV)

    (kept,) = route(remove, on_hyperv(), Disruption.HOST_RESTART).difference.changes
    (removed,) = route(remove, on_hyperv(), Disruption.REMOVAL).difference.changes

    assert isinstance(kept, Update)
    assert isinstance(removed, Delete)
    assert removed.disruption is Disruption.REMOVAL


def other(name: str, category: str, priority: int | str, *, record: TaskRecord | None = None) -> TaskClass:
    kind = ValueKind.DWORD if isinstance(priority, int) else ValueKind.SZ
    values = {
        "Scheduling Category": RegistryValue(kind=ValueKind.SZ, data=category),
        "Priority": RegistryValue(kind=kind, data=priority),
    }
    return TaskClass(name=name, values=values, record=record)


ROBOTIC = (ThreadClass(inside="", task="MotionControl", category="Medium", thread_priority=20, components=("arm",)),)
OURS = TaskRecord(application="robot", set="0" * 12, before=None)


def reviewed(*tasks: TaskClass, plan: HostPlan) -> tuple[PlanRequest, Desired, HostPlan]:
    system = a_system()
    observed = State(facts=build.facts(), tasks=tasks)
    request = a_request(replace(system, application=replace(system.application, name="robot")))
    return request, Desired(seen=SeenHost(host=a_host(), application="robot", state=observed), state=observed), plan


def names(*tasks: TaskClass) -> list[tuple[str, int]]:
    part = reviewed(*tasks, plan=replace(build.host_plan(), threads=ROBOTIC))
    return [(task.name, priority) for _, task, priority in classes_above(*part)]


def test_higher_windows_classes_are_named() -> None:
    shipped = [TaskClass(name=name, values=values) for name, values in SHIPPED.items()]

    assert names(*shipped) == [
        ("Audio", 22),
        ("Capture", 21),
        ("DisplayPostProcessing", 26),
        ("Pro Audio", 26),
        ("Window Manager", 21),
    ]


@pytest.mark.parametrize(
    "task",
    [
        other("Equal", "Medium", 4),
        other("Low", "Low", 8),
        other("Nonsense", "Top", 8),
        other("Text", "Medium", "8"),
        other("Empty", "", 8),
        other("Ours", "High", 1, record=OURS),
        other("motioncontrol", "High", 1),
    ],
)
def test_lower_unknown_or_own_classes_are_not_named(task: TaskClass) -> None:
    assert names(task) == []


def test_vendor_class_is_told_once_a_host() -> None:
    plan = build.host_plan(changes=[build.create(build.task())])
    vendor = other("Vendor Sound", "high", 1)

    assert list(review_task_classes(*reviewed(vendor, plan=plan))) == []
    with_threads = reviewed(vendor, plan=replace(plan, threads=ROBOTIC))
    (finding,) = review_task_classes(*with_threads)
    assert (finding.code, finding.address, "Vendor Sound (priority 26)" in finding.detail) == (
        "RARMS129",
        "host/onboard",
        True,
    )


def test_classes_are_listed_with_who_names_them() -> None:
    arm = a_component("arm", task="MotionControl", criticality=5)
    leg = a_component("leg", task="motioncontrol", criticality=9)
    eye = a_component("eye", task="Localization", criticality=1)
    system = a_system(components=[arm, leg, eye])
    decided = {
        ("body", task_class.name): task_class for task_class in classes_of([arm, leg, eye], {}, "body", PLACES).classes
    }

    observed = State(facts=build.facts())
    layout = Layout(partitions=(build.placed_partition("body", components=("leg", "arm", "eye")),), on_hosts=())

    found = threads_of(
        Desired(
            seen=SeenHost(host=a_host(), application="robot", state=observed),
            state=observed,
            layout=layout,
            classes=decided,
        ),
        system,
    )

    assert [
        (thread_class.inside, thread_class.task.lower(), thread_class.thread_priority, thread_class.components)
        for thread_class in found
    ] == [
        ("body", "motioncontrol", 23, ("leg", "arm")),
        ("body", "localization", 21, ("eye",)),
    ]


SHARED = {"RARMS343"}


def found(provider: ProviderKind, ids: tuple[str, str], slices: tuple[str, str] = ("rarms", "rarms")) -> set[str]:
    hosts = [
        a_host(name, provider=provider, settings=LinuxHost(slice=part) if provider is ProviderKind.LINUX else None)
        for name, part in zip(("left", "right"), slices, strict=True)
    ]
    states = {
        name: State(facts=replace(facts(), name=name, id=identity, provider=provider))
        for name, identity in zip(("left", "right"), ids, strict=True)
    }
    return SHARED & set(codes(make_plan(a_request(a_system(hosts=hosts)), states).findings))


@pytest.mark.parametrize("provider", ProviderKind)
def test_equal_identities_are_named_as_clones(provider: ProviderKind) -> None:
    assert found(provider, ("a" * 32, "a" * 32)) == {"RARMS343"}
    assert found(provider, ("a" * 32, "b" * 32)) == set()
    assert found(provider, ("", "")) == set()


def test_slices_of_one_machine_are_no_clones() -> None:
    assert found(ProviderKind.LINUX, ("a" * 32, "a" * 32), ("left", "right")) == {"RARMS343"}
    assert found(ProviderKind.LINUX, ("a" * 32, "b" * 32), ("left", "right")) == set()


@pytest.mark.parametrize("purpose", [Purpose.APPLY, Purpose.DESTROY, Purpose.STOP])
def test_linux_plans_name_no_virtual_machines(purpose: Purpose) -> None:
    host = a_host("onboard", provider=ProviderKind.LINUX, settings=LinuxHost(slice="robot"))
    group = partition(settings(generation=NO_GENERATION), application=vision_alone().application.name)
    others = partition(settings("other", generation=NO_GENERATION, reserve=10), application=None)
    there = (others,) if purpose is Purpose.APPLY else (group, others)
    state = State(facts=replace(facts(), provider=ProviderKind.LINUX), partitions=there)

    plan = make_plan(a_request(vision_alone(host=host), purpose=purpose), {"onboard": state}).plan
    assert plan is not None
    shown = render(plan_text(plan, verbose=True), UNLIMITED)

    assert "partition/vision: " in shown
    assert "by unmanaged partitions" in shown
    assert (purpose is Purpose.APPLY) or "up to 2 min to end its processes" in shown
    assert not re.search("machine|shut down|turned off|guest", shown)


def _record(robot: str, application: str = "cell") -> TaskRecord:
    return TaskRecord(application=application, robot=robot, set="a" * 12, before=None)


@pytest.mark.parametrize(
    ("robot", "own", "refused"),
    [("robot-7", "robot-8", 2), ("robot-7", "", 2), ("", "robot-8", 0), ("robot-8", "robot-8", 0)],
)
def test_records_of_another_robot_are_refused(robot: str, own: str, refused: int) -> None:
    host = State(
        facts=facts(),
        tasks=(
            TaskClass(name="MotionControl", record=_record(robot)),
            TaskClass(name="Games", record=_record("robot-9", "kiosk")),
        ),
        responsiveness=Responsiveness(record=_record(robot)),
    )

    found = list(marks_of_other_robots([host], Application(name="cell", robot=own)))

    assert [finding.address for finding in found] == ["task/MotionControl", "mmcss/responsiveness"][:refused]
    assert all(finding.values["robot"] == robot and f'"{robot}"' in str(finding) for finding in found)


def test_unreachable_host_has_its_own_finding() -> None:
    finding = refusals.host_failed(HostUnreachable("onboard", "ssh does not reach robot@cell: no route", "Try ssh."))

    assert (finding.code, finding.address) == ("RARMS189", "host/onboard")
    assert finding.values == {
        "host": "onboard",
        "reason": "ssh does not reach robot@cell: no route",
        "unreachable": True,
    }


def test_a_host_that_fails_was_reached() -> None:
    finding = refusals.host_failed(HostFailed("onboard", "its disk is full", "Make room."))

    assert "unreachable" not in finding.values


def test_totals_keep_strangers_apart() -> None:
    observed = State(
        facts=facts(),
        partitions=(
            partition(settings("vision", reserve=40)),
            partition(settings("video", reserve=10)),
            partition(settings("speech", reserve=20), application="other"),
        ),
    )
    vision, video, _ = observed.partitions
    reason = Reason(message="the manifest wants less")
    lowered = Update(
        address=Address(partition="vision", machine=vision.id),
        before=vision,
        after=replace(vision, settings=settings("vision", reserve=30)),
        reason=reason,
        disruption=Disruption.LIVE,
    )
    removed = Delete(
        address=Address(partition="video", machine=video.id), before=video, reason=reason, disruption=Disruption.REMOVAL
    )

    after = totals_after(observed, "robot", (lowered, removed), {"vision"})

    assert after == Totals(percent=60, memory=2**29, others_percent=40, others_memory=2**29)


def test_a_machine_that_changes_sides_is_counted_once() -> None:
    with a_lab(a_system(hosts=[a_host("onboard")], components=[a_component("eyes", reserve="40 %")])) as lab:
        lab.apply(lab.plan())
        (eyes,) = lab.observe()["onboard"].partitions

        release = lab.plan(purpose=Purpose.RELEASE, partitions=("eyes",))
        lab.apply(release)
        taking_over = lab.plan(purpose=Purpose.IMPORT, partitions=("eyes",), machine=eyes.id)

    memory = eyes.settings.memory
    assert release.hosts[0].totals == Totals(percent=0, memory=0, others_percent=80, others_memory=memory)
    assert taking_over.hosts[0].totals == Totals(percent=80, memory=memory)


def test_manual_partition_is_promised_as_planned() -> None:
    by_hand = a_partition("eyes", components=["eyes"], start=StartMode.MANUAL)
    with a_lab(
        a_system(hosts=[a_host("onboard")], components=[a_component("eyes", reserve="40 %")], partitions=[by_hand])
    ) as lab:
        first = lab.plan()
        lab.apply(first)
        again = lab.plan()
        (eyes,) = lab.observe()["onboard"].partitions

    memory = eyes.settings.memory
    assert not eyes.settings.running
    assert first.hosts[0].totals == Totals(percent=80, memory=memory, idle_percent=80, idle_memory=memory)
    assert again.hosts[0].totals == first.hosts[0].totals
    assert "Of these, 0.8 LP and 512 MiB" in render(plan_text(first), UNLIMITED)
