"""Laws of the planner: a layout fits and loses no component; where there is none, none exists."""

from itertools import permutations

from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.model.layout import Infeasible, Layout
from rarms_iac.model.system import TaskCategory, TaskRequest
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.reservations import FixedReservations
from rarms_iac.planner.task_classes import classes_of
from tests.builders import a_component, a_host, a_system, a_task
from tests.planning import PLACES
from tests.strategies import state_with


@given(st.lists(st.tuples(st.integers(0, 90), st.integers(1, 20)), min_size=1, max_size=6), st.integers(1, 3))
def test_layout_fits_and_misfit_says_why(wanted: list[tuple[int, int]], number: int) -> None:
    hosts = [a_host(f"host{at}", memory="2 GiB") for at in range(number)]
    components = [
        a_component(f"part{at}", reserve=f"{share} %", memory=f"{64 * memory} MiB")
        for at, (share, memory) in enumerate(wanted)
    ]
    system = a_system(hosts=hosts, components=components)

    planning = plan_layout(system, FixedReservations(), {}, PLACES)

    match planning.answer:
        case Layout(partitions=partitions):
            assert sorted(name for partition in partitions for name in partition.components) == sorted(
                system.components
            )
            for host in hosts:
                here = [partition for partition in partitions if partition.host == host.name]
                assert sum(partition.reserved for partition in here) <= host.logical_processors
                assert sum(partition.settings.memory for partition in here) <= host.memory
        case Infeasible(causes=causes):
            assert causes
            assert planning.findings
            for cause in causes:
                names = cause.values["partitions"]
                assert isinstance(names, tuple)
                only = [system.components[str(name)] for name in names]
                again = plan_layout(a_system(hosts=hosts, components=only), FixedReservations(), {}, PLACES)
                assert isinstance(again.answer, Infeasible), "what is said to conflict does"


@given(st.lists(st.tuples(st.integers(1, 9), st.sampled_from("ABCDEFGH")), max_size=8))
def test_threads_of_more_critical_classes_run_higher(users: list[tuple[int, str]]) -> None:
    components = [
        a_component(f"c{at}", criticality=criticality, task=name) for at, (criticality, name) in enumerate(users)
    ]

    found = classes_of(components, {}, "", PLACES)

    assert {finding.code for finding in found.findings} <= {"RARMS129"}
    assert {task_class.name for task_class in found.classes} == {name for _, name in users}
    for task_class in found.classes:
        for other in found.classes:
            if task_class.criticality > other.criticality:
                assert task_class.thread_priority > other.thread_priority


def test_an_empty_host_counts_as_the_manifest_says() -> None:
    system = a_system()
    states = {name: state_with(host) for name, host in system.hosts.items()}

    unseen = plan_layout(system, FixedReservations(), {}, PLACES)

    assert unseen == plan_layout(system, FixedReservations(), states, PLACES)


LEVEL = st.none() | st.integers(1, 8)
WISHES = st.builds(
    a_task,
    name=st.sampled_from([f"Class{at}" for at in range(9)]),
    category=st.none() | st.sampled_from(list(TaskCategory)),
    priority=LEVEL,
    background_priority=LEVEL,
)


@given(st.dictionaries(st.integers(0, 8), st.integers(0, 12), min_size=1), st.lists(WISHES, max_size=4))
def test_threads_follow_criticality_or_a_finding_says_so(
    criticalities: dict[int, int], requests: list[TaskRequest]
) -> None:
    """Among the components of one Windows, with any values that the manifest fixes."""
    components = [a_component(f"c{at}", task=f"Class{at}", criticality=weight) for at, weight in criticalities.items()]
    fixed = {request.name: request for request in requests}
    found = classes_of(components, fixed, "media", PLACES)

    collapses = [
        (upper.name, lower.name)
        for upper, lower in permutations(found.classes, 2)
        if upper.criticality > lower.criticality and upper.thread_priority <= lower.thread_priority
    ]
    assert bool(collapses) == ("RARMS128" in {finding.code for finding in found.findings})
    assert all(
        1 <= task_class.priority <= 8 and 1 <= task_class.background_priority <= 8 for task_class in found.classes
    )
