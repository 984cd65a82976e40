import os
from dataclasses import fields, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.model.host import ProviderKind, SchedulerType
from rarms_iac.model.loads import Browser, CommandLoad
from rarms_iac.model.run import (
    AttachedService,
    Container,
    Elapsed,
    Periodic,
    Process,
    Run,
    SampleCount,
    Samples,
    Service,
    Stop,
    TimeField,
)
from rarms_iac.model.setting import EnvironmentSetup
from rarms_iac.model.system import Component, RunsOn, Simulation, TaskCategory, TaskRequest
from rarms_iac.storage.datalog.identity import LogSubject, PartialPlatform, compare_header, identity_of
from rarms_iac.storage.datalog.log import Identity
from rarms_iac.storage.datalog.named_files import Files, file_digest
from tests.builders import a_component, a_cpu, a_run, at_most, memory, milliseconds
from tests.builders_measured import a_bench, a_header, a_subject


def identity(subject: LogSubject) -> Identity:
    return identity_of(subject, {}, {})


def vision(**changes: Any) -> Component:
    component = a_component(run=a_run(), apt={"mean_response_time": at_most(100)}, reserve=None)
    simulated = Simulation(work=milliseconds("61.6 ms"))
    return replace(component, **{"simulation": simulated, "task": "ObjectIdentification", **changes})


def changed(now: LogSubject, was: LogSubject | None = None) -> list[str]:
    header = a_header(was or a_subject(vision()))
    return list(map(str, compare_header(header, header.setup.members, identity(now), a_bench()).changed))


def test_nothing_changed_is_not_stale() -> None:
    assert changed(a_subject(vision())) == []


def test_what_changed_is_named_with_what_it_was() -> None:
    now = vision(simulation=Simulation(work=milliseconds("70 ms")), task="SpeechRecognition")

    assert changed(a_subject(now)) == [
        "vision.simulation.work: 61.6 ms -> 70 ms",
        "vision.task: ObjectIdentification -> SpeechRecognition",
    ]


OF_A_RUN: dict[str, object] = {
    "command": ("look",),
    "call": "components.vision:look",
    "attach": AttachedService(service="nav2"),
    "container": Container(image="vision:1", engine="podman"),
    "service": Service(exec=("look",)),
    "processes": {"eyes": Process(command=("look",))},
    "user": "robot",
    "groups": ("video",),
    "setup": ("install/setup.bash",),
    "environment": {"MODE": "fast"},
    "folder": "src",
    "until": Elapsed(time=milliseconds("20 s")),
    "timeout": milliseconds("2 s"),
    "stop": Stop(signal="INT"),
    "arrival": Periodic(period=milliseconds("33 ms")),
    "samples": Samples(source="json_lines", response_time=TimeField(field="response", unit="ms")),
    "deadline": milliseconds("50 ms"),
    "failures": 3,
    "success_within": milliseconds("400 ms"),
    "rates_success": False,
}
OF_A_SIMULATION: dict[str, object] = {
    "work": milliseconds("62 ms"),
    "blocked": milliseconds("1 ms"),
    "varies": Fraction(5),
    "threads": 2,
    "success_within": milliseconds("400 ms"),
}


@pytest.mark.parametrize("field", [field_.name for field_ in fields(Run)])
def test_run_fields_are_in_the_identity(field: str) -> None:
    if field == "files":
        assert changed(a_subject(vision(run=replace(a_run(), files=("*.py",))))) == []
        return
    if field == "until":
        assert changed(a_subject(vision(run=a_run(until=SampleCount(samples=300))))) == []
        return
    now = replace(a_run(), **{field: OF_A_RUN[field]})  # type: ignore[arg-type]  # one value for each field
    assert changed(a_subject(vision(run=now)))


@pytest.mark.parametrize("field", [field_.name for field_ in fields(Simulation)])
def test_every_field_of_simulation_is_in_identity(field: str) -> None:
    other = OF_A_SIMULATION.get(field, 77)
    now = replace(Simulation(work=milliseconds("61.6 ms")), **{field: other})  # type: ignore[arg-type]  # as above
    assert changed(a_subject(vision(simulation=now)))


IRRELEVANT: dict[str, object] = {
    "criticality": 99,
    "apt": {"mean_response_time": at_most(50)},
    "cpu": a_cpu(reserve="70 %"),
    "together": ("speech",),
    "apart": ("speech",),
    "dedicated": True,
    "hosts": ("onboard",),
    "runs_on": RunsOn.HOST,
    "interference": "browsers",  # the load itself is the set-up's
    "memory": memory("1 GiB"),  # P1's are the set-up's
    "processors": 1,
    "new": True,
}


@pytest.mark.parametrize("field", [field_.name for field_ in fields(Component)])
def test_thresholds_and_placement_keep_logs_fresh(field: str) -> None:
    if field in {"name", "run", "simulation", "task"}:
        return
    assert changed(a_subject(vision(**{field: IRRELEVANT[field]}))) == []


@pytest.mark.parametrize(("field", "value"), [("processors", 1), ("memory", 2**30), ("limit", 50), ("weight", 200)])
def test_what_p1_is_is_in_the_identity(field: str, value: int) -> None:
    subject = a_subject(vision())
    setup: EnvironmentSetup = replace(subject.setup, **{field: value})  # type: ignore[arg-type]  # each is a number

    assert [field_.partition(":")[0] for field_ in changed(replace(subject, setup=setup))] == [field]


def test_load_and_fixed_class_are_in_identity() -> None:
    task = TaskRequest(name="ObjectIdentification", category=TaskCategory.MEDIUM, priority=5)

    assert changed(a_subject(vision(), load=Browser(instances=5))) == [
        "interference.busy-loop: busy_loop -> browser",
        "interference.busy-loop.instances: not set -> 5",
    ]
    assert changed(a_subject(vision(), tasks={"ObjectIdentification": task}))
    assert changed(a_subject(vision(), tasks={"MotionControl": replace(task, name="MotionControl")})) == []


@pytest.fixture
def files(tmp_path: Path) -> Files:
    (tmp_path / "components").mkdir()
    (tmp_path / "components" / "vision.py").write_bytes(b"look()\nsee()\n")
    (tmp_path / "components" / "model.bin").write_bytes(b"\0\r\n" * 10)
    return Files(tmp_path)


def running(words: tuple[str, ...], *patterns: str, call: str = "") -> LogSubject:
    return a_subject(vision(run=replace(a_run(), command=words, call=call, files=patterns)))


def test_words_modules_and_patterns_name_files_below_manifest(files: Files) -> None:
    by_word = ("python3", "components/vision.py", "--fast")

    assert list(files.of(running(by_word))) == ["components/vision.py"]
    assert list(files.of(running((), call="components.vision:look"))) == ["components/vision.py"]
    assert list(files.of(running(("x",), "components/*"))) == [
        "components/model.bin",
        "components/vision.py",
    ]


def test_outside_path_is_no_file_of_folder(files: Files) -> None:
    outside = files.folder.parent / "elsewhere.py"
    outside.write_bytes(b"")
    words = ("python3", str(outside), "../elsewhere.py", "a\0b", "x" * 5000, "")

    assert files.of(running(words, "../*.py")) == {}


def test_the_programs_of_a_load_count_too(files: Files) -> None:
    load = CommandLoad(command=("python3", "components/vision.py"))

    assert list(files.of(a_subject(vision(run=None), load=load))) == ["components/vision.py"]


def test_line_ends_do_not_change_digests(tmp_path: Path) -> None:
    text, other, binary, odd = (tmp_path / name for name in ("text", "other", "binary", "odd"))
    text.write_bytes(b"one\ntwo\n" * 200_000)
    other.write_bytes(b"one\r\ntwo\r\n" * 200_000)
    binary.write_bytes(b"\0one\r\n")
    odd.write_bytes(b"\0one\n")

    assert file_digest(text) == file_digest(other)
    assert file_digest(binary) != file_digest(odd)
    odd.write_bytes(b"ends in\r")
    assert file_digest(odd) != file_digest(text)


def test_changed_file_makes_stale_missing_one_only_unverified(files: Files) -> None:
    subject = running(("python3", "components/vision.py"), "components/*")
    header = a_header(subject, files.of(subject))
    (files.folder / "components" / "vision.py").write_bytes(b"look(twice)\n")
    (files.folder / "components" / "model.bin").unlink()
    (files.folder / "components" / "new.py").write_bytes(b"")

    now = compare_header(
        header, header.setup.members, identity_of(subject, Files(files.folder).of(subject), {}), a_bench()
    )

    assert list(map(str, now.changed)) == ["file components/new.py is new", "file components/vision.py changed"]
    assert now.unverified == ("components/model.bin",)


def test_an_interpreter_and_a_build_only_warn() -> None:
    header = a_header(a_subject(vision()))
    was = replace(header, identity=replace(header.identity, interpreters={"python3": "aa", "perl": "cc"}))
    now = replace(identity(a_subject(vision())), interpreters={"python3": "bb"})

    found = compare_header(was, was.setup.members, now, replace(a_bench(), os_build=26200))

    assert found.changed == ()
    assert [warn.part for warn in found.warns] == ["program python3", "build of the operating system"]


def test_interpreters_are_found_where_programs_are(files: Files) -> None:
    found = files.interpreters(running(("python3" if os.name == "posix" else "cmd", "x.py")))

    assert len(found) == 1


def test_the_log_of_other_components_is_stale() -> None:
    header = a_header(a_subject(vision()))

    found = compare_header(header, ("speech",), header.identity, a_bench()).changed

    assert list(map(str, found)) == ["components: vision -> speech"]


def test_known_bench_must_match() -> None:
    header, now = a_header(a_subject(vision())), identity(a_subject(vision()))
    other = PartialPlatform(
        provider=ProviderKind.HYPERV,
        logical_processors=4,
        guest_image="guest.vhdx",
        processor="another",
        smt=True,
        scheduler=SchedulerType.CORE,
    )
    unseen = PartialPlatform(provider=ProviderKind.SIMULATED, logical_processors=2, scheduler=SchedulerType.UNKNOWN)

    assert list(map(str, compare_header(header, header.setup.members, now, other).changed)) == [
        "provider: simulated -> hyperv",
        "processor model: simulated -> another",
        "logical processors: 2 -> 4",
        "SMT: off -> on",
        "scheduler: classic -> core",
        "guest image: not set -> guest.vhdx",
    ]
    assert compare_header(header, header.setup.members, now, unseen).changed == ()
