import pytest

from rarms_iac.model.system import System
from tests.builders import a_component, a_cpu, a_host, a_partition, a_simulation, a_system
from tests.unit.manifest.checks.violations import details, found

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
