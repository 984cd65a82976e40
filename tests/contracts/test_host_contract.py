"""What every host must do, by any means of enforcing reservations, and what those must do that are a Windows."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import pytest

from rarms_iac.diff.readings import NOTHING, readings
from rarms_iac.model.changes import Address
from rarms_iac.model.host import Fault, FaultEffect, SchedulerType, SimulatedHost
from rarms_iac.model.journal import Closing, RunClosed, StepRecorded, StepStatus
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.operations import (
    CreatePartition,
    EraseMark,
    EraseTaskRecord,
    Operation,
    RemoveDisk,
    RemovePartition,
    RemoveTaskClass,
    RenamePartition,
    StartPartition,
    StopPartition,
    WriteMark,
    WriteTaskClass,
    WriteTaskRecord,
    set_to,
)
from rarms_iac.model.plan import Scope
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.state import (
    Checkpoints,
    RegistryValue,
    Responsiveness,
    Rights,
    RunState,
    StartAction,
    StopAction,
    TaskRecord,
    ValueKind,
)
from rarms_iac.providers.interface import HostDamaged, HostFailed, HostLocked, HostRefused, StepwiseHost
from rarms_iac.providers.simulated.content import empty
from rarms_iac.providers.simulated.provider import SimulatedHostProvider
from tests import builders
from tests.contracts.benches import Bench, bench, windows_bench
from tests.contracts.runs import a_run

__all__ = ["bench", "windows_bench"]  # pytest finds fixtures by their names

MIB = 2**20
SCOPE = Scope(application="robot", plan="0123456789ab")
VISION = Address(partition="vision")
VALUES = {"Priority": RegistryValue(kind=ValueKind.DWORD, data=6)}
RECORD = TaskRecord(application="robot", robot="robot-7", set="a" * 12, before=None)


@dataclass(frozen=True)
class Room:
    """A host in a folder of its own, whose description a test may choose."""

    bench: Bench
    folder: Path

    def host(self, **described: object) -> StepwiseHost:
        settings = replace(SimulatedHost(), **described)  # type: ignore[arg-type]  # fields by name, as each test says
        return self.bench.open(builders.a_host(settings=settings), self.folder)

    def furnish(self, *operations: Operation) -> None:
        """Do what comes before what is tested."""
        do(self.bench.furnished(self.folder), *operations)


@pytest.fixture
def room(bench: Bench, tmp_path: Path) -> Room:
    return Room(bench, tmp_path)


@pytest.fixture
def windows(windows_bench: Bench, tmp_path: Path) -> Room:
    return Room(windows_bench, tmp_path)


def do(host: StepwiseHost, *operations: Operation) -> None:
    for operation in operations:
        host.execute(operation, SCOPE)


def creation(name: str = "vision", memory: int = 512 * MIB) -> CreatePartition:
    return CreatePartition(partition=name, generation=2, memory=memory)


def making(
    name: str = "vision", *, processors: int = 2, reserve: int = 0, memory: int = 512 * MIB, dynamic: bool = False
) -> list[Operation]:
    """What makes a partition of ours, off."""
    return [
        creation(name, memory),
        WriteMark(partition=name, application="robot", name=name, set="0" * 12),
        set_to(name, processors=processors),
        set_to(name, reserve=reserve, limit=100, weight=100),
        set_to(name, memory=memory, dynamic_memory=dynamic),
        RenamePartition(partition=name, name=name),
    ]


def start(name: str = "vision") -> StartPartition:
    return StartPartition(partition=name)


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def refusal_of(host: StepwiseHost, operation: Operation) -> str:
    """Why the host refuses this, after which it is as it was."""
    before = host.observe()
    with pytest.raises(HostRefused) as refusal:
        do(host, operation)
    assert refusal.value.advice
    assert host.observe() == before
    return str(refusal.value)


# What is seen


def test_fresh_host_is_empty_and_looking_changes_nothing(room: Room) -> None:
    state = room.host().observe()

    assert (state.partitions, dict(state.serials)) == ((), {})
    assert room.host().journal() is None
    assert room.host().read(VISION, SCOPE) == NOTHING
    assert list(room.folder.iterdir()) == []


def test_looking_changes_nothing(room: Room) -> None:
    room.furnish(*making(), start())
    host = room.host()
    before = files(room.folder)

    first, second = host.observe(), room.host().observe()
    host.read(VISION, SCOPE)
    host.journal()

    assert first == second
    assert files(room.folder) == before


def test_fresh_windows_has_shipped_classes_with_their_types(windows: Room) -> None:
    assert [task.name for task in windows.host().observe().tasks] == [
        "Audio",
        "Capture",
        "DisplayPostProcessing",
        "Distribution",
        "Games",
        "Playback",
        "Pro Audio",
        "Window Manager",
    ]
    (playback,) = (task for task in windows.host().observe().tasks if task.name == "Playback")

    assert playback.values == {
        "Affinity": RegistryValue(kind=ValueKind.DWORD, data=0),
        "Background Only": RegistryValue(kind=ValueKind.SZ, data="False"),
        "BackgroundPriority": RegistryValue(kind=ValueKind.DWORD, data=4),
        "Clock Rate": RegistryValue(kind=ValueKind.DWORD, data=10_000),
        "GPU Priority": RegistryValue(kind=ValueKind.DWORD, data=8),
        "Priority": RegistryValue(kind=ValueKind.DWORD, data=3),
        "SFIO Priority": RegistryValue(kind=ValueKind.SZ, data="Normal"),
        "Scheduling Category": RegistryValue(kind=ValueKind.SZ, data="Medium"),
    }


def test_the_host_is_as_it_is_described(windows: Room) -> None:
    facts = windows.host(windows_build=19045, client=True, scheduler=SchedulerType.ROOT, smt=True).observe().facts

    assert (facts.os_build, facts.client, facts.scheduler, facts.smt) == (19045, True, SchedulerType.ROOT, True)
    assert (facts.name, facts.logical_processors, facts.memory) == ("onboard", 2, 4096 * MIB)
    assert facts.rights is Rights.PROVEN


def test_the_same_doings_give_the_same_bytes(bench: Bench, tmp_path: Path) -> None:
    contents = []
    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
        do(bench.open(builders.a_host(), tmp_path / folder), *making("vision"), *making("speech"), start())
        contents.append({Path(name).name: data for name, data in files(tmp_path / folder).items()})

    assert contents[0] == contents[1]


# What is done


def test_a_partition_is_made_marked_and_named_last(room: Room) -> None:
    host = room.host()
    create, mark, *rest, rename = making(reserve=40)

    do(host, create)
    (pending,) = host.observe().partitions
    assert (pending.settings.name, pending.mark, pending.state) == ("vision.rarms-0123456789ab", None, RunState.OFF)
    assert pending.settings.reserve == 0

    do(host, mark, *rest, rename)
    (made,) = host.observe().partitions
    assert made.id == pending.id
    assert made.settings.name == "vision"
    assert made.mark is not None
    assert (made.mark.application, made.mark.name, made.mark.machine) == ("robot", "vision", made.id[:8])


def test_readings_are_those_of_the_observed_state(room: Room) -> None:
    room.furnish(*making(reserve=40), start())
    host = room.host()

    state = host.observe()

    for address in (VISION, Address(partition="nobody"), Address(task="games")):
        assert host.read(address, SCOPE) == readings(state, address, SCOPE)
    assert host.read(VISION, SCOPE)["reserve"] == 40


def test_task_class_readings_equal_observed_state(windows: Room) -> None:
    host = windows.host()
    do(host, *making())
    do(host, WriteTaskClass(task="MotionControl", inside="vision", values=VALUES))
    addresses = [
        Address(task="games"),
        Address(partition="vision", task="motioncontrol"),
        Address(partition="nobody", task="Games"),
    ]

    state = host.observe()

    for address in addresses:
        assert host.read(address, SCOPE) == readings(state, address, SCOPE)
    assert host.read(Address(partition="vision", task="MotionControl"), SCOPE)["value:Priority"] == "dword:6"


@pytest.mark.parametrize(
    ("operation", "expected"),
    [
        (set_to("vision", reserve=30, limit=90, weight=7), {"reserve": 30, "limit": 90, "weight": 7}),
        (set_to("vision", processors=1), {"processors": 1}),
        (set_to("vision", memory=32 * MIB), {"memory": 32 * MIB}),
        (
            set_to(
                "vision",
                start_action=StartAction.START,
                stop_action=StopAction.SHUT_DOWN,
                checkpoints=Checkpoints.DISABLED,
            ),
            {"start_action": "start", "stop_action": "shut_down", "checkpoints": "disabled"},
        ),
        (StartPartition(partition="vision"), {"running": True, "state": "running"}),
        (StopPartition(partition="vision", grace_ms=120_000), {"running": False, "state": "off"}),
        (RenamePartition(partition="vision", name="eyes"), {"name": "eyes", "mark": "robot/vision"}),
        (
            WriteMark(partition="vision", application="robot", name="vision", set="b" * 12),
            {"mark": "robot/vision", "set": "b" * 12},
        ),
        (RemovePartition(partition="vision"), {"exists": False}),
        (EraseMark(partition="vision"), {"exists": False}),
    ],
    ids=lambda value: value.kind if hasattr(value, "kind") else "",
)
def test_operation_does_what_it_says_and_nothing_else(
    room: Room, operation: Operation, expected: Mapping[str, bool | int | str]
) -> None:
    room.furnish(*making(), *making("speech"))
    host = room.host()
    before, other = dict(host.read(VISION, SCOPE)), host.read(Address(partition="speech"), SCOPE)

    do(host, operation)

    after = room.host().read(VISION, SCOPE)
    assert after == (expected if "exists" in expected else {**before, **expected})
    assert host.read(Address(partition="speech"), SCOPE) == other


@pytest.mark.parametrize(
    ("operation", "expected"),
    [
        (set_to("vision", memory=32 * MIB, dynamic_memory=True), {"memory": 32 * MIB, "dynamic_memory": True}),
        (set_to("vision", secure_boot="off"), {"secure_boot": "off"}),
    ],
    ids=lambda value: value.kind if hasattr(value, "kind") else "",
)
def test_what_only_a_virtual_machine_has_is_set(
    windows: Room, operation: Operation, expected: Mapping[str, bool | int | str]
) -> None:
    host = windows.host()
    do(host, *making())
    before = host.read(VISION, SCOPE)

    do(host, operation)

    assert windows.host().read(VISION, SCOPE) == {**before, **expected}


def test_disk_outlives_machine_until_nobody_has_it(windows: Room) -> None:
    host = windows.host()
    do(
        host,
        CreatePartition(partition="vision", generation=2, memory=512 * MIB, image="D:\\robot.vhdx", vm_path="D:\\vms"),
    )
    (disk,) = host.observe().disks
    at = Address(partition="vision", disk=disk.path.upper())
    assert disk.path == f"D:\\vms\\vision\\vision-{SCOPE.plan}.vhdx"
    assert host.read(at, SCOPE) == {"exists": True, "parent": "D:\\robot.vhdx", "used": True}
    removal = RemoveDisk(partition="vision", path=disk.path, parent=disk.parent)
    with pytest.raises(HostRefused, match="in use"):
        do(host, removal)

    do(host, RemovePartition(partition="vision"))
    assert host.read(at, SCOPE) == {"exists": True, "parent": "D:\\robot.vhdx", "used": False}
    do(host, removal)

    assert windows.host().observe().disks == ()
    assert host.read(at, SCOPE) == {"exists": False}
    with pytest.raises(HostRefused, match="does not exist"):
        do(host, removal)


def test_task_class_is_written_recorded_forgotten_and_removed(windows: Room) -> None:
    host = windows.host()
    before = host.observe()
    address = Address(task="MotionControl")

    do(host, WriteTaskRecord(task="MotionControl", inside="", record=RECORD))
    assert host.read(address, SCOPE) == {
        "exists": False,
        "values": "",
        "record": "robot",
        "robot": "robot-7",
        "set": "a" * 12,
    }
    do(host, WriteTaskClass(task="MotionControl", inside="", values=VALUES))
    assert host.read(address, SCOPE)["value:Priority"] == "dword:6"
    do(host, RemoveTaskClass(task="motioncontrol", inside=""))
    do(host, EraseTaskRecord(task="MOTIONCONTROL", inside="", application="robot"))

    assert host.observe() == before


def _responsiveness(percent: int) -> WriteTaskClass:
    value = RegistryValue(kind=ValueKind.DWORD, data=percent)
    return WriteTaskClass(task=SYSTEM_RESPONSIVENESS, inside="", values={SYSTEM_RESPONSIVENESS: value})


def test_responsiveness_is_written_recorded_forgotten_and_taken_away(windows: Room) -> None:
    host = windows.host()
    before = host.observe()
    address, twenty = Address(responsiveness=True), RegistryValue(kind=ValueKind.DWORD, data=20)
    assert before.responsiveness == Responsiveness(value=twenty)

    do(host, WriteTaskRecord(task=SYSTEM_RESPONSIVENESS, inside="", record=RECORD))
    do(host, _responsiveness(10))
    assert host.read(address, SCOPE) == {
        "exists": True,
        "values": "systemresponsiveness",
        "value:SystemResponsiveness": "dword:10",
        "record": "robot",
        "robot": "robot-7",
        "set": "a" * 12,
    }
    with pytest.raises(HostRefused, match="belongs to the application robot"):
        do(host, EraseTaskRecord(task=SYSTEM_RESPONSIVENESS, inside="", application="kiosk"))
    with pytest.raises(HostRefused, match="32-bit"):
        do(host, _responsiveness(2**32))
    removal = RemoveTaskClass(task=SYSTEM_RESPONSIVENESS, inside="")
    do(host, removal)
    assert host.read(address, SCOPE)["exists"] is False
    with pytest.raises(HostRefused, match="SystemResponsiveness does not exist"):
        do(host, removal)
    do(host, _responsiveness(20), EraseTaskRecord(task=SYSTEM_RESPONSIVENESS, inside="", application="robot"))

    assert host.observe() == before


def test_shipped_class_that_is_written_keeps_its_key(windows: Room) -> None:
    host = windows.host()

    do(host, WriteTaskClass(task="pro audio", inside="", values=VALUES))

    assert [task.values for task in host.observe().tasks if task.name == "Pro Audio"] == [VALUES]
    assert len(host.observe().tasks) == 8


def test_each_guest_has_its_own_classes(windows: Room) -> None:
    host = windows.host()
    do(host, *making("vision"), *making("speech"))

    do(host, RemoveTaskClass(task="Games", inside="vision"))

    with_games = [task.inside for task in host.observe().tasks if task.name == "Games"]
    assert with_games == ["", "speech"]


# Which machine a name stands for


def test_unmarked_namesake_is_not_ours(room: Room) -> None:
    room.furnish(*making(), EraseMark(partition="vision"))
    host = room.host()
    (stranger,) = host.observe().partitions

    assert host.read(VISION, SCOPE) == NOTHING
    assert re.search(
        "no (machine|control group) is managed as the partition vision",
        refusal_of(host, StartPartition(partition="vision")),
    )

    do(host, *making(reserve=40))
    assert stranger in host.observe().partitions
    assert host.read(VISION, SCOPE)["reserve"] == 40


def test_id_reaches_machine_that_is_not_ours(room: Room) -> None:
    room.furnish(*making(), EraseMark(partition="vision"))
    host = room.host()
    (stranger,) = host.observe().partitions

    do(host, WriteMark(partition="vision", machine=stranger.id, application="robot", name="vision", set="c" * 12))

    assert host.read(VISION, SCOPE)["set"] == "c" * 12
    do(host, EraseMark(partition="vision"))
    assert host.read(replace(VISION, machine=stranger.id), SCOPE)["mark"] == ""


def test_two_machines_with_one_mark_count_for_none(room: Room) -> None:
    room.furnish(*making("vision"), *making("speech"))
    host = room.host()
    speech = next(partition for partition in host.observe().partitions if partition.settings.name == "speech")

    do(host, WriteMark(partition="speech", machine=speech.id, application="robot", name="vision", set="c" * 12))

    assert [partition.mark for partition in host.observe().partitions] == [None, None]
    assert {partition.foreign_mark for partition in host.observe().partitions} == {
        "2 machines have the mark of robot/vision"
    }
    assert re.search("no (machine|control group) is managed", refusal_of(host, start()))


def test_plan_knows_only_its_own_pending_machine(room: Room) -> None:
    host = room.host()
    do(host, creation())
    other = replace(SCOPE, plan="ffffffffffff")

    assert host.read(VISION, SCOPE)["exists"] is True
    assert host.read(VISION, other) == NOTHING
    assert re.search("a partition vision already exists", refusal_of(host, creation()))


def test_marked_and_pending_machine_are_one_too_many(room: Room) -> None:
    room.furnish(*making())
    host = room.host()
    host.execute(creation("speech"), SCOPE)
    speech = next(partition for partition in host.observe().partitions if partition.settings.name.startswith("speech"))

    do(host, RenamePartition(partition="speech", machine=speech.id, name=SCOPE.pending("vision")))

    assert host.read(VISION, SCOPE) == {"exists": True, "machines": 2}
    assert re.search("2 (machines|control groups) are managed as the partition vision", refusal_of(host, start()))


# What is refused


@pytest.mark.parametrize(
    ("operation", "message"),
    [
        (set_to("vision", processors=1), "its processors can only change while it is off"),
        (set_to("vision", memory=512 * MIB, dynamic_memory=True), "switching between static and dynamic memory"),
        (set_to("vision", stop_action=StopAction.SAVE), "its stop action can only change while it is off"),
        (set_to("vision", secure_boot="off"), "secure boot can only change while it is off"),
        (RemovePartition(partition="vision"), "only a (machine|partition) that is off can be removed"),
    ],
)
def test_what_needs_a_machine_that_is_off(windows: Room, operation: Operation, message: str) -> None:
    host = windows.host()
    do(host, *making(), start())

    assert re.search(f"is running; .*{message}", refusal_of(host, operation))

    do(host, StopPartition(partition="vision", grace_ms=120_000), operation)


def test_generation_1_has_no_secure_boot(windows: Room) -> None:
    _, *rest = making()
    host = windows.host()
    do(host, replace(creation(), generation=1), *rest)

    assert "has generation 1, which does not have" in refusal_of(host, set_to("vision", secure_boot="off"))


def test_the_startup_memory_of_a_running_dynamic_machine(windows: Room) -> None:
    host = windows.host()
    do(host, *making(dynamic=True), start())

    assert re.search(
        "startup memory of a dynamic machine",
        refusal_of(host, set_to("vision", memory=256 * MIB, dynamic_memory=True)),
    )


@pytest.mark.parametrize(
    ("described", "possible"),
    [
        ({}, True),
        ({"windows_build": 14393}, True),
        ({"windows_build": 14392}, False),
        ({"windows_build": 10240, "client": True}, True),
        ({"windows_build": 9600, "client": True}, False),
        ({"guest_windows_build": 9600}, False),
    ],
)
def test_the_memory_of_a_running_static_machine(windows: Room, described: dict[str, object], possible: bool) -> None:
    host = windows.host(**described)
    do(host, *making(), start())
    operation = set_to("vision", memory=256 * MIB)

    if possible:
        do(host, operation)
        assert host.read(VISION, SCOPE)["memory"] == 256 * MIB
    else:
        assert re.search("its memory can only change while it is off", refusal_of(host, operation))


def test_running_machine_does_not_grow_beyond_host(room: Room) -> None:
    room.furnish(*making(), start())
    host = room.host()

    assert re.search("needs 8 GiB; 4 GiB of 4 GiB are free", refusal_of(host, set_to("vision", memory=8192 * MIB)))


@pytest.mark.parametrize(
    ("operation", "message"),
    [
        (set_to("vision", reserve=-1, limit=100, weight=100), "reserve and limit are 0 to 100 %"),
        (set_to("vision", reserve=0, limit=101, weight=100), "reserve and limit are 0 to 100 %"),
        (set_to("vision", reserve=0, limit=100, weight=0), "a weight is 1 to 10000"),
        (set_to("vision", reserve=0, limit=100, weight=10_001), "a weight is 1 to 10000"),
        (RenamePartition(partition="vision", name=""), "a (machine|partition)'s name has 1 to 100 characters"),
    ],
)
def test_what_no_machine_can_have(room: Room, operation: Operation, message: str) -> None:
    room.furnish(*making())
    host = room.host()

    assert re.search(message, refusal_of(host, operation))


@pytest.mark.parametrize(
    ("operation", "message"),
    [
        (set_to("vision", processors=0), "has 1 to 240 virtual processors"),
        (set_to("vision", processors=241), "has 1 to 240 virtual processors"),
        (
            set_to("vision", reserve=41, limit=40, weight=100),
            "the reserve of 41 % is above the limit of 40 %",
        ),
        (set_to("vision", memory=0), "at least 32 MiB, not 0 B"),
        (
            set_to("vision", memory=33 * MIB),
            "a machine has an even number of MiB, at least 32 MiB, not 33 MiB",
        ),
        (CreatePartition(partition="x", generation=3, memory=32 * MIB), "generation 3 does not exist"),
        (RemoveTaskClass(task="Nothing", inside=""), "task class Nothing does not exist"),
        (WriteTaskClass(task="a\\b", inside="", values=VALUES), "a key's name has"),
        (
            WriteTaskClass(task="x", inside="", values={"p": RegistryValue(kind=ValueKind.DWORD, data=2**32)}),
            "p is not a 32-bit number",
        ),
        (
            WriteTaskClass(task="x", inside="", values={"p": RegistryValue(kind=ValueKind.SZ, data=1)}),
            "p is not text",
        ),
        (WriteTaskClass(task="x", inside="nobody", values=VALUES), "no machine is managed as the partition nobody"),
    ],
)
def test_what_no_virtual_machine_can_have(windows: Room, operation: Operation, message: str) -> None:
    host = windows.host()
    do(host, *making())

    assert re.search(message, refusal_of(host, operation))


def test_the_record_of_another_application_stays(windows: Room) -> None:
    host = windows.host()
    do(host, WriteTaskRecord(task="x", inside="", record=replace(RECORD, application="kiosk")))

    assert re.search(
        "belongs to the application kiosk", refusal_of(host, WriteTaskRecord(task="X", inside="", record=RECORD))
    )
    assert re.search(
        "belongs to the application kiosk", refusal_of(host, EraseTaskRecord(task="x", inside="", application="robot"))
    )


def test_too_much_reserve_is_only_noticed_at_start(room: Room) -> None:
    room.furnish(*making("vision", reserve=60), *making("speech", reserve=50), start("vision"))
    host = room.host()

    assert re.search(
        "the reserve of speech, 50 % of each of 2 processors, does not fit on 2 logical processors",
        refusal_of(host, start("speech")),
    )

    do(host, set_to("speech", reserve=40, limit=100, weight=100), start("speech"))
    do(host, set_to("speech", reserve=100, limit=100, weight=100))


def test_reserves_are_placed_whole_onto_processors(windows: Room) -> None:
    host = windows.host()
    for name in ("a", "b", "c"):
        do(host, *making(name, processors=1, reserve=60))

    do(host, start("a"), start("b"))
    assert re.search("does not fit", refusal_of(host, start("c")))


def test_too_many_processors_start_only_without_reserve(room: Room) -> None:
    room.furnish(*making(processors=3, reserve=1))
    host = room.host()

    assert re.search("3 (virtual )?processors with a reserve; (there are|the host has) 2", refusal_of(host, start()))

    do(host, set_to("vision", reserve=0, limit=100, weight=100), start())


def test_missing_memory_is_noticed_at_start(room: Room) -> None:
    room.furnish(*making("vision", memory=3072 * MIB), *making("speech", memory=1026 * MIB), start("vision"))
    host = room.host()

    assert re.search("speech needs 1.002 GiB; 1 GiB of 4 GiB are free", refusal_of(host, start("speech")))


def test_under_root_scheduler_reserves_are_stored_without_effect(windows: Room) -> None:
    host = windows.host(scheduler=SchedulerType.ROOT)
    do(host, *making("vision", reserve=100), *making("speech", reserve=100), start("vision"), start("speech"))

    assert [partition.settings.reserve for partition in host.observe().partitions] == [100, 100]


def test_without_rights_nothing_is_seen_and_nothing_done(windows: Room) -> None:
    do(windows.host(), *making())
    before = files(windows.folder)
    host = windows.host(administrator=False)

    state = host.observe()

    assert (state.facts.rights, state.partitions) == (Rights.MISSING, ())
    assert {task.inside for task in state.tasks} == {""}
    for operation in (creation("speech"), start(), WriteTaskClass(task="x", inside="", values=VALUES)):
        assert re.search("access to onboard is denied", refusal_of(host, operation))
    assert files(windows.folder) == before


# Faults


def fault(effect: FaultEffect, *, at: str = "*", times: int | None = None, delay: int = 0) -> dict[str, object]:
    fault = Fault(operation="start_partition", at=at, effect=effect, times=times, delay=Milliseconds(Fraction(delay)))
    return {"faults": {"stubborn": fault}}


def test_a_fault_refuses_so_often_across_processes(windows: Room) -> None:
    do(windows.host(), *making())

    for _ in range(2):
        host = windows.host(**fault(FaultEffect.REFUSE, times=2))
        assert re.search("the fault stubborn refuses start_partition", refusal_of(host, start()))

    do(windows.host(**fault(FaultEffect.REFUSE, times=2)), start())
    assert windows.host().read(VISION, SCOPE)["running"] is True


def test_a_fault_fails_after_doing(windows: Room) -> None:
    host = windows.host(**fault(FaultEffect.FAIL_AFTER))
    do(host, *making())

    with pytest.raises(HostFailed, match="the fault stubborn makes start_partition fail"):
        do(host, start())

    assert host.read(VISION, SCOPE)["running"] is True


def test_fault_strikes_only_where_it_is_asked_to(windows: Room) -> None:
    host = windows.host(**fault(FaultEffect.REFUSE, at="partition/speech"))
    do(host, *making("vision"), *making("speech"), start("vision"))

    assert re.search("the fault stubborn", refusal_of(host, start("speech")))


def test_a_late_answer_comes_after_the_deed(tmp_path: Path) -> None:
    settings = replace(SimulatedHost(), **fault(FaultEffect.LATE, delay=1500))  # type: ignore[arg-type]  # by name
    waited: list[float] = []
    host = SimulatedHostProvider(builders.a_host(settings=settings), tmp_path / "onboard.json", waited.append)

    do(host, *making(), start())

    assert waited == [1.5]
    assert host.read(VISION, SCOPE)["running"] is True


# Lock and journal


def test_a_journal_reads_back_as_written(room: Room) -> None:
    host = room.host()
    started = a_run(host.observe())
    records = [
        StepRecorded(number=0, status=StepStatus.BEGUN),
        StepRecorded(number=0, status=StepStatus.CHANGED),
        StepRecorded(number=1, status=StepStatus.UNCHANGED),
    ]

    host.start_run(started)
    for record in records:
        host.record(record)

    journal = room.host().journal()
    assert journal is not None
    assert (journal.started, journal.steps, journal.unfinished) == (started, tuple(records), True)
    host.record(RunClosed(closing=Closing.DONE))
    closed = room.host().journal()
    assert closed is not None
    assert not closed.unfinished


def test_run_raises_serial_in_write_that_starts_it(room: Room) -> None:
    host = room.host()
    host.start_run(a_run(host.observe()))
    host.start_run(a_run(host.observe(), serial=2))

    assert dict(room.host().observe().serials) == {"robot": 2}


def test_one_holder_at_a_time(room: Room) -> None:
    first, second = room.host(), room.host()
    with first.lock("ann@lab, process 7"):
        with pytest.raises(HostLocked) as locked, second.lock("bob@lab"):
            pytest.fail("two hold the host")
        assert locked.value.owner == "ann@lab, process 7"
        assert second.observe().partitions == ()

    with second.lock("bob@lab"):
        pass


# What only the simulated host keeps: its file, and states that no test asks a host for


def simulated(folder: Path) -> SimulatedHostProvider:
    return SimulatedHostProvider(builders.a_host(), folder / ".rarms/hosts/onboard.json")


@pytest.mark.parametrize("state", [RunState.PAUSED, RunState.SAVED, RunState.BUSY, RunState.CRITICAL])
def test_neither_running_nor_off_is_not_off(tmp_path: Path, state: RunState) -> None:
    host = simulated(tmp_path)
    do(host, *making())
    (machine,) = host.load().machines.values()
    host.save(host.load().with_machine(machine.now(state)))

    assert host.read(VISION, SCOPE)["state"] == state.value
    for operation in (set_to("vision", processors=1), set_to("vision", memory=32 * MIB)):
        assert re.search(f"is {state.value}; .* while it is off", refusal_of(host, operation))
    cpu = set_to("vision", reserve=10, limit=20, weight=30)
    if state is RunState.SAVED:
        assert re.search("is saved; its reserve can only change while it is off", refusal_of(host, cpu))
    else:
        do(host, cpu)


@pytest.mark.parametrize("state", [RunState.PAUSED, RunState.SAVED])
def test_paused_or_saved_machine_starts_and_stops(tmp_path: Path, state: RunState) -> None:
    host = simulated(tmp_path)
    do(host, *making())
    (machine,) = host.load().machines.values()

    for operation, after in (
        (start(), RunState.RUNNING),
        (StopPartition(partition="vision", grace_ms=120_000), RunState.OFF),
    ):
        host.save(host.load().with_machine(machine.now(state)))
        do(host, operation)
        assert host.read(VISION, SCOPE)["state"] == after.value


def damage(path: Path, old: bytes, new: bytes) -> None:
    data = path.read_bytes()
    assert old in data
    path.write_bytes(data.replace(old, new, 1))


def test_a_damaged_journal_is_said_to_be_damaged(tmp_path: Path) -> None:
    host = simulated(tmp_path)
    host.start_run(a_run(host.observe()))
    host.record(StepRecorded(number=0, status=StepStatus.BEGUN))
    damage(tmp_path / ".rarms/hosts/onboard.journal.jsonl", b"ann@lab", b"eve@lab")

    with pytest.raises(HostDamaged, match=r"onboard.journal.jsonl is damaged in line 1"):
        host.journal()
    with pytest.raises(HostDamaged):
        host.observe()


def test_run_is_under_way_until_it_is_closed(tmp_path: Path) -> None:
    host = simulated(tmp_path)
    assert host.unfinished() is None

    host.start_run(a_run(host.observe()))
    assert host.unfinished() == host.journal()
    host.record(StepRecorded(number=0, status=StepStatus.BEGUN))
    assert host.unfinished() == host.journal()
    host.record(RunClosed(closing=Closing.DONE))

    assert host.unfinished() is None
    assert host.journal() is not None


def test_a_torn_end_closes_no_run(tmp_path: Path) -> None:
    host = simulated(tmp_path)
    host.start_run(a_run(host.observe()))
    host.record(RunClosed(closing=Closing.DONE))
    path = tmp_path / ".rarms/hosts/onboard.journal.jsonl"
    path.write_bytes(path.read_bytes()[:-20])

    assert host.unfinished() == host.journal()


def test_what_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / ".rarms").write_bytes(b"a file where the folder should be")
    host = simulated(tmp_path)

    with pytest.raises(HostFailed, match=r"cannot be written: (?!\[)"):
        host.save(empty("onboard"))
    with pytest.raises(HostFailed, match="cannot be written"), host.lock("ann@lab"):
        pytest.fail("held in a folder that is none")
    with pytest.raises(HostFailed, match="cannot be written"):
        host.record(StepRecorded(number=0, status=StepStatus.BEGUN))


def test_an_overcommitted_host_still_lets_a_machine_shrink(tmp_path: Path) -> None:
    do(simulated(tmp_path), *making("vision", memory=3072 * MIB), start())
    shrunk = SimulatedHostProvider(builders.a_host(memory="1 GiB"), tmp_path / ".rarms/hosts/onboard.json")

    do(shrunk, set_to("vision", memory=2048 * MIB))

    assert shrunk.read(VISION, SCOPE)["memory"] == 2048 * MIB
