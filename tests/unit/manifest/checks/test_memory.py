import pytest

from rarms_iac.model.host import ProviderKind
from tests.builders import a_component, a_host, a_partition, a_system
from tests.unit.manifest.checks.violations import found

BIG = a_host("big", logical_processors=8, memory="64 GiB")


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
