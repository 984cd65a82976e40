from rarms_iac.model.system import RunsOn
from tests.builders import a_component, a_host, a_system, a_task
from tests.unit.manifest.checks.violations import details, found


def test_shipped_class_is_left_unless_replaced() -> None:
    component = a_component(task="pro audio")

    assert found(a_system(components=[component])) == [("RARMS053", "components.vision.task")]
    assert found(a_system(components=[component], tasks=[a_task("Pro Audio")])) == [("RARMS053", "tasks.Pro Audio")]
    assert found(a_system(components=[component], tasks=[a_task("Pro Audio", replace_shipped=True)])) == []


def test_a_class_is_robotic_or_defined() -> None:
    assert found(a_system(components=[a_component(task="ObjectIdentificaton")])) == [
        ("RARMS042", "components.vision.task")
    ]
    assert 'Did you mean "ObjectIdentification"?' in details(
        a_system(components=[a_component(task="ObjectIdentificaton")])
    )
    assert found(a_system(components=[a_component(task="motioncontrol")])) == []
    assert found(a_system(components=[a_component(task="Grasping")], tasks=[a_task("Grasping")])) == []


def test_a_class_that_is_shared_loses_the_order() -> None:
    components = [
        a_component("vision", criticality=30, task="Localization"),
        a_component("map", criticality=10, task="localization"),
    ]
    together = [components[0], a_component("map", criticality=10, task="localization", together=["vision"])]

    assert found(a_system(components=components)) == []
    assert found(a_system(components=together)) == [("RARMS128", "components.map.task")]


def test_components_on_only_host_share_its_operating_system() -> None:
    on_host = [
        a_component(name, criticality=n, task="Localization", runs_on=RunsOn.HOST, memory="64 MiB")
        for n, name in ((30, "a"), (10, "b"))
    ]
    host = a_host(keep_processor="10 %", keep_memory="1 GiB")

    assert found(a_system(hosts=[host], components=on_host)) == [("RARMS128", "components.b.task")]
