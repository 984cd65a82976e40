"""Which parts of a host count as moved."""

from dataclasses import replace

import pytest

from rarms_iac.diff.drift import moved_parts, part_digests
from rarms_iac.model.host import SchedulerType
from rarms_iac.model.state import Mark, Partition, RegistryValue, RunState, State, TaskClass, ValueKind
from tests.builders_plan import facts, settings

FACTS = facts()
SETTINGS = settings()
MANAGED = Partition(
    settings=SETTINGS,
    id="aaaa",
    state=RunState.RUNNING,
    mark=Mark(application="robot", name="vision", machine="aaaa", set="0" * 12),
)
THEIRS = Partition(settings=replace(SETTINGS, name="database", reserve=10), id="bbbb", state=RunState.RUNNING)
AUDIO = TaskClass(name="Audio", values={"Priority": RegistryValue(kind=ValueKind.DWORD, data=6)})
STATE = State(facts=FACTS, partitions=(THEIRS, MANAGED), tasks=(AUDIO,), serials={"robot": 3, "other": 9})


def moved(after: State) -> tuple[str, ...]:
    return moved_parts(part_digests(STATE, "robot"), part_digests(after, "robot"))


def test_unchanged_host_has_not_moved() -> None:
    assert moved(STATE) == ()


@pytest.mark.parametrize(
    ("after", "change"),
    [
        (replace(STATE, facts=replace(FACTS, logical_processors=4)), "the host itself has changed"),
        (replace(STATE, facts=replace(FACTS, scheduler=SchedulerType.ROOT)), "the host itself has changed"),
        (replace(STATE, serials={"robot": 4}), "the count of applies has changed"),
        (replace(STATE, partitions=(THEIRS,)), "partition/vision is gone"),
        (
            replace(STATE, partitions=(THEIRS, replace(MANAGED, settings=replace(SETTINGS, weight=99)))),
            "partition/vision has changed",
        ),
        (
            replace(STATE, partitions=(replace(THEIRS, settings=replace(THEIRS.settings, reserve=11)), MANAGED)),
            "machine database (bbbb) has changed",
        ),
        (replace(STATE, partitions=(MANAGED, THEIRS, replace(THEIRS, id="cccc"))), "machine database (cccc) is new"),
        (
            replace(STATE, tasks=(replace(AUDIO, values={"Priority": RegistryValue(kind=ValueKind.SZ, data="6")}),)),
            "task/Audio has changed",
        ),
    ],
)
def test_what_a_plan_rests_on_counts_as_moved(after: State, change: str) -> None:
    assert moved(after) == (change,)


def test_what_no_plan_rests_on_does_not_count() -> None:
    others = replace(THEIRS, other_notes="a note", settings=replace(THEIRS.settings, weight=7))

    assert moved(replace(STATE, partitions=(others, MANAGED), serials={"robot": 3, "other": 10})) == ()
