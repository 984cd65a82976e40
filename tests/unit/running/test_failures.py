"""Failed samples: what dies, hangs, raises, floods or cannot be read is unsuccessful, shown, and never dropped."""

import sys
import time
from pathlib import Path

import pytest

from rarms_iac.model.quantities import show_milliseconds
from rarms_iac.model.run import Call, Field, FromEnvironment, Run, Samples, Stop, TimeField
from rarms_iac.running.samples import SamplingEnd
from rarms_iac.running.start import CannotStart, StartContext
from tests.needs import ON_WINDOWS
from tests.unit.running.programs import PER_RUN, a_run, all_of, component, failures, ms, responses, same_everywhere

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
    "program": (a_run(("no-such-program-anywhere",)), 'there is no program "no-such-program-anywhere" on the PATH'),
    "path": (a_run(("./missing",)), "there is no program"),
    "folder": (a_run("", folder="missing"), "its folder"),
    "variable": (
        a_run("", environment={"A": FromEnvironment(name="RARMS_NOT_SET")}),
        "A is to come from the variable RARMS_NOT_SET, which is not set where rarms runs",
    ),
    "module": (a_run(Call(module="nothing.here", function="plan")), "ModuleNotFoundError: No module named 'nothing'"),
    "no function": (a_run(Call(module="math", function="pi")), "math:pi is not a function"),
}


@pytest.mark.parametrize(("run", "message"), CANNOT.values(), ids=CANNOT.keys())
def test_what_cannot_be_started_is_told(tmp_path: Path, run: Run, message: str) -> None:
    with pytest.raises(CannotStart) as result:
        all_of(run, tmp_path)

    assert result.value.message.startswith(message)
    assert result.value.component == "vision"
    assert ("Set RARMS_NOT_SET" in result.value.advice) == ("RARMS_NOT_SET" in message)


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
    program = f"signal.signal(signal.SIGTERM, signal.SIG_IGN)\n{GOOD}while True: time.sleep(1)"
    before = time.perf_counter()

    all_of(a_run(program, until=1, stop=Stop(grace=ms(300))), tmp_path)

    assert 0.3 <= time.perf_counter() - before < 10


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
