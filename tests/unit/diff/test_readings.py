"""What can be read at an address, and which machine a name stands for."""

from dataclasses import replace

from rarms_iac.diff.readings import NOTHING, readings, resolve
from rarms_iac.model.changes import Address
from rarms_iac.model.plan import Scope
from rarms_iac.model.state import Mark, Partition, RegistryValue, RunState, State, TaskClass, TaskRecord, ValueKind
from tests.builders_plan import facts, settings

SCOPE = Scope(application="robot", plan="0123456789ab")

FACTS = facts()
SETTINGS = settings()
MARK = Mark(application="robot", name="vision", machine="aaaaaaaa", set="0" * 12)
MANAGED = Partition(settings=SETTINGS, id="aaaaaaaa-1", state=RunState.RUNNING, mark=MARK)
STRANGER = Partition(settings=SETTINGS, id="bbbbbbbb-1", state=RunState.RUNNING)
VISION = Address(partition="vision")


def test_unmarked_namesake_is_not_read_as_ours() -> None:
    assert readings(State(facts=FACTS, partitions=(STRANGER,)), VISION, SCOPE) == NOTHING


def test_a_marked_machine_is_found_under_any_name() -> None:
    renamed = replace(MANAGED, settings=replace(SETTINGS, name="eyes"))

    found = readings(State(facts=FACTS, partitions=(STRANGER, renamed)), VISION, SCOPE)

    assert (found["name"], found["machine"], found["mark"]) == ("eyes", "aaaaaaaa-1", "robot/vision")


def test_the_mark_of_another_application_is_not_ours() -> None:
    other = replace(MANAGED, mark=replace(MARK, application="kiosk"))

    assert resolve((other,), "vision", SCOPE) == ()


def test_a_machine_that_this_plan_is_making_counts() -> None:
    pending = replace(STRANGER, settings=replace(SETTINGS, name="vision.rarms-0123456789ab"))
    of_another_plan = replace(STRANGER, settings=replace(SETTINGS, name="vision.rarms-ffffffffffff"))

    assert resolve((of_another_plan, pending), "vision", SCOPE) == (pending,)


def test_an_id_says_which_machine_is_meant() -> None:
    state = State(facts=FACTS, partitions=(MANAGED, STRANGER))

    found = readings(state, Address(partition="vision", machine="bbbbbbbb-1"), SCOPE)

    assert (found["machine"], found["mark"]) == ("bbbbbbbb-1", "")


def test_two_machines_for_one_name_satisfy_no_guard() -> None:
    pending = replace(STRANGER, settings=replace(SETTINGS, name="vision.rarms-0123456789ab"))

    assert readings(State(facts=FACTS, partitions=(MANAGED, pending)), VISION, SCOPE) == {"exists": True, "machines": 2}


def test_task_class_is_read_with_types() -> None:
    task = TaskClass(
        name="MotionControl",
        values={
            "Priority": RegistryValue(kind=ValueKind.SZ, data="6"),
            "Affinity": RegistryValue(kind=ValueKind.DWORD, data=0),
        },
        record=TaskRecord(application="robot", robot="robot-7", set="1" * 12, before=None),
    )

    found = readings(State(facts=FACTS, tasks=(task,)), Address(task="motioncontrol"), SCOPE)

    assert found == {
        "exists": True,
        "values": "affinity, priority",
        "value:Affinity": "dword:0",
        "value:Priority": "sz:6",
        "record": "robot",
        "robot": "robot-7",
        "set": "1" * 12,
    }


def test_a_record_without_its_key_is_read_too() -> None:
    task = TaskClass(name="MotionControl", record=TaskRecord(application="robot", set="1" * 12, before=None))

    found = readings(State(facts=FACTS, tasks=(task,)), Address(task="MotionControl"), SCOPE)

    assert found == {"exists": False, "values": "", "record": "robot", "robot": "", "set": "1" * 12}


def test_task_classes_of_guest_are_its_own() -> None:
    values = {"Priority": RegistryValue(kind=ValueKind.DWORD, data=5)}
    inside = TaskClass(name="Games", inside="vision", machine=MANAGED.id, values=values)
    state = State(facts=FACTS, partitions=(MANAGED,), tasks=(inside,))

    assert readings(state, Address(partition="vision", task="Games"), SCOPE)["exists"] is True
    assert readings(state, Address(task="Games"), SCOPE)["exists"] is False
    assert readings(replace(state, partitions=()), Address(partition="vision", task="Games"), SCOPE)["exists"] is False
