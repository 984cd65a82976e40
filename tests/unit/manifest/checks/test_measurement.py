from collections.abc import Mapping
from dataclasses import replace

import pytest

from rarms_iac.manifest.checks.measurement import pattern_groups
from rarms_iac.model.run import Elapsed, Run, SampleCount, Samples, TimeField
from rarms_iac.model.system import System, Threshold
from tests.builders import a_component, a_run, a_system, at_least, at_most, milliseconds
from tests.unit.manifest.checks.violations import found

RESPONSE = TimeField(field="ms", unit="ms")


def with_run(run: Run, apt: Mapping[str, Threshold] | None = None, reserve: str = "20 %") -> System:
    return a_system(components=[a_component(run=run, apt=apt, reserve=reserve)])


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
def test_index_needs_samples_it_is_made_of(index: str, threshold: Threshold, samples: Samples, finds: bool) -> None:
    system = with_run(a_run(samples=samples), {index: threshold})

    assert found(system) == ([("RARMS016", f"components.vision.apt.{index}")] if finds else [])


def test_a_called_function_is_watched_by_its_runner() -> None:
    run = a_run(samples=Samples(source="json_lines"))
    called = replace(run, command=(), call="a:b")

    assert found(with_run(called, {"mean_response_time": at_most(100)})) == []


def test_times_that_contradict_each_other() -> None:
    too_short = a_run(every="2 s", until=Elapsed(time=milliseconds("1 s")))
    cut_off = a_run(timeout="100 ms")

    assert found(with_run(too_short)) == [("RARMS017", "components.vision.run.until")]
    assert found(with_run(a_run(every="1 s", until=Elapsed(time=milliseconds("1 s"))))) == []
    assert found(with_run(cut_off, {"maximum_response_time": at_most(100)})) == [
        ("RARMS069", "components.vision.run.timeout")
    ]
    assert found(with_run(a_run(timeout="100 ms", deadline="1 s"))) == [("RARMS069", "components.vision.run.timeout")]
    assert found(with_run(cut_off, {"maximum_response_time": at_most(99)})) == []


P99: dict[str, Threshold] = {"p99_response_time": at_most(100)}


@pytest.mark.parametrize(
    ("run", "apt", "finds"),
    [
        (a_run(until=SampleCount(samples=832)), P99, ["run.until"]),
        (a_run(until=SampleCount(samples=833)), P99, []),
        (a_run(), P99, []),
        (a_run(every="699 ms"), P99, []),
        (a_run(every="700 ms"), P99, ["apt.p99_response_time"]),
        (a_run(), {"success_rate": at_least(100)}, ["apt.success_rate"]),
        (a_run(every="1 s", until=SampleCount(samples=601)), {"mean_response_time": at_most(100)}, ["run.until"]),
        (a_run(until=Elapsed(time=milliseconds("11 min"))), {"mean_response_time": at_most(100)}, ["run.until"]),
    ],
)
def test_samples_that_until_or_the_budget_forbid(run: Run, apt: dict[str, Threshold], finds: list[str]) -> None:
    """A p99 needs 833 and 30 starts of the busy loop; a setting may take 10 min."""
    assert found(with_run(run, apt, "measured")) == [("RARMS074", f"components.vision.{place}") for place in finds]
    assert found(with_run(run, apt)) == [], "what is fixed is not measured"


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

    assert found(with_run(a_run(samples=samples))) == [("RARMS017", "components.vision.run.samples.pattern")]


def test_catastrophic_pattern_is_harmless_in_re2() -> None:
    assert pattern_groups(r"^(a+)+$") == {}
    assert pattern_groups(r"^heard .* ok=(?P<success>[01]) ms=(?P<response>[0-9.]+)") == {"success": 1, "response": 2}
