from dataclasses import replace

import pytest

from rarms_iac.model.host import HypervHost, LinuxHost, ProviderKind
from rarms_iac.model.system import HypervPartition
from tests.builders import a_component, a_host, a_partition, a_system
from tests.unit.manifest.checks.violations import details, found

VISION = a_component("vision", criticality=30)


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
