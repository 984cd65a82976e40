from collections.abc import Iterator, Mapping
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.model.system import Component
from rarms_iac.planner.leftover.affinity import ALL, masks_of
from rarms_iac.planner.leftover.classes import classes_of, registry_values
from tests.builders import a_component, at_most
from tests.planning import PLACES

APT = {"mean_response_time": at_most(100)}


def a_class(name: str, criticality: int, processors: int | None = None, *, apt: bool = False) -> Component:
    return a_component(
        name, criticality=criticality, processors=processors, task=name.title(), reserve=None, apt=APT if apt else None
    )


def test_the_least_critical_are_kept_to_the_last_processors_each_within_the_next() -> None:
    arm, log, map_ = a_class("arm", 30, 2, apt=True), a_class("log", 10, 1), a_class("map", 20, 2)

    found = classes_of([arm, log, map_], {}, "body", PLACES, processors=4).classes

    assert {one.name: one.affinity for one in found} == {"Arm": ALL, "Log": 0b1000, "Map": 0b1100}
    assert {one.name: registry_values(one)["Affinity"].data for one in found} == {"Arm": 0, "Log": 8, "Map": 12}


def test_what_has_an_apt_or_says_nothing_frees_itself_and_all_above_it() -> None:
    free, promised, log = a_class("free", 20), a_class("promised", 20, 1, apt=True), a_class("log", 30, 1)

    assert masks_of([[free], [log]], 4) == {}
    assert masks_of([[promised], [log]], 4) == {}


def test_who_shares_a_class_shares_its_processors() -> None:
    one, other = a_class("log", 10, 1), replace(a_class("map", 20, 1), task="LOG")

    assert masks_of([[one, other]], 4) == {"log": 0b1100}


def test_a_mask_names_no_processor_that_it_has_no_bit_for() -> None:
    assert masks_of([[a_class("log", 10, 1)]], 33) == {}
    assert masks_of([[a_class("log", 10, 1)]], 32) == {"log": 1 << 31}
    assert masks_of([[a_class("log", 10, 1)]], 0) == {}


components = st.lists(
    st.tuples(st.integers(0, 3), st.none() | st.integers(1, 4), st.booleans()), min_size=1, max_size=4
).map(lambda wanted: [a_class(f"c{at}", one, width, apt=apt) for at, (one, width, apt) in enumerate(wanted)])


@given(components, st.integers(1, 4), st.data())
def test_no_thread_waits_while_a_less_critical_one_runs(
    components: list[Component], processors: int, data: st.DataObject
) -> None:
    masks = masks_of([[one] for one in components], processors)
    threads = [one for one in components for _ in range(data.draw(st.integers(0, 3)))]

    for runs in _schedules(threads, masks, processors):
        running = list(runs.values())
        for one in components:
            if threads.count(one) > running.count(one):
                assert all(other.criticality >= one.criticality for other in running)


def _schedules(threads: list[Component], masks: Mapping[str, int], processors: int) -> Iterator[dict[int, Component]]:
    """What runs where: each thread, the most critical first, on the first or the last processor that is free for it."""
    for first in (min, max):
        runs: dict[int, Component] = {}
        for one in sorted(threads, key=lambda each: -each.criticality):
            assert one.task is not None
            mask = masks.get(one.task.lower(), ALL) or (1 << processors) - 1
            free = [at for at in range(processors) if mask >> at & 1 and at not in runs]
            if free:
                runs[first(free)] = one
        yield runs
