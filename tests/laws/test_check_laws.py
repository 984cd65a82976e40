"""To each manifest whose structure holds the checks answer: in order, at addresses that can be accepted."""

import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import date

from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.manifest.acceptance import apply_acceptances
from rarms_iac.manifest.checks import CODES, run_checks
from rarms_iac.model.diagnostics import Severity, in_order
from rarms_iac.model.run import Elapsed, SampleCount
from rarms_iac.model.system import Acceptance, Component, Policy, RunsOn, System, TaskCategory, run_of
from tests.builders import (
    PathPlaces,
    a_component,
    a_cpu,
    a_host,
    a_partition,
    a_run,
    a_simulation,
    a_system,
    a_task,
    at_least,
    at_most,
    codes,
    milliseconds,
)

TODAY = date(2026, 1, 1)
ADDRESS = re.compile(r"(application|component|host|interference|partition|task)/[A-Za-z0-9][A-Za-z0-9 -]*")

names = st.sampled_from(["a", "b", "c", "d", "nul", "onboard"])
amounts = st.sampled_from(["10 %", "60 %", "100 %", "0.5 LP", "1.4 LP", "9 LP"])
memories = st.sampled_from(["256 MiB", "1000 KiB", "9 GiB"])
tasks = st.sampled_from(["ObjectIdentification", "Localization", "Games", "grasping", "Nonsense"])
components = st.builds(
    a_component,
    names,
    criticality=st.integers(0, 3),
    memory=memories,
    processors=st.none() | st.integers(1, 4),
    reserve=st.none() | st.just("measured") | amounts,
    limit=st.none() | amounts,
    together=st.lists(names, max_size=2),
    apart=st.lists(names, max_size=2),
    dedicated=st.booleans(),
    task=st.none() | tasks,
    hosts=st.none() | st.lists(st.sampled_from(["onboard", "second", "gone"]), max_size=2),
    runs_on=st.sampled_from(RunsOn),
    interference=st.lists(st.sampled_from(["busy-loop", "gone"]), max_size=2),
    simulation=st.none() | st.builds(a_simulation, threads=st.integers(1, 4)),
)
partitions = st.builds(
    a_partition,
    names,
    components=st.none() | st.lists(names, max_size=3),
    processors=st.none() | st.integers(1, 4),
    memory=st.none() | memories,
    cpu=st.builds(a_cpu, reserve=st.none() | amounts, limit=st.none() | amounts),
)
systems = st.builds(
    a_system,
    hosts=st.lists(
        st.builds(a_host, st.sampled_from(["onboard", "second"]), logical_processors=st.integers(1, 8)),
        min_size=1,
        max_size=2,
    ),
    components=st.lists(components, max_size=4),
    partitions=st.lists(partitions, max_size=3),
    tasks=st.lists(st.builds(a_task, tasks, category=st.none() | st.sampled_from(TaskCategory)), max_size=2),
    moved=st.dictionaries(names, names, max_size=3),
)


@given(systems)
def test_checks_answer_for_every_question_and_always_same(system: System) -> None:
    told = run_checks(system, PathPlaces(), TODAY)

    assert told == in_order(told) == run_checks(system, PathPlaces(), TODAY)
    assert set(codes(told)) <= CODES
    assert all(diagnostic.place is not None and diagnostic.detail and diagnostic.advice for diagnostic in told)
    assert [
        diagnostic.address for diagnostic in told if diagnostic.address and not ADDRESS.fullmatch(diagnostic.address)
    ] == []


@given(systems)
def test_warnings_can_be_accepted_and_errors_not(system: System) -> None:
    told = run_checks(system, PathPlaces(), TODAY)
    policy = Policy(
        accept={
            code: Acceptance(
                code=code,
                at=tuple(sorted({diagnostic.address for diagnostic in told if diagnostic.code == code})),
                reason="x",
                until=None,
            )
            for code in codes(told)
        }
    )

    kept, accepted = apply_acceptances(told, policy, PathPlaces(), TODAY, codes=CODES)

    assert {diagnostic.severity for diagnostic in kept} <= {Severity.ERROR, Severity.NOTE}
    assert {diagnostic.severity for diagnostic in accepted} <= {Severity.WARNING}
    assert len(kept) + len(accepted) == len(told)


apts = st.sampled_from(
    [
        {"mean_response_time": at_most(100)},
        {"p90_response_time": at_most(100)},
        {"p99_response_time": at_most(100), "mean_response_time": at_most(50)},
        {"success_rate": at_least(99)},
        {"success_rate": at_least(100)},
        {"p99.99_response_time": at_most(100)},
        {"deadline_miss_rate": at_most("0.01")},
        {"deadline_miss_rate": at_most(2)},
    ]
)
untils: st.SearchStrategy[SampleCount | Elapsed | None] = st.none() | st.builds(
    SampleCount, samples=st.integers(40, 3000)
)
untils |= st.builds(
    Elapsed, time=st.sampled_from([milliseconds("30 s"), milliseconds("4 min"), milliseconds("20 min")])
)
runs = st.builds(a_run, every=st.sampled_from([None, "20 ms", "400 ms", "1 s", "7.5 s"]), until=untils)
loads = st.lists(st.sampled_from(["busy-loop", "bursts-20", "bursts-100"]), min_size=1, unique=True)
to_measure = st.builds(
    a_component,
    st.sampled_from("abc"),
    reserve=st.just("measured"),
    apt=apts,
    run=runs,
    interference=loads,
    simulation=st.builds(a_simulation, work=st.sampled_from(["2 ms", "90 ms", "3 s"])),
)
SETTING, UNTIL = re.compile(r"setting: (\d+) min"), re.compile(r"until: \{ samples: (\d+) \}")
APT = re.compile(r"`([\w.]+): \{ (at_least|at_most): ([\d.]+) ")


@given(st.lists(to_measure, min_size=1, max_size=3, unique_by=lambda each: each.name))
def test_advice_on_samples_removes_its_finding(drawn: Sequence[Component]) -> None:
    """One finding is followed after the other; the last one leaves none."""
    system = a_system(components=drawn)
    for _ in range(4 * len(drawn)):
        left = [each for each in run_checks(system, PathPlaces(), TODAY) if each.code == "RARMS074"]
        if not left:
            break
        finding, advice = left[0], str(left[0].advice)
        component = system.components[finding.address.removeprefix("component/")]
        if budget := SETTING.search(advice):
            limits = replace(system.policy.measuring, setting=milliseconds(f"{budget[1]} min"))
            system = replace(system, policy=replace(system.policy, measuring=limits))
        elif samples := UNTIL.search(advice):
            longer = replace(run_of(component), until=SampleCount(samples=int(samples[1])))
            components = {**system.components, component.name: replace(component, run=longer)}
            system = replace(system, components=components)
        else:
            relaxed = APT.search(advice)
            assert relaxed, advice
            threshold = at_least(relaxed[3]) if relaxed[2] == "at_least" else at_most(relaxed[3])
            apt = {name: each for name, each in component.apt.items() if name != finding.values["index"]}
            components = {**system.components, component.name: replace(component, apt={**apt, relaxed[1]: threshold})}
            system = replace(system, components=components)
        after = [each for each in run_checks(system, PathPlaces(), TODAY) if each.code == "RARMS074"]
        assert (finding.place, finding.detail) not in [(each.place, each.detail) for each in after]
    assert "RARMS074" not in codes(run_checks(system, PathPlaces(), TODAY))
