import pytest

from rarms_iac.model.system import RunsOn, System
from tests.builders import a_component, a_host, a_partition, a_system
from tests.unit.manifest.checks.violations import details, found

VISION = a_component("vision", criticality=30)
SPEECH = a_component("speech", criticality=20)
VIDEO = a_component("video", criticality=10)
ON_HOST = a_component("watchdog", runs_on=RunsOn.HOST)
ROOMY = a_host(keep_processor="10 %", keep_memory="1 GiB")


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


def test_a_component_on_the_host_needs_room_there_and_has_no_partition() -> None:
    watchdog = a_component("watchdog", runs_on=RunsOn.HOST, memory="64 MiB")
    with_reserve = a_component("watchdog", runs_on=RunsOn.HOST, reserve="10 %", dedicated=True, memory="64 MiB")
    roomy = a_host(keep_processor="10 %", keep_memory="64 MiB")

    assert found(a_system(components=[watchdog])) == [("RARMS058", "hosts.onboard.keep_for_host")]
    assert found(a_system(hosts=[roomy], components=[watchdog])) == []
    assert sorted(found(a_system(hosts=[roomy], components=[with_reserve]))) == [
        ("RARMS059", "components.watchdog.cpu.reserve"),
        ("RARMS059", "components.watchdog.dedicated"),
    ]
