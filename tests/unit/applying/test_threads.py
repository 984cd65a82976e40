from dataclasses import replace

import pytest

from rarms_iac.applying.desired_hosts import threads_of
from rarms_iac.applying.plan_request import PlanRequest
from rarms_iac.applying.review.host_effects import classes_above, review_task_classes
from rarms_iac.model.layout import Layout
from rarms_iac.model.plan import HostPlan, ThreadClass
from rarms_iac.model.state import RegistryValue, State, TaskClass, TaskRecord, ValueKind
from rarms_iac.planner.desired import Desired
from rarms_iac.planner.task_classes import classes_of
from rarms_iac.providers.simulated.content import SHIPPED
from tests import builders_plan as build
from tests.builders import a_component, a_system
from tests.planning import PLACES, a_request


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
    return request, Desired(observed=observed, state=observed), plan


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
    assert (finding.code, finding.address, "Vendor Sound (26)" in finding.detail) == ("RARMS129", "host/onboard", True)


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

    found = threads_of(Desired(observed=observed, state=observed, layout=layout, classes=decided), system)

    assert [
        (thread_class.inside, thread_class.task.lower(), thread_class.thread_priority, thread_class.components)
        for thread_class in found
    ] == [
        ("body", "motioncontrol", 23, ("leg", "arm")),
        ("body", "localization", 21, ("eye",)),
    ]
