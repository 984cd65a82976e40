from collections.abc import Sequence

import pytest

from rarms_iac.model.host import Host
from rarms_iac.model.system import Component, PartitionRequest, RunsOn, System
from tests.builders import a_component, a_host, a_partition, a_system
from tests.unit.manifest.checks.violations import details, found

VISION = a_component("vision", criticality=30)
SPEECH = a_component("speech", criticality=20)
VIDEO = a_component("video", criticality=10)
ON_HOST = a_component("watchdog", runs_on=RunsOn.HOST)
ROOMY = a_host(keep_processor="10 %", keep_memory="1 GiB")
ALONE = a_component("vision", dedicated=True)
WITH_VISION = a_component("speech", together=["vision"])
LEFT, RIGHT = a_component("vision", hosts=["left"]), a_component("speech", hosts=["right"])
CHAIN = (a_component("a", together=["b"]), a_component("b", together=["c"]), a_component("c", apart=["a"]))
BOTH = a_partition("both", components=["vision", "speech"])


def of(
    *components: Component, partitions: Sequence[PartitionRequest] = (), hosts: Sequence[Host] | None = None
) -> System:
    return a_system(components=components or None, partitions=partitions, hosts=hosts)


TWO = (a_host("left"), a_host("right"))


@pytest.mark.parametrize(
    ("system", "expected"),
    [
        (
            of(VISION, SPEECH, partitions=[BOTH, a_partition("speech-alone", components=["speech"])]),
            "RARMS049 partitions.speech-alone.components.0",
        ),
        (of(partitions=[a_partition("a", components=["vision", "vision"])]), "RARMS049 partitions.a.components.1"),
        (
            of(ON_HOST, hosts=[ROOMY], partitions=[a_partition("watchdog")]),
            "RARMS046 partitions.watchdog.components.0",
        ),
        (
            of(ON_HOST, a_component("vision", together=["watchdog"]), hosts=[ROOMY]),
            "RARMS046 components.vision.together.0",
        ),
        (of(VISION, SPEECH, partitions=[a_partition("vision", components=["speech"])]), "RARMS043 partitions.vision"),
        (of(partitions=[a_partition("eyes", components=["vision"])]), ""),
        (
            of(VISION, a_component("speech", together=["vision"], apart=["vision"])),
            "RARMS049 components.speech.apart.0",
        ),
        (of(*CHAIN), "RARMS049 components.c.apart.0"),
        (of(a_component("a", apart=["a"])), "RARMS049 components.a.apart.0"),
        (of(VISION, VIDEO, a_component("speech", together=["vision"], apart=["video"])), ""),
        (of(ALONE, WITH_VISION), "RARMS049 components.vision.dedicated"),
        (of(ALONE, SPEECH, partitions=[BOTH]), "RARMS049 components.vision.dedicated"),
        (of(ALONE, partitions=[a_partition("vision")]), ""),
        (
            of(VISION, a_component("speech", apart=["vision"]), partitions=[BOTH]),
            "RARMS049 components.speech.apart.0",
        ),
        (of(VISION, WITH_VISION, partitions=[a_partition("vision")]), "RARMS049 components.speech.together.0"),
        (of(VISION, WITH_VISION, partitions=[BOTH]), ""),
        (
            of(LEFT, a_component("speech", hosts=["right"], together=["vision"]), hosts=TWO),
            "RARMS049 components.speech.together",
        ),
        (of(LEFT, RIGHT, hosts=TWO, partitions=[BOTH]), "RARMS049 partitions.both.components"),
    ],
)
def test_components_and_those_they_share_a_partition_with(system: System, expected: str) -> None:
    assert [" ".join(each) for each in found(system)] == ([expected] if expected else [])


def test_a_contradiction_through_others_names_them() -> None:
    assert details(of(*CHAIN)) == '"c" must be apart from "a", but `together` binds the two through b.'


def test_host_component_needs_room_and_no_partition() -> None:
    watchdog = a_component("watchdog", runs_on=RunsOn.HOST, memory="64 MiB")
    with_reserve = a_component("watchdog", runs_on=RunsOn.HOST, reserve="10 %", dedicated=True, memory="64 MiB")
    roomy = a_host(keep_processor="10 %", keep_memory="64 MiB")

    assert found(a_system(components=[watchdog])) == [("RARMS058", "hosts.onboard.keep_for_host")]
    assert found(a_system(hosts=[roomy], components=[watchdog])) == []
    assert sorted(found(a_system(hosts=[roomy], components=[with_reserve]))) == [
        ("RARMS046", "components.watchdog.cpu.reserve"),
        ("RARMS046", "components.watchdog.dedicated"),
    ]
