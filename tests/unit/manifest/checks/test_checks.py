from collections.abc import Sequence
from dataclasses import replace

import pytest

from rarms_iac.manifest.checks.hosts import is_reference
from rarms_iac.model.host import Host, HypervHost, LinuxHost, ProviderKind
from rarms_iac.model.system import Component, HypervPartition, PartitionRequest, RunsOn, System
from tests.builders import a_component, a_cpu, a_host, a_partition, a_simulation, a_system, a_task
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


BIG = a_host("big", logical_processors=8, memory="64 GiB")


@pytest.mark.parametrize(
    ("system", "expected"),
    [
        (a_system(components=[a_component(reserve="60 %", limit="40 %")]), "components.vision.cpu.limit"),
        (a_system(components=[a_component(reserve="1.4 LP", limit="1.2 LP")]), "components.vision.cpu.limit"),
        (a_system(components=[a_component(reserve="1.4 LP", limit="60 %")]), "components.vision.cpu.limit"),
        (a_system(components=[a_component(reserve="1.2 LP", limit="60 %")]), None),
        (a_system(hosts=[a_host(), BIG], components=[a_component(reserve="1.4 LP", limit="60 %")]), None),
        (a_system(components=[a_component(reserve="40 %", limit="40 %")]), None),
        (
            a_system(
                components=[a_component(reserve=None)],
                partitions=[a_partition("vision", cpu=a_cpu(reserve="50 %", limit="10 %"))],
            ),
            "partitions.vision.cpu.limit",
        ),
    ],
)
def test_reserve_over_limit(system: System, expected: str | None) -> None:
    assert found(system) == ([("RARMS060", expected)] if expected else [])


@pytest.mark.parametrize(
    ("system", "finds"),
    [
        (a_system(components=[a_component(reserve="2.5 LP")]), True),
        (a_system(components=[a_component(reserve="2 LP")]), False),
        (a_system(components=[a_component(reserve="100 %")]), False),
        (a_system(hosts=[a_host(keep_processor="10 %")], components=[a_component(reserve="95 %")]), True),
        (a_system(hosts=[a_host(), BIG], components=[a_component(reserve="2.5 LP")]), False),
        (a_system(hosts=[a_host(), BIG], components=[a_component(reserve="2.5 LP", hosts=["onboard"])]), True),
    ],
)
def test_reserve_over_every_host(system: System, finds: bool) -> None:
    assert found(system) == ([("RARMS061", "components.vision.cpu.reserve")] if finds else [])


def test_detail_says_what_largest_host_can_promise() -> None:
    system = a_system(hosts=[a_host(keep_processor="10 %"), BIG], components=[a_component(reserve="9 LP")])

    assert details(system) == (
        '"vision" reserves 9 LP, but "big" has 8 LP of its 8 LP for partitions, more than any other host it may run on.'
    )


@pytest.mark.parametrize(
    ("reserve", "processors", "threads", "expected"),
    [
        ("70 %", None, 1, ["RARMS063"]),
        ("50 %", None, 1, []),
        ("70 %", None, 2, []),
        ("1.4 LP", 2, 1, ["RARMS063"]),
        ("1.4 LP", 1, 1, ["RARMS060"]),
        ("1 LP", 1, 1, []),
    ],
)
def test_a_reserve_that_threads_or_processors_cannot_use(
    reserve: str, processors: int | None, threads: int, expected: list[str]
) -> None:
    component = a_component(reserve=reserve, processors=processors, simulation=a_simulation(threads=threads))

    assert [code for code, _ in found(a_system(components=[component]))] == expected


def test_more_processors_than_any_host_has() -> None:
    many = a_component(processors=4)

    assert found(a_system(components=[many])) == [("RARMS061", "components.vision.processors")]
    assert found(a_system(hosts=[a_host(), BIG], components=[many])) == []
    assert found(a_system(partitions=[a_partition("vision", processors=3)])) == [
        ("RARMS061", "partitions.vision.processors")
    ]


def test_a_partition_and_its_only_component_agree() -> None:
    def system(reserve: str) -> System:
        return a_system(partitions=[a_partition("vision", cpu=a_cpu(reserve=reserve))])

    assert found(system("30 %")) == [("RARMS094", "partitions.vision.cpu.reserve")]
    assert found(system("20 %")) == []


def test_hosts_of_one_platform_are_alike() -> None:
    left = a_host("left", platform="robot")

    assert found(a_system(hosts=[left, a_host("right", platform="robot")])) == []
    assert found(a_system(hosts=[left, a_host("right", platform="robot", logical_processors=4)])) == [
        ("RARMS085", "hosts.right.platform")
    ]
    assert found(a_system(hosts=[left, a_host("right", platform="robot", provider=ProviderKind.LINUX)])) == [
        ("RARMS085", "hosts.right.platform")
    ]


@pytest.mark.parametrize(
    ("percent", "message"),
    [
        (25, "Windows would use 20 instead of 25: it rounds down to tens."),
        (99, "Windows would use 90 instead of 99: it rounds down to tens."),
        (0, "Windows would use 20 instead of 0: it uses this default below 10 and above 100."),
        (101, "Windows would use 20 instead of 101: it uses this default below 10 and above 100."),
        (100, "100 switches MMCSS off: no task class would have an effect."),
    ],
)
def test_a_responsiveness_that_windows_takes_for_another_one(percent: int, message: str) -> None:
    system = a_system(hosts=[a_host(system_responsiveness=percent)])

    assert found(system) == [("RARMS227", "hosts.onboard.system_responsiveness")]
    assert details(system) == message


@pytest.mark.parametrize("percent", range(10, 100, 10))
def test_every_responsiveness_that_windows_takes_as_it_is(percent: int) -> None:
    assert found(a_system(hosts=[a_host(system_responsiveness=percent)])) == []


@pytest.mark.parametrize("name", ["system", "user", "machine", "init", "docker"])
def test_a_slice_of_systemd_is_refused(name: str) -> None:
    system = a_system(hosts=[a_host(provider=ProviderKind.LINUX, settings=LinuxHost(slice=name))])

    assert found(system) == [("RARMS043", "hosts.onboard.linux.slice")]


def test_a_linux_host_has_no_responsiveness() -> None:
    system = a_system(hosts=[a_host(provider=ProviderKind.LINUX, system_responsiveness=20)])

    assert found(system) == [("RARMS227", "hosts.onboard.system_responsiveness")]
    assert details(system) == '"onboard" is a Linux host. MMCSS exists on Windows only.'


@pytest.mark.parametrize(
    "path", ["machines", "D:machines", "D:\\a|b", 'D:\\x"', "D:\\x?", "D:\\mach*", "D:\\mach[1]", "D:\\a`b", "\\\\"]
)
def test_a_path_that_no_windows_host_can_take(path: str) -> None:
    hyperv = a_host(provider=ProviderKind.HYPERV, settings=HypervHost(vm_path=path))
    partition = replace(a_partition("vision"), hyperv=HypervPartition(image=path))

    told = found(a_system(components=[VISION], hosts=[hyperv], partitions=[partition]))

    assert ("RARMS017", "hosts.onboard.hyperv.vm_path") in told
    assert ("RARMS017", "partitions.vision.hyperv.image") in told


@pytest.mark.parametrize("path", ["D:\\machines", "d:/machines", "\\\\server\\share\\machines", "D:\\Maschinen (2)\\ä"])
def test_a_whole_path_is_no_finding(path: str) -> None:
    hyperv = a_host(provider=ProviderKind.HYPERV, settings=HypervHost(vm_path=path, image=path))

    assert "RARMS017" not in {code for code, _ in found(a_system(components=[VISION], hosts=[hyperv]))}


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


def test_memory_of_partitions() -> None:
    components = [a_component("vision"), a_component("speech")]
    both = a_partition("vision", components=["vision", "speech"], memory="768 MiB")

    assert found(a_system(components=components, partitions=[both])) == [("RARMS058", "partitions.vision.memory")]
    assert found(a_system(components=[a_component(memory="8 GiB")])) == [("RARMS061", "components.vision.memory")]
    assert found(a_system(hosts=[a_host(keep_memory="1 GiB")], components=[a_component(memory="3 GiB")])) == []
    assert found(a_system(hosts=[a_host(), BIG], components=[a_component(memory="8 GiB")])) == []


def test_memory_of_unknown_members_is_no_error() -> None:
    unknown = a_partition("vision", components=["nobody"])

    assert found(a_system(components=[], partitions=[unknown])) == [
        ("RARMS042", "partitions.vision.components.0"),
        ("RARMS089", "components"),
    ]


@pytest.mark.parametrize("memory", ["1000 KiB", "30 MiB", "513 MiB", "512.5 MiB"])
def test_hyperv_takes_even_mebibytes(memory: str) -> None:
    odd = [a_component(memory=memory)]

    assert found(a_system(components=odd)) == [("RARMS017", "components.vision.memory")]
    assert found(a_system(hosts=[a_host(provider=ProviderKind.HYPERV)], components=odd)) == [
        ("RARMS017", "components.vision.memory")
    ]
    assert found(a_system(hosts=[a_host(provider=ProviderKind.LINUX)], components=odd)) == []


@pytest.mark.parametrize(
    ("text", "reference"),
    [
        ("robot/guest", True),
        ("guest-1", True),
        ("Tr0ub4dor&3", False),
        ("correct horse", False),
        ("QnLw8sX2pD0vR7kZ", False),
        ("", False),
    ],
)
def test_a_credential_is_the_name_of_one(text: str, reference: bool) -> None:
    assert is_reference(text) is reference
