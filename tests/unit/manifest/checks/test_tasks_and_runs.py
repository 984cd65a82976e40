from collections.abc import Mapping
from fractions import Fraction

import pytest

from rarms_iac.manifest.checks.measurement import pattern_groups, samples_needed
from rarms_iac.manifest.checks.secrets import is_reference
from rarms_iac.model.system import (
    Call,
    Connect,
    Elapsed,
    Field,
    FromEnvironment,
    Guest,
    Run,
    RunsOn,
    SampleCount,
    Samples,
    System,
    TaskCategory,
    TaskWish,
    Threshold,
)
from tests.builders import (
    a_component,
    a_host,
    a_partition,
    a_run,
    a_system,
    a_task,
    at_least,
    at_most,
    milliseconds,
)
from tests.unit.manifest.checks.test_names_and_partitions import details, found

RESPONSE = Field(name="ms")


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


def test_classes_that_are_one_registry_key() -> None:
    system = a_system(components=[a_component(task="Grasping")], tasks=[a_task("Grasping"), a_task("GRASPING")])

    assert found(system) == [("RARMS055", "tasks.GRASPING")]


def two_tasks(vision: TaskWish, speech: TaskWish) -> System:
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
    def task(name: str, fixed: tuple[TaskCategory | None, int | None, int | None]) -> TaskWish:
        return a_task(name, category=fixed[0], priority=fixed[1], background_priority=fixed[2])

    system = two_tasks(task("Seeing", vision), task("Hearing", speech))

    assert found(system) == ([("RARMS056", "tasks.Seeing")] if finds else [])


def test_an_order_is_promised_within_one_operating_system_only() -> None:
    system = two_tasks(a_task("Seeing", category=TaskCategory.HIGH), a_task("Hearing", category=TaskCategory.HIGH))
    apart = a_system(components=system.components.values(), tasks=system.tasks.values())

    assert found(apart) == []


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


def with_run(run: Run, apt: Mapping[str, Threshold] | None = None) -> System:
    return a_system(components=[a_component(run=run, apt=apt)])


@pytest.mark.parametrize(
    ("index", "threshold", "samples", "finds"),
    [
        ("mean_response_time", at_most(100), Samples(source="json_lines"), True),
        ("mean_response_time", at_most(100), Samples(source="json_lines", response_time=RESPONSE), False),
        ("p95_response_time", at_most(100), Samples(source="json_lines", success=RESPONSE), True),
        ("jitter", at_most(1), Samples(source="json_lines", success=RESPONSE), True),
        ("success_rate", at_least(95), Samples(source="json_lines", response_time=RESPONSE), True),
        ("success_rate", at_least(95), Samples(source="per_run"), False),
        ("throughput", at_least(24), Samples(source="json_lines"), True),
        ("throughput", at_least(24), Samples(source="json_lines", count=RESPONSE), False),
    ],
)
def test_an_index_needs_the_samples_it_is_made_of(
    index: str, threshold: Threshold, samples: Samples, finds: bool
) -> None:
    system = with_run(a_run(samples=samples), {index: threshold})

    assert found(system) == ([("RARMS070", f"components.vision.apt.{index}")] if finds else [])


def test_a_called_function_is_watched_by_its_runner() -> None:
    run = a_run(samples=Samples(source="json_lines"))
    called = Run(
        start=Call(module="a", function="b"),
        files=run.files,
        environment=run.environment,
        folder=run.folder,
        until=run.until,
        timeout=run.timeout,
        stop=run.stop,
        arrival=run.arrival,
        samples=run.samples,
        deadline=run.deadline,
        failures=run.failures,
    )

    assert found(with_run(called, {"mean_response_time": at_most(100)})) == []


def test_times_that_contradict_each_other() -> None:
    too_short = a_run(every="2 s", until=Elapsed(time=milliseconds("1 s")))
    cut_off = a_run(timeout="100 ms")

    assert found(with_run(too_short)) == [("RARMS068", "components.vision.run.until")]
    assert found(with_run(a_run(every="1 s", until=Elapsed(time=milliseconds("1 s"))))) == []
    assert found(with_run(cut_off, {"maximum_response_time": at_most(100)})) == [
        ("RARMS069", "components.vision.run.timeout")
    ]
    assert found(with_run(a_run(timeout="100 ms", deadline="1 s"))) == [("RARMS069", "components.vision.run.timeout")]
    assert found(with_run(cut_off, {"maximum_response_time": at_most(99)})) == []


def test_a_miss_rate_needs_a_deadline() -> None:
    apt = {"deadline_miss_rate": at_most(1)}

    assert found(with_run(a_run(), apt)) == [("RARMS071", "components.vision.apt.deadline_miss_rate")]
    assert found(with_run(a_run(every="33 ms"), apt)) == []


@pytest.mark.parametrize(
    ("index", "needed"),
    [
        ("p95_response_time", 20),
        ("p99_response_time", 100),
        ("p50_response_time", 2),
        ("p99.9_response_time", 1000),
        ("mean_response_time", None),
    ],
)
def test_samples_that_a_percentile_needs(index: str, needed: int | None) -> None:
    assert samples_needed(index) == needed


def test_a_percentile_of_too_few_samples() -> None:
    apt = {"p99_response_time": at_most(Fraction(100))}

    assert found(with_run(a_run(until=SampleCount(samples=99)), apt)) == [("RARMS074", "components.vision.run.until")]
    assert found(with_run(a_run(until=SampleCount(samples=100)), apt)) == []


@pytest.mark.parametrize(
    "pattern",
    [
        r"(?=x)y",  # look-ahead
        r"(?<!x)y",  # look-behind
        r"(a)\1",  # back-reference
        r"(?P<a>x)(?P=a)",
        r"(?>a+)b",  # atomic group
        r"a++",  # possessive in other dialects, a nested repetition here
        r"(",
        r"(((((a{100}){100}){100}){100}){100})",  # memory
        "\ud800",
    ],
)
def test_patterns_that_are_not_re2_or_too_large(pattern: str) -> None:
    samples = Samples(source="pattern", pattern=pattern)

    assert found(with_run(a_run(samples=samples))) == [("RARMS072", "components.vision.run.samples.pattern")]


def test_a_pattern_that_is_catastrophic_elsewhere_is_harmless_in_re2() -> None:
    assert pattern_groups(r"^(a+)+$") == {}
    assert pattern_groups(r"^heard .* ok=(?P<success>[01]) ms=(?P<response>[0-9.]+)") == {"success": 1, "response": 2}


def test_a_field_names_a_group_of_the_pattern() -> None:
    samples = Samples(
        source="pattern", pattern=r"ms=(?P<response>[0-9.]+)", response_time=Field(name="respnse"), success=None
    )

    assert found(with_run(a_run(samples=samples))) == [
        ("RARMS073", "components.vision.run.samples.response_time.field")
    ]
    assert 'Did you mean "response"?' in details(with_run(a_run(samples=samples)))


def test_only_a_simulated_host_has_nothing_to_connect_to() -> None:
    connect = Connect(ssh="robot@onboard")

    assert found(a_system(hosts=[a_host(connect=connect)])) == [("RARMS084", "hosts.onboard.connect")]


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


def test_secrets_do_not_stand_in_the_manifest() -> None:
    guest = Guest(credential="Tr0ub4dor&3")
    written = a_run(environment={"CAMERA_PASSWORD": "opensesame", "CAMERA": "front"})
    taken = a_run(environment={"CAMERA_PASSWORD": FromEnvironment(name="CAMERA_PASSWORD")})

    assert found(a_system(partitions=[a_partition("vision", guest=guest)])) == [
        ("RARMS090", "partitions.vision.guest.credential")
    ]
    assert found(with_run(written)) == [("RARMS091", "components.vision.run.environment.CAMERA_PASSWORD")]
    assert found(with_run(taken)) == []


def test_no_finding_shows_the_secret() -> None:
    system = a_system(partitions=[a_partition("vision", guest=Guest(credential="Tr0ub4dor&3"))])

    assert "Tr0ub4dor" not in details(system)
