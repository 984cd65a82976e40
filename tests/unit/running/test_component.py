"""Where samples come from: lines of JSON, lines that match, runs, calls; and when the next job starts."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.model.run import Call, Field, Samples, TimeField
from rarms_iac.model.series import SkippedLines
from rarms_iac.running.samples import SamplingEnd
from tests.needs import ON_WINDOWS
from tests.unit.running.programs import (
    JSON_LINES,
    PER_RUN,
    a_run,
    all_of,
    component,
    failures,
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
