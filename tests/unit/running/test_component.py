"""Where samples come from: lines of JSON, lines that match, runs, calls; and when the next job starts."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.model.run import Call, Field, FromEnvironment, Run, Samples, Stop, TimeField
from rarms_iac.model.series import SkippedLines
from rarms_iac.running.orders import CannotStart, StartContext, SupervisorLost
from rarms_iac.running.samples import SamplingEnd
from rarms_iac.texts.quantities import show_milliseconds
from tests.needs import CHECKOUT, ON_WINDOWS
from tests.unit.running.programs import (
    JSON_LINES,
    PER_RUN,
    a_run,
    all_of,
    component,
    failures,
    ms,
    responses,
    same_everywhere,
)

LASTS = 6000.0 if ON_WINDOWS else 400.0
"""Time enough for an interpreter to start."""

PATTERN = Samples(
    source="pattern",
    pattern=r"^heard .* ok=(?P<ok>[01]) s=(?P<time>[0-9.]+)",
    response_time=TimeField(field="time", unit="s"),
    success=Field(field="ok"),
)


def module(folder: Path, text: str) -> Call:
    (folder / "parts").mkdir()
    (folder / "parts" / "planning.py").write_text(text, encoding="utf-8")
    return Call(module="parts.planning", function="plan")


def test_a_json_line_is_a_sample(tmp_path: Path) -> None:
    run = a_run("for n in range(9): say(json.dumps({'ms': n + 0.5}))\ntime.sleep(60)")

    samples = all_of(run, tmp_path)

    assert responses(samples) == [0.5, 1.5, 2.5]
    assert all(sample.successful and sample.count == 1 for sample in samples)


def test_only_matching_lines_are_samples(tmp_path: Path) -> None:
    lines = ["model loaded", "heard stop ok=1 s=0.25", "", "noise", "heard go ok=0 s=1.5"]
    run = a_run(f"for line in {lines}: say(line)\ntime.sleep(60)", samples=PATTERN, until=2)

    samples = all_of(run, tmp_path)

    assert [(sample.response_ms, sample.successful) for sample in samples] == [(250, True), (1500, False)]


def test_exit_code_is_success_of_a_run(tmp_path: Path) -> None:
    program = (
        "from pathlib import Path\nseen = Path('seen')\nfirst = not seen.exists()\nseen.touch()\n"
        "time.sleep(0.05)\nsys.exit(0 if first else 7)"
    )

    samples = all_of(a_run(program, samples=PER_RUN, until=2), tmp_path)

    assert [sample.successful for sample in samples] == [True, False]
    assert failures(samples) == []
    assert all(50 <= (sample.response_ms or 0) < 5000 for sample in samples)


@same_everywhere
def test_overrun_does_not_shift_the_schedule(tmp_path: Path) -> None:
    program = (
        "from pathlib import Path\nfirst = not Path('seen').exists()\nPath('seen').touch()\n"
        "time.sleep(0.5 if first else 0)"
    )

    samples = all_of(a_run(program, samples=PER_RUN, until=4, every=300), tmp_path)

    assert [round(sample.began_ms) for sample in samples] == [0, 300, 600, 900]
    assert (samples[0].response_ms or 0) >= 500
    assert (samples[1].response_ms or 0) >= 200  # it was due at 300 and could start at 500


def test_a_function_is_called_job_after_job(tmp_path: Path) -> None:
    call = module(tmp_path, "import time\nprint('loading')\ndef plan():\n    print('noise')\n    time.sleep(0.01)\n")

    with component(a_run(call, samples=PER_RUN, until=3), tmp_path) as component_run:
        samples = list(component_run)

    assert all(10 <= (sample.response_ms or 0) < 2000 and sample.successful for sample in samples)
    assert samples[0].began_ms < samples[1].began_ms < samples[2].began_ms
    assert "loading" in component_run.tail
    assert component_run.ending is SamplingEnd.UNTIL


def test_a_periodic_call_counts_from_its_scheduled_start(tmp_path: Path) -> None:
    text = "import time\ntook = [0.25, 0, 0, 0]\ndef plan():\n    time.sleep(took.pop(0))\n"

    samples = all_of(a_run(module(tmp_path, text), samples=PER_RUN, until=4, every=100), tmp_path)

    assert [round(sample.began_ms) for sample in samples] == [0, 100, 200, 300]
    assert [(sample.response_ms or 0) >= least for sample, least in zip(samples, (250, 150, 50, 0), strict=True)] == [
        True
    ] * 4


@same_everywhere
def test_fields_of_what_a_function_returns_are_read(tmp_path: Path) -> None:
    text = "def plan():\n    return {'way': {'found': True}, 'cells': 12}\n"
    samples = Samples(source="json_lines", success=Field(field="way.found"), count=Field(field="cells"))

    found = all_of(a_run(module(tmp_path, text), samples=samples, until=1), tmp_path)

    assert [(sample.successful, sample.count) for sample in found] == [(True, 12)]
    assert found[0].response_ms is not None


@same_everywhere
def test_exception_is_a_failed_sample(tmp_path: Path) -> None:
    text = "turn = [0, 1, 1]\ndef plan():\n    return 1 / turn.pop(0)\n"

    samples = all_of(a_run(module(tmp_path, text), samples=PER_RUN, until=3, failures=1), tmp_path)

    assert [sample.failure for sample in samples] == ["ZeroDivisionError: division by zero", "", ""]
    assert samples[0].response_ms is None


def test_finished_program_is_started_again(tmp_path: Path) -> None:
    samples = all_of(a_run("say('{\"ms\": 1}')\nsay('{\"ms\": 2}')", until=5), tmp_path)

    assert responses(samples) == [1, 2, 1, 2, 1]


def test_a_setting_may_last_a_time(tmp_path: Path) -> None:
    run = a_run("while True:\n    say('{\"ms\": 1}')\n    time.sleep(0.02)", until=LASTS)

    with component(run, tmp_path) as component_run:
        samples = list(component_run)

    assert component_run.ending is SamplingEnd.UNTIL
    assert component_run.series().elapsed_ms == pytest.approx(LASTS)
    assert 0 < len(samples) <= LASTS / 20 + 1
    assert all(sample.began_ms < LASTS for sample in samples)


@same_everywhere
def test_unfinished_last_job_is_no_sample(tmp_path: Path) -> None:
    assert all_of(a_run("time.sleep(60)", samples=PER_RUN, until=200.0), tmp_path) == []


def test_who_reads_samples_may_stop_at_any_moment(tmp_path: Path) -> None:
    run = a_run("while True: say('{\"ms\": 1}')", until=1_000_000)

    with component(run, tmp_path) as component_run:
        assert next(component_run).response_ms == 1
        component_run.close()
        component_run.close()

    assert component_run.ending is SamplingEnd.CLOSED
    assert len(component_run.series().samples) == 1


def test_the_processor_time_of_all_processes_is_told(tmp_path: Path) -> None:
    busy = "t = time.process_time()\nwhile time.process_time() - t < 0.15: pass\n"
    run = a_run(
        f"import subprocess\nsubprocess.run([sys.executable, '-S', '-c', {('import time' + chr(10) + busy)!r}])\n{busy}"
        "say('{\"ms\": 1}')\ntime.sleep(60)",
        until=1,
    )

    with component(run, tmp_path) as component_run:
        list(component_run)

    result = component_run.series().cpu_ms
    if result is None:
        assert sys.platform == "win32"
        pytest.skip("needs posix: this system does not tell the processor time of a job")
    assert 300 <= result < 3000


@same_everywhere
def test_line_without_field_has_no_time(tmp_path: Path) -> None:
    samples = Samples(source="json_lines", count=Field(field="frames"))

    found = all_of(a_run("say('{\"frames\": 3}')\ntime.sleep(9)", samples=samples, until=1), tmp_path)

    assert [(sample.response_ms, sample.successful, sample.count, sample.failure) for sample in found] == [
        (None, True, 3, "")
    ]


def test_samples_may_come_from_standard_error(tmp_path: Path) -> None:
    program = "for n in range(3):\n    say('noise')\n    print(json.dumps({'ms': n}), file=sys.stderr, flush=True)\n"
    samples = replace(JSON_LINES, stream="stderr")

    with component(a_run(program, samples=samples, until=5), tmp_path) as component_run:
        found = responses(list(component_run))

    assert found == [0, 1, 2, 0, 1]
    assert component_run.tail.startswith("noise")


def test_other_lines_between_samples_are_skipped_and_counted(tmp_path: Path) -> None:
    program = "say('loading \\x1b[0m')\nfor n in range(3):\n    say('[12]')\n    say(json.dumps({'ms': n}))\n"

    with component(a_run(program, until=6), tmp_path) as component_run:
        found = list(component_run)

    assert responses(found) == [0, 1, 2, 0, 1, 2]
    assert component_run.skipped == SkippedLines(count=8, first=('"loading <U+001B>[0m"', '"[12]"', '"[12]"'))


PATIENT = 6000 if ON_WINDOWS else 700
"""A time-out that a small program keeps where its interpreter starts at its usual speed."""

GOOD = "say('{\"ms\": 1}')\n"


@same_everywhere
def test_unreadable_line_is_a_failed_sample(tmp_path: Path) -> None:
    samples = all_of(a_run(f"say('{{oops')\n{GOOD}time.sleep(60)", until=2, failures=1), tmp_path)

    assert [(sample.response_ms, sample.successful) for sample in samples] == [(None, False), (1, True)]
    assert failures(samples) == ['not a JSON object: "{oops"']


def test_bytes_that_are_no_text_are_unreadable_line(tmp_path: Path) -> None:
    program = f"os.write(1, b'{{' + bytes(range(256)).replace(b'\\n', b'\\n{{') + b'\\n')\n{GOOD}time.sleep(60)"

    samples = all_of(a_run(program, until=3, failures=2), tmp_path)

    assert [sample.successful for sample in samples] == [False, False, True]  # it holds a line end
    assert all(failure.isprintable() for failure in failures(samples))


@same_everywhere
def test_timeout_counts_from_job_start(tmp_path: Path) -> None:
    program = "from pathlib import Path\ntime.sleep(20)\nPath('whole').touch()"

    samples = all_of(a_run(program, samples=PER_RUN, until=1, timeout=1, failures=1), tmp_path)

    assert failures(samples) == ["no exit within 1 ms"]
    assert not Path(tmp_path, "whole").exists()


@same_everywhere
def test_job_without_answer_is_no_failed_sample(tmp_path: Path) -> None:
    samples = all_of(a_run("say('{\"ms\": null}')\ntime.sleep(60)", until=1), tmp_path)

    assert [(sample.response_ms, sample.successful, sample.failure) for sample in samples] == [(None, False, "")]


@same_everywhere
def test_more_failed_samples_than_allowed_end_the_setting(tmp_path: Path) -> None:
    with component(a_run("while True: say('{oops')", until=100, failures=2), tmp_path) as component_run:
        samples = list(component_run)

    assert len(samples) == 3
    assert component_run.ending is SamplingEnd.FAILURES


def test_other_exit_code_is_a_failed_sample(tmp_path: Path) -> None:
    samples = all_of(a_run(f"{GOOD}sys.exit(3)", until=4, failures=9), tmp_path)

    assert responses(samples) == [1, None, 1, None]
    assert failures(samples) == ["it ended with exit code 3"] * 2


@same_everywhere
def test_program_that_ends_without_sample_is_failed_sample(tmp_path: Path) -> None:
    assert failures(all_of(a_run("say('')", until=2, failures=9), tmp_path)) == ["it ended without a sample"] * 2


@pytest.mark.needs("posix")
@pytest.mark.parametrize("samples", [PER_RUN, Samples(source="json_lines")], ids=["per run", "lines"])
def test_death_by_a_signal_is_a_failed_sample(tmp_path: Path, samples: Samples) -> None:
    found = all_of(a_run("os.kill(os.getpid(), signal.SIGSEGV)", samples=samples, until=1), tmp_path)

    assert [(sample.response_ms, sample.successful, sample.failure) for sample in found] == [
        (None, False, "it was killed by SIGSEGV")
    ]


@same_everywhere
def test_slow_run_is_a_failed_sample(tmp_path: Path) -> None:
    program = "from pathlib import Path\nif not Path('seen').exists():\n    Path('seen').touch()\n    time.sleep(60)"

    samples = all_of(
        a_run(program, samples=PER_RUN, until=2, timeout=PATIENT, failures=1, stop=Stop(signal="KILL")), tmp_path
    )

    assert failures(samples) == [f"no exit within {show_milliseconds(ms(PATIENT))}"]
    assert [sample.successful for sample in samples] == [False, True]


def test_silent_program_is_started_again(tmp_path: Path) -> None:
    samples = all_of(a_run(f"{GOOD}time.sleep(60)", until=3, timeout=PATIENT, failures=1), tmp_path)

    assert [sample.failure for sample in samples] == ["", f"no sample within {show_milliseconds(ms(PATIENT))}", ""]


@same_everywhere
def test_a_function_that_hangs_is_a_failed_sample(tmp_path: Path) -> None:
    (tmp_path / "planning.py").write_text("import time\ndef plan():\n    time.sleep(60)\n", encoding="utf-8")
    run = a_run(Call(module="planning", function="plan"), samples=PER_RUN, until=1, timeout=PATIENT)

    assert failures(all_of(run, tmp_path)) == [f"no sample within {show_milliseconds(ms(PATIENT))}"]


def test_function_that_ends_its_process_is_failed_sample(tmp_path: Path) -> None:
    (tmp_path / "planning.py").write_text("import os\ndef plan():\n    os._exit(9)\n", encoding="utf-8")
    run = a_run(Call(module="planning", function="plan"), samples=PER_RUN, until=1)

    assert failures(all_of(run, tmp_path)) == ["it ended with exit code 9"]


@same_everywhere
def test_line_that_is_too_long_is_failed_sample(tmp_path: Path) -> None:
    program = f"say('x' * 300_000)\n{GOOD}time.sleep(60)"

    samples = all_of(a_run(program, until=2, failures=1), tmp_path)

    assert [sample.failure for sample in samples] == ["a line of more than 64 KiB", ""]


def test_a_line_without_end_ends_the_process(tmp_path: Path) -> None:
    run = a_run("while True: os.write(1, b'x' * 65536)", until=9, failures=1, stop=Stop(signal="KILL"))

    assert failures(all_of(run, tmp_path)) == ["a line of more than 64 KiB", "a line of more than 16 MiB"]


@same_everywhere
def test_flood_of_foreign_lines_ends_the_process(tmp_path: Path) -> None:
    samples = Samples(source="pattern", pattern="^ms=(?P<ms>[0-9]+)", response_time=TimeField(field="ms", unit="ms"))
    run = a_run("while True: os.write(1, (b'x' * 1000 + b'\\n') * 60)", samples=samples, until=9)

    (failure,) = failures(all_of(run, tmp_path))

    assert failure.startswith("more than 16 MiB without a sample; 16778 lines did not match the pattern")


def test_output_that_is_not_read_does_no_harm(tmp_path: Path) -> None:
    program = "for _ in range(300):\n    os.write(1, b'x' * 65536)\n    os.write(2, b'y' * 65536)\nos.write(2, b'end')"

    with component(a_run(program, samples=PER_RUN, until=1), tmp_path) as component_run:
        samples = list(component_run)

    assert [sample.successful for sample in samples] == [True]
    assert len(component_run.tail) <= 4096
    assert component_run.tail.endswith("yend")


def test_environment_is_the_manifests(tmp_path: Path) -> None:
    program = (
        "here = os.environ\nright = here['A'] + here['B'] == 'text secret'\n"
        "say(json.dumps({'ms': here['RARMS_PERIOD_MS'], 'ok': right}))"
    )
    samples = Samples(source="json_lines", response_time=TimeField(field="ms", unit="ms"), success=Field(field="ok"))
    run = a_run(
        program,
        samples=samples,
        until=1,
        every=33.5,
        environment={"A": "text ", "B": FromEnvironment(name="RARMS_TEST_SECRET")},
    )
    own = {**StartContext(base=tmp_path).environment, "RARMS_TEST_SECRET": "secret"}

    with component(run, tmp_path, own) as component_run:
        found = list(component_run)

    assert [(sample.response_ms, sample.successful) for sample in found] == [(33.5, True)]


def test_component_runs_in_its_folder(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "vision.py").write_text(
        "import json, os\nprint(json.dumps({'ms': 1, 'in': os.path.basename(os.getcwd())}))", encoding="utf-8"
    )
    samples = Samples(source="pattern", pattern='"in": "(?P<ok>data)"')

    found = all_of(a_run((sys.executable, "vision.py"), samples=samples, until=1, folder="data"), tmp_path)

    assert failures(found) == []


CANNOT = {
    "program": (a_run(("no-such-program-anywhere",)), 'the program "no-such-program-anywhere" is not on the PATH'),
    "path": (a_run(("./missing",)), "the program "),
    "folder": (a_run("", folder="missing"), "its folder"),
    "variable": (
        a_run("", environment={"A": FromEnvironment(name="RARMS_NOT_SET")}),
        "A needs the variable RARMS_NOT_SET, which is not set in the environment of rarms",
    ),
    "module": (a_run(Call(module="nothing.here", function="plan")), "ModuleNotFoundError: No module named 'nothing'"),
    "not Python functions": (a_run(Call(module="math", function="pi")), "math:pi is not a function"),
}


@pytest.mark.parametrize(("run", "message"), CANNOT.values(), ids=CANNOT.keys())
def test_what_cannot_be_started_is_told(tmp_path: Path, run: Run, message: str) -> None:
    with pytest.raises(CannotStart) as result:
        all_of(run, tmp_path)

    assert result.value.message.startswith(message)
    assert result.value.component == "vision"
    assert ("Set RARMS_NOT_SET" in result.value.advice) == ("RARMS_NOT_SET" in message)


@pytest.mark.needs("posix")
def test_program_without_right_to_execute_is_named(tmp_path: Path) -> None:
    (tmp_path / "my node.py").write_text("#!/usr/bin/env python3\n", encoding="utf-8")

    with pytest.raises(CannotStart, match=r"my node\.py is not executable") as result:
        all_of(a_run(("./my node.py",)), tmp_path)

    assert result.value.advice == f"Make it executable: chmod +x '{tmp_path}/my node.py'"


@pytest.mark.needs("posix")
def test_program_that_system_refuses_cannot_be_started(tmp_path: Path) -> None:
    (tmp_path / "vision").write_bytes(b"\x7fnothing that can be run")
    (tmp_path / "vision").chmod(0o755)

    with pytest.raises(CannotStart, match="Exec format error"):
        all_of(a_run(("./vision",)), tmp_path)


def test_asked_to_end_a_program_may_do_so(tmp_path: Path) -> None:
    asked = "signal.SIGBREAK if sys.platform == 'win32' else signal.SIGINT"
    program = (
        f"def end(*_):\n    open('asked', 'w').close()\n    sys.exit(0)\nsignal.signal({asked}, end)\n{GOOD}"
        "while True: time.sleep(0.01)"
    )
    run = a_run(program, until=1, stop=Stop(signal="INT", grace=ms(20_000)))

    all_of(run, tmp_path)

    if sys.platform == "win32" and not (tmp_path / "asked").exists():
        pytest.skip("needs posix: without a console nothing can be asked with Ctrl-Break")
    assert (tmp_path / "asked").exists()


@pytest.mark.needs("posix")
def test_stubborn_component_is_killed_after_grace(tmp_path: Path) -> None:
    program = (
        "import os\nfrom pathlib import Path\nPath('id').write_text(str(os.getpid()))\n"
        f"signal.signal(signal.SIGTERM, lambda *_: Path('asked').touch())\n{GOOD}"
        "while True:\n    time.sleep(0.01)\n    if Path('asked').exists(): Path('lived on').touch()\n"
    )

    all_of(a_run(program, until=1, stop=Stop(grace=ms(2_000))), tmp_path)

    assert (tmp_path / "lived on").exists()
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "id").read_text(encoding="utf-8")), 0)


def test_failure_without_sample_shows_first_lines(tmp_path: Path) -> None:
    samples = Samples(source="pattern", pattern="took (?P<t>[0-9]+) us", response_time=TimeField(field="t", unit="ms"))
    program = "for n in range(5): say(f'\\x1b[1mlooked {n} times')\n"

    found = failures(all_of(a_run(program, samples=samples, until=2, failures=9), tmp_path))

    lines = ", ".join(f'"<U+001B>[1mlooked {n} times"' for n in range(3))
    assert found == [f"it ended without a sample; 5 lines did not match the pattern (the first: {lines})"] * 2


@same_everywhere
def test_samples_on_the_other_stream_are_noticed(tmp_path: Path) -> None:
    program = "print('{\"ms\": 1}', file=sys.stderr)\nprint('{\"ms\": 2}', file=sys.stderr)\nsay('starting')\n"

    (failure,) = failures(all_of(a_run(program, until=1), tmp_path))

    assert failure == (
        'it ended without a sample; 1 line was not a JSON object ("starting"); '
        "2 lines of standard error match: use `samples: {stream: stderr}`"
    )


BEATS = """
import subprocess
beat = "import time\\nwhile True:\\n    open('beat', 'a').write('.')\\n    time.sleep(0.01)"
away = {} if sys.platform == 'win32' else {'start_new_session': True}
subprocess.Popen([sys.executable, '-S', '-c', beat], **away)
while not os.path.exists('beat'): time.sleep(0.01)
"""
"""Starts a process that leaves its group and shows for how long it lives."""

ANSWERS = BEATS + "say('{\"ms\": 1}')\nwhile True: time.sleep(1)\n"


def still_beats(folder: Path) -> bool:
    """Whether something goes on writing there."""
    before = (folder / "beat").stat().st_size
    time.sleep(0.15)
    return (folder / "beat").stat().st_size != before


def beats_in_the_end(folder: Path) -> bool:
    """Whether something still writes there after some time for what ends by itself."""
    until = time.perf_counter() + 10
    while still_beats(folder) and time.perf_counter() < until:
        pass
    return still_beats(folder)


def test_what_a_component_started_ends_with_its_run(tmp_path: Path) -> None:
    with component(a_run(ANSWERS, until=1000), tmp_path) as component_run:
        next(component_run)
        assert still_beats(tmp_path)

    assert not still_beats(tmp_path)


def test_what_run_leaves_behind_is_gone_before_next(tmp_path: Path) -> None:
    with component(a_run(BEATS, samples=PER_RUN, until=1), tmp_path) as component_run:
        assert next(component_run).successful
        assert not still_beats(tmp_path)


@same_everywhere
def test_run_that_is_left_by_exception_leaves_nothing(tmp_path: Path) -> None:
    def interrupted() -> None:
        with component(a_run(ANSWERS, until=1000), tmp_path) as component_run:
            next(component_run)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()

    assert not still_beats(tmp_path)


def test_rarms_killed_leaves_nothing(tmp_path: Path) -> None:
    program = (
        "import sys\nfrom pathlib import Path\nfrom tests.unit.running.programs import a_run, component\n"
        f"one = component(a_run({ANSWERS!r}, until=1000), Path({str(tmp_path)!r}))\n"
        "next(one)\nprint('running', flush=True)\nnext(one)\n"
    )
    rarms = subprocess.Popen([sys.executable, "-c", program], cwd=CHECKOUT, stdout=subprocess.PIPE)
    assert rarms.stdout is not None
    assert rarms.stdout.readline().strip() == b"running"
    assert still_beats(tmp_path)

    rarms.kill()
    rarms.wait()
    rarms.stdout.close()

    assert not beats_in_the_end(tmp_path)


def test_killed_keeper_takes_its_component(tmp_path: Path) -> None:
    program = "open('pid', 'w').write(str(os.getppid()))\nopen('beat', 'w').close()\nsay('{\"ms\": 1}')\n" + (
        "while True:\n    open('beat', 'a').write('.')\n    time.sleep(0.01)"
    )

    with component(a_run(program, until=1000), tmp_path) as component_run:
        next(component_run)
        os.kill(int((tmp_path / "pid").read_text(encoding="ascii")), getattr(signal, "SIGKILL", signal.SIGTERM))
        with pytest.raises(SupervisorLost):
            list(component_run)

    assert not beats_in_the_end(tmp_path)


@pytest.mark.needs("linux")
def test_no_zombie_is_left(tmp_path: Path) -> None:
    with component(a_run(ANSWERS, until=1), tmp_path) as component_run:
        list(component_run)

    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)
