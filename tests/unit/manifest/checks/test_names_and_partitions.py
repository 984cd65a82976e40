from dataclasses import replace
from datetime import date

import pytest

from rarms_iac.manifest.checks import run_checks
from rarms_iac.model.system import HypervHost, HypervPartition, Policy, ProviderKind, RunsOn, System
from tests.builders import (
    PathPlaces,
    a_component,
    a_host,
    a_partition,
    a_system,
    a_task,
    at_most,
    codes,
    the_delivery_robot,
)

VISION = a_component("vision", criticality=30)
SPEECH = a_component("speech", criticality=20)
VIDEO = a_component("video", criticality=10)
ON_HOST = a_component("watchdog", runs_on=RunsOn.HOST)
ROOMY = a_host(keep_processor="10 %", keep_memory="1 GiB")


def found(system: System) -> list[tuple[str, str]]:
    """Code and path of everything the checks tell."""
    told = run_checks(system, PathPlaces(), date(2026, 1, 1))
    return [(diagnostic.code, diagnostic.place.path if diagnostic.place else "") for diagnostic in told]


def details(system: System) -> str:
    return "\n".join(check.detail for check in run_checks(system, PathPlaces(), date(2026, 1, 1)))


@pytest.mark.parametrize(
    ("system", "path"),
    [
        (a_system(components=[a_component("vision", together=["visoin"])]), "components.vision.together.0"),
        (a_system(components=[VISION, a_component("speech", apart=["vision", "x"])]), "components.speech.apart.1"),
        (a_system(components=[a_component("vision", hosts=["onboard", "x"])]), "components.vision.hosts.1"),
        (a_system(components=[a_component("vision", interference="x")]), "components.vision.interference"),
        (a_system(partitions=[a_partition("p", components=["vision", "x"])]), "partitions.p.components.1"),
        (a_system(partitions=[a_partition("x")]), "partitions.x.components.0"),
        (a_system(policy=Policy(interference="x")), "policy.interference"),
        (a_system(moved={"eyes": "x"}), "moved.eyes"),
        (a_system(moved={"eyes": "watchdog"}, components=[VISION, ON_HOST], hosts=[ROOMY]), "moved.eyes"),
    ],
)
def test_a_name_that_nothing_has(system: System, path: str) -> None:
    assert ("RARMS042", path) in found(system)


def test_the_name_that_was_meant_is_said() -> None:
    assert 'Did you mean "vision"?' in details(a_system(components=[a_component("vision", apart=["visoin"])]))


def test_names_that_are_there_are_no_finding() -> None:
    system = a_system(
        components=[a_component("vision", hosts=["onboard"], apart=["speech"], interference="busy-loop"), SPEECH],
        partitions=[a_partition("both", components=["vision"])],
        moved={"eyes": "both", "ears": "speech"},
    )

    assert found(system) == []
    assert codes(run_checks(the_delivery_robot(), PathPlaces(), date(2026, 1, 1))) == ["RARMS086"]


@pytest.mark.parametrize(
    ("system", "expected"),
    [
        (a_system(application="nul"), [("RARMS043", "application.name")]),
        (a_system(components=[a_component("con")]), [("RARMS043", "components.con")]),
        (a_system(hosts=[a_host("com1")]), [("RARMS043", "hosts.com1")]),
        (a_system(components=[a_component("com10"), a_component("console")]), []),
        (a_system(hosts=[a_host("vision")]), [("RARMS044", "components.vision")]),
        (
            a_system(hosts=[a_host("eyes")], partitions=[a_partition("eyes", components=["vision"])]),
            [("RARMS044", "partitions.eyes")],
        ),
        (a_system(hosts=[a_host("vision")], partitions=[a_partition("eyes", components=["vision"])]), []),
    ],
)
def test_names_that_cannot_be(system: System, expected: list[tuple[str, str]]) -> None:
    assert found(system) == expected


@pytest.mark.parametrize(
    ("system", "expected"),
    [
        (
            a_system(
                components=[VISION, SPEECH],
                partitions=[a_partition("a", components=["vision", "speech"]), a_partition("b", components=["speech"])],
            ),
            [("RARMS045", "partitions.b.components.0")],
        ),
        (
            a_system(partitions=[a_partition("a", components=["vision", "vision"])]),
            [("RARMS045", "partitions.a.components.1")],
        ),
        (
            a_system(hosts=[ROOMY], components=[ON_HOST], partitions=[a_partition("watchdog")]),
            [("RARMS046", "partitions.watchdog.components.0")],
        ),
        (
            a_system(hosts=[ROOMY], components=[ON_HOST, a_component("vision", together=["watchdog"])]),
            [("RARMS046", "components.vision.together.0")],
        ),
        (
            a_system(components=[VISION, SPEECH], partitions=[a_partition("vision", components=["speech"])]),
            [("RARMS047", "partitions.vision")],
        ),
        (a_system(partitions=[a_partition("eyes", components=["vision"])]), []),
    ],
)
def test_components_and_their_partitions(system: System, expected: list[tuple[str, str]]) -> None:
    assert found(system) == expected


@pytest.mark.parametrize(
    ("system", "expected"),
    [
        (
            a_system(components=[VISION, a_component("speech", together=["vision"], apart=["vision"])]),
            [("RARMS049", "components.speech.apart.0")],
        ),
        (
            a_system(
                components=[
                    a_component("a", together=["b"]),
                    a_component("b", together=["c"]),
                    a_component("c", apart=["a"]),
                ]
            ),
            [("RARMS049", "components.c.apart.0")],
        ),
        (a_system(components=[a_component("a", apart=["a"])]), [("RARMS049", "components.a.apart.0")]),
        (a_system(components=[VISION, VIDEO, a_component("speech", together=["vision"], apart=["video"])]), []),
        (
            a_system(components=[a_component("vision", dedicated=True), a_component("speech", together=["vision"])]),
            [("RARMS050", "components.vision.dedicated")],
        ),
        (
            a_system(
                components=[a_component("vision", dedicated=True), SPEECH],
                partitions=[a_partition("both", components=["vision", "speech"])],
            ),
            [("RARMS050", "components.vision.dedicated")],
        ),
        (a_system(components=[a_component("vision", dedicated=True)], partitions=[a_partition("vision")]), []),
        (
            a_system(
                components=[VISION, a_component("speech", apart=["vision"])],
                partitions=[a_partition("both", components=["vision", "speech"])],
            ),
            [("RARMS051", "components.speech.apart.0")],
        ),
        (
            a_system(
                components=[VISION, a_component("speech", together=["vision"])], partitions=[a_partition("vision")]
            ),
            [("RARMS052", "components.speech.together.0")],
        ),
        (
            a_system(
                components=[VISION, a_component("speech", together=["vision"])],
                partitions=[a_partition("both", components=["vision", "speech"])],
            ),
            [],
        ),
        (
            a_system(
                hosts=[a_host("left"), a_host("right")],
                components=[
                    a_component("vision", hosts=["left"]),
                    a_component("speech", hosts=["right"], together=["vision"]),
                ],
            ),
            [("RARMS093", "components.speech.together")],
        ),
        (
            a_system(
                hosts=[a_host("left"), a_host("right")],
                components=[a_component("vision", hosts=["left"]), a_component("speech", hosts=["right"])],
                partitions=[a_partition("both", components=["vision", "speech"])],
            ),
            [("RARMS093", "partitions.both.components")],
        ),
    ],
)
def test_company(system: System, expected: list[tuple[str, str]]) -> None:
    assert found(system) == expected


def test_a_contradiction_through_others_names_them() -> None:
    system = a_system(
        components=[a_component("a", together=["b"]), a_component("b", together=["c"]), a_component("c", apart=["a"])]
    )

    assert details(system) == '"c" must be apart from "a", but `together` binds the two through b.'


@pytest.mark.parametrize(
    ("moved", "expected"),
    [
        ({"vision": "vision"}, ["RARMS080"]),
        ({"eyes": "sight", "sight": "eyes"}, ["RARMS080", "RARMS080"]),
        ({"vision": "speech", "speech": "vision"}, ["RARMS080", "RARMS080"]),
        ({"eyes": "sight", "sight": "vision"}, ["RARMS042"]),
        ({"vision": "speech"}, ["RARMS081"]),
        ({"eyes": "vision", "camera": "vision"}, []),  # a fleet may have come from both
        ({"eyes": "vision", "ears": "speech"}, []),
    ],
)
def test_moves(moved: dict[str, str], expected: list[str]) -> None:
    system = a_system(components=[VISION, SPEECH], moved=moved)

    assert sorted(code for code, _ in found(system)) == expected


def test_a_manifest_without_components() -> None:
    assert found(a_system(components=[])) == [("RARMS089", "components")]


def test_hosts_of_one_platform_are_alike() -> None:
    left = a_host("left", platform="robot")

    assert found(a_system(hosts=[left, a_host("right", platform="robot")])) == []
    assert found(a_system(hosts=[left, a_host("right", platform="robot", logical_processors=4)])) == [
        ("RARMS085", "hosts.right.platform")
    ]
    assert found(a_system(hosts=[left, a_host("right", platform="robot", provider=ProviderKind.LINUX)])) == [
        ("RARMS085", "hosts.right.platform")
    ]


def test_a_measured_reserve_needs_an_apt_and_something_to_run() -> None:
    nothing = a_component(reserve="measured")
    no_run = a_component(reserve="measured", apt={"mean_response_time": at_most(100)})

    assert [code for code, _ in found(a_system(components=[nothing]))] == ["RARMS077", "RARMS079"]
    assert [code for code, _ in found(a_system(components=[no_run]))] == ["RARMS079"]


def test_what_is_not_used_is_noted() -> None:
    assert found(a_system(tasks=[a_task("Grasping")])) == [("RARMS087", "tasks.Grasping")]
    assert found(a_system(tasks=[a_task("Grasping")], components=[a_component(task="grasping")])) == []


@pytest.mark.parametrize(
    ("percent", "says"),
    [
        (25, "Windows would use 20 instead of 25: it rounds down to tens."),
        (99, "Windows would use 90 instead of 99: it rounds down to tens."),
        (0, "Windows would use 20 instead of 0: it uses this default below 10 and above 100."),
        (101, "Windows would use 20 instead of 101: it uses this default below 10 and above 100."),
        (100, "100 switches MMCSS off: no task class would have an effect."),
    ],
)
def test_a_responsiveness_that_windows_takes_for_another_one(percent: int, says: str) -> None:
    system = a_system(hosts=[a_host(system_responsiveness=percent)])

    assert found(system) == [("RARMS227", "hosts.onboard.system_responsiveness")]
    assert details(system) == says


@pytest.mark.parametrize("percent", range(10, 100, 10))
def test_every_responsiveness_that_windows_takes_as_it_is(percent: int) -> None:
    assert found(a_system(hosts=[a_host(system_responsiveness=percent)])) == []


def test_a_linux_host_has_no_responsiveness() -> None:
    system = a_system(hosts=[a_host(provider=ProviderKind.LINUX, system_responsiveness=20)])

    assert found(system) == [("RARMS227", "hosts.onboard.system_responsiveness")]
    assert details(system) == '"onboard" is a Linux host. MMCSS exists on Windows only.'


def test_no_task_class_is_called_like_the_value() -> None:
    vision = a_component("vision", task="systemResponsiveness")
    system = a_system(components=[vision], tasks=[a_task("SystemResponsiveness")])

    assert sorted(one for one in found(system) if one[0] == "RARMS229") == [
        ("RARMS229", "components.vision.task"),
        ("RARMS229", "tasks.SystemResponsiveness"),
    ]


@pytest.mark.parametrize(
    "path", ["machines", "D:machines", "D:\\a|b", 'D:\\x"', "D:\\x?", "D:\\mach*", "D:\\mach[1]", "D:\\a`b", "\\\\"]
)
def test_a_path_that_no_windows_host_can_take(path: str) -> None:
    hyperv = a_host(provider=ProviderKind.HYPERV, settings=HypervHost(vm_path=path))
    partition = replace(a_partition("vision"), hyperv=HypervPartition(image=path))

    told = found(a_system(components=[VISION], hosts=[hyperv], partitions=[partition]))

    assert ("RARMS099", "hosts.onboard.hyperv.vm_path") in told
    assert ("RARMS099", "partitions.vision.hyperv.image") in told


@pytest.mark.parametrize("path", ["D:\\machines", "d:/machines", "\\\\server\\share\\machines", "D:\\Maschinen (2)\\ä"])
def test_a_whole_path_is_no_finding(path: str) -> None:
    hyperv = a_host(provider=ProviderKind.HYPERV, settings=HypervHost(vm_path=path, image=path))

    assert "RARMS099" not in {code for code, _ in found(a_system(components=[VISION], hosts=[hyperv]))}
