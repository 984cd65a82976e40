"""To each manifest whose structure holds the checks answer: in order, at addresses that can be accepted."""

import re
from datetime import date

from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.manifest.acceptance import apply_acceptances
from rarms_iac.manifest.checks import CODES, run_checks
from rarms_iac.model.diagnostics import Severity, in_order
from rarms_iac.model.system import Acceptance, Policy, RunsOn, System, TaskCategory
from tests.builders import PathPlaces, a_component, a_cpu, a_host, a_partition, a_simulation, a_system, a_task, codes

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
