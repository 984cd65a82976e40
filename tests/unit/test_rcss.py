"""A component's thread in its task class: on Linux for real, on Windows (wine) with an avrt.dll of the tests' own."""

import json
import os
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac import rcss
from rarms_iac.model.run import Call, Field, Samples
from rarms_iac.planner.task_classes import classes_of
from rarms_iac.providers.measuring import PartitionWork
from rarms_iac.rcss import CLASSES_VARIABLE, CannotJoin, robotic_task
from rarms_iac.running.component import ComponentRun
from rarms_iac.running.orders import CannotStart, ProcessPlace, StartContext
from tests.builders import a_component
from tests.needs import CHECKOUT
from tests.planning import PLACES
from tests.unit.running.programs import a_run

if sys.platform == "linux":
    from rarms_iac.providers.cgroups.measuring import class_environment, class_words

AVRT = CHECKOUT / ".cache" / "windows" / "avrt" / "avrt.dll"
CLASSES = {"SpeechRecognition": {"priority": 21, "affinity": 1}, "Localization": {"priority": 99999, "affinity": 0}}
EXPLAINED = {1550: "restart that", 1551: "task index 0", 1552: "Leave it first", 1314: "scheduling priority"}


@pytest.fixture
def classes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Task classes as they are on either system."""
    monkeypatch.setenv(CLASSES_VARIABLE, json.dumps(CLASSES))
    monkeypatch.setattr(rcss, "_AVRT", str(AVRT))


on_linux = pytest.mark.needs("linux", "root")
everywhere = pytest.mark.parametrize("name", ["SpeechRecognition", "speechrecognition"])


def scheduling() -> tuple[int, int, set[int]]:
    """How the calling thread is scheduled."""
    assert sys.platform == "linux"
    return os.sched_getscheduler(0), os.sched_getparam(0).sched_priority, os.sched_getaffinity(0)


@on_linux
@everywhere
def test_linux_thread_has_priority_while_member(name: str, classes: None) -> None:
    seen: list[tuple[int, int, set[int]]] = []
    before = scheduling()

    def work() -> None:
        with robotic_task(name):
            seen.append(scheduling())
        seen.append(scheduling())

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()

    assert sys.platform == "linux"
    assert seen == [(os.SCHED_FIFO, 21, {0}), before]
    assert scheduling() == before


@on_linux
def test_linux_gives_classes_to_started_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    parts = [a_component("speech", criticality=9, task="SpeechRecognition"), a_component("log", criticality=1)]
    classes = classes_of(parts, {}, "talk", PLACES, processors=2).classes
    part = PartitionWork(partition="talk", components=tuple(parts), classes=classes)

    monkeypatch.setenv(CLASSES_VARIABLE, class_environment(part)[CLASSES_VARIABLE])
    with robotic_task("SpeechRecognition"):
        joined = scheduling()[1]

    assert class_words(parts[0], classes)[-3:] == ("chrt", "--fifo", str(joined))
    assert class_words(parts[1], classes) == ()
    assert class_environment(replace(part, deadline_period_us=1000)) == {}


@on_linux
def test_linux_member_always_leaves_its_class(
    classes: None,
) -> None:
    before = scheduling()

    with pytest.raises(KeyError), robotic_task("SpeechRecognition"):
        raise KeyError
    with pytest.raises(CannotJoin, match="priority 99999 on the processors 0x0: Invalid argument"):
        robotic_task("Localization").__enter__()

    assert scheduling() == before


@on_linux
def test_linux_account_lacks_a_named_privilege() -> None:
    program = (
        "import os\nfrom rarms_iac import rcss\nos.setresuid(65534, 65534, 65534)\n"
        "try:\n    rcss.robotic_task('SpeechRecognition').__enter__()\n"
        "except rcss.CannotJoin as problem:\n    print(problem.code, problem.task)"
    )
    words = [sys.executable, "-c", program]
    environment = {**os.environ, CLASSES_VARIABLE: json.dumps(CLASSES)}

    ran = subprocess.run(words, env=environment, cwd=CHECKOUT, capture_output=True, text=True)

    assert ran.stdout == "1314 SpeechRecognition\n", ran.stderr


@pytest.mark.needs("linux")
@pytest.mark.parametrize("text", ["[]", "{", '{"SpeechRecognition": 5}', '{"SpeechRecognition": {"priority": 5}}'])
def test_on_linux_variable_of_another_form_is_told(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CLASSES_VARIABLE, text)

    with pytest.raises(CannotJoin, match="cannot be read"):
        robotic_task("SpeechRecognition").__enter__()


@pytest.mark.needs("windows")
@everywhere
def test_windows_member_leaves_before_joining_again(name: str, classes: None) -> None:
    joined = 0
    for _ in range(2):
        with robotic_task(name):
            joined += 1

    assert joined == 2


@pytest.mark.needs("windows")
@pytest.mark.parametrize("code", EXPLAINED)
def test_on_windows_each_error_is_explained(code: int, classes: None) -> None:
    with pytest.raises(CannotJoin, match=EXPLAINED[code]) as raised:
        robotic_task(f"Error{code}").__enter__()

    assert raised.value.code == code


@pytest.mark.needs("windows")
def test_windows_error_is_told_in_its_words(classes: None) -> None:
    with pytest.raises(CannotJoin, match=r"\(5\): .*ccess"):
        robotic_task("Error5").__enter__()


def test_a_class_that_is_not_there_is_told(classes: None) -> None:
    with pytest.raises(CannotJoin, match=r'cannot join the task class "Dancing" \(1550\): nothing here defines it'):
        robotic_task("Dancing").__enter__()


@pytest.mark.parametrize("name", ["SpeechRecognition", "Dancing"])
def test_a_thread_has_one_class_at_a_time(name: str, classes: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rcss, "_join", lambda _: lambda: None)

    with robotic_task("SpeechRecognition"), pytest.raises(CannotJoin) as raised:
        robotic_task(name).__enter__()

    assert (raised.value.code, raised.value.task) == (1552, name)
    with robotic_task(name):
        pass


JOB = """
import os, sys
def job():
    if sys.platform == "win32":
        import ctypes
        avrt = ctypes.WinDLL("avrt", use_last_error=True)
        avrt.AvSetMmThreadCharacteristicsW("Error5", ctypes.byref(ctypes.c_uint32(0)))
        return {"joined": ctypes.get_last_error() == 1552}
    return {"joined": os.sched_getscheduler(0) == os.SCHED_FIFO}
"""
SITE = f"""
import ctypes
real = getattr(ctypes, "WinDLL", None)
ctypes.WinDLL = lambda name, **options: real({str(AVRT)!r} if name == "avrt" else name, **options)
"""
"""Read by the caller's Python as it starts: it loads the tests' library."""


@pytest.mark.needs(*(["root"] if sys.platform == "linux" else ["windows"]))
@pytest.mark.parametrize("task", ["speechrecognition", ""])
def test_runner_of_call_joins_in_thread_that_calls(task: str, tmp_path: Path) -> None:
    (tmp_path / "job.py").write_text(JOB, encoding="utf-8")
    (tmp_path / "sitecustomize.py").write_text(SITE, encoding="utf-8")
    around = {CLASSES_VARIABLE: json.dumps(CLASSES), "PYTHONPATH": str(tmp_path)}
    context = StartContext(base=tmp_path, inside=ProcessPlace(task=task, environment=around))
    succeeded = Samples(source="json_lines", success=Field(field="joined"))

    with ComponentRun("speech", a_run(Call(module="job", function="job"), samples=succeeded), context) as running:
        samples = list(running)

    assert [(sample.failure, sample.successful) for sample in samples] == [("", bool(task))] * 3


def test_call_without_class_is_not_started(tmp_path: Path) -> None:
    (tmp_path / "job.py").write_text(JOB, encoding="utf-8")
    (tmp_path / "sitecustomize.py").write_text(SITE, encoding="utf-8")
    place = ProcessPlace(task="Dancing", environment={"PYTHONPATH": str(tmp_path)})
    run = a_run(Call(module="job", function="job"))

    with (
        pytest.raises(CannotStart, match='cannot join the task class "Dancing"'),
        ComponentRun("speech", run, StartContext(base=tmp_path, inside=place)) as running,
    ):
        list(running)
