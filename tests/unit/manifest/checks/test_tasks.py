import pytest

from rarms_iac.model.system import RunsOn, System, TaskCategory, TaskRequest
from tests.builders import a_component, a_host, a_partition, a_system, a_task
from tests.unit.manifest.checks.violations import details, found


def test_a_class_of_windows_is_left_alone_unless_it_is_to_be_replaced() -> None:
    component = a_component(task="pro audio")

    assert found(a_system(components=[component])) == [("RARMS053", "components.vision.task")]
    assert found(a_system(components=[component], tasks=[a_task("Pro Audio")])) == [("RARMS053", "tasks.Pro Audio")]
    assert found(a_system(components=[component], tasks=[a_task("Pro Audio", replace_shipped=True)])) == []


def test_a_class_is_robotic_or_defined() -> None:
    assert found(a_system(components=[a_component(task="ObjectIdentificaton")])) == [
        ("RARMS054", "components.vision.task")
    ]
    assert 'Did you mean "ObjectIdentification"?' in details(
        a_system(components=[a_component(task="ObjectIdentificaton")])
    )
    assert found(a_system(components=[a_component(task="motioncontrol")])) == []
    assert found(a_system(components=[a_component(task="Grasping")], tasks=[a_task("Grasping")])) == []


def two_tasks(vision: TaskRequest, speech: TaskRequest) -> System:
    """`vision`, the more critical, and `speech` in one partition, each with a class of its own."""
    return a_system(
        components=[
            a_component("vision", criticality=30, task=vision.name),
            a_component("speech", criticality=20, task=speech.name),
        ],
        partitions=[a_partition("vision", components=["vision", "speech"])],
        tasks=[vision, speech],
    )


@pytest.mark.parametrize(
    ("vision", "speech", "finds"),
    [
        ((TaskCategory.HIGH, 8, None), (TaskCategory.HIGH, 1, None), True),
        ((TaskCategory.MEDIUM, 8, None), (TaskCategory.MEDIUM, 1, None), False),
        ((TaskCategory.MEDIUM, 1, None), (TaskCategory.MEDIUM, 8, None), True),
        ((TaskCategory.MEDIUM, None, None), (TaskCategory.HIGH, None, None), True),
        ((TaskCategory.MEDIUM, None, None), (TaskCategory.MEDIUM, 8, None), True),
        ((TaskCategory.MEDIUM, None, None), (TaskCategory.MEDIUM, 7, None), True),  # 8 was seen to be no more than 7
        ((TaskCategory.MEDIUM, None, None), (TaskCategory.MEDIUM, 6, None), False),
        ((None, None, None), (TaskCategory.MEDIUM, 8, None), False),
        ((TaskCategory.LOW, None, 8), (TaskCategory.LOW, None, 1), False),
        ((TaskCategory.LOW, None, 1), (TaskCategory.LOW, None, 8), True),
        ((None, 1, None), (TaskCategory.MEDIUM, None, None), False),
    ],
)
def test_fixed_priorities_must_be_able_to_keep_the_order(
    vision: tuple[TaskCategory | None, int | None, int | None],
    speech: tuple[TaskCategory | None, int | None, int | None],
    finds: bool,
) -> None:
    def task(name: str, fixed: tuple[TaskCategory | None, int | None, int | None]) -> TaskRequest:
        return a_task(name, category=fixed[0], priority=fixed[1], background_priority=fixed[2])

    system = two_tasks(task("Seeing", vision), task("Hearing", speech))

    assert found(system) == ([("RARMS056", "tasks.Seeing")] if finds else [])


def test_an_order_is_promised_within_one_operating_system_only() -> None:
    system = two_tasks(a_task("Seeing", category=TaskCategory.HIGH), a_task("Hearing", category=TaskCategory.HIGH))
    without_partitions = a_system(components=system.components.values(), tasks=system.tasks.values())

    assert found(without_partitions) == []


def test_a_class_that_is_shared_loses_the_order() -> None:
    components = [
        a_component("vision", criticality=30, task="Localization"),
        a_component("map", criticality=10, task="localization"),
    ]
    together = [components[0], a_component("map", criticality=10, task="localization", together=["vision"])]

    assert found(a_system(components=components)) == []
    assert found(a_system(components=together)) == [("RARMS057", "components.map.task")]


def test_components_on_the_only_host_share_its_operating_system() -> None:
    on_host = [
        a_component(name, criticality=n, task="Localization", runs_on=RunsOn.HOST, memory="64 MiB")
        for n, name in ((30, "a"), (10, "b"))
    ]
    host = a_host(keep_processor="10 %", keep_memory="1 GiB")

    assert found(a_system(hosts=[host], components=on_host)) == [("RARMS057", "components.b.task")]
