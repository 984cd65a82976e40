"""Interfering loads are real processes that never stop by themselves, and several components run at once."""

import os
import shutil
import signal
import sys
import time
from fractions import Fraction
from pathlib import Path

import pytest

from rarms_iac.model.loads import Browser, Bursts, BusyLoop, CommandLoad, Stress
from rarms_iac.model.quantities import Percent
from rarms_iac.running.component import run_in_parallel
from rarms_iac.running.loads import BROWSERS, STREAMS, InterferingLoad, LoadEnded, load_words
from rarms_iac.running.orders import CannotStart, StartContext
from rarms_iac.running.samples import SamplingEnd
from tests.effort import LONG
from tests.unit.running.programs import a_run, component, ms, same_everywhere


def processes_with(*words: str) -> list[int]:
    """Which processes have these in their command line, one after the other."""
    found = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if "\0".join(words).encode() in file.read_bytes():
                found.append(int(file.parent.name))
        except OSError:
            continue
    return found


@pytest.mark.needs("linux")
def test_a_busy_loop_uses_what_it_is_given(tmp_path: Path) -> None:
    with InterferingLoad("busy-loop", BusyLoop(threads=2), StartContext(base=tmp_path)) as load:
        time.sleep(0.3)
        load.check()
        load.close()
        used = load.cpu_ms

    assert used is not None
    assert used > 20


@pytest.mark.needs("linux")
def test_bursts_take_their_duty(tmp_path: Path) -> None:
    half = Bursts(every=ms(40), duty=Percent(Fraction(50)), threads=1)
    began = time.perf_counter()
    with InterferingLoad("pulses", half, StartContext(base=tmp_path)) as load:
        time.sleep(2.0)
        load.check()
        load.close()
        used = load.cpu_ms
    lasted_ms = 1000 * (time.perf_counter() - began)

    assert used is not None
    assert 50 < used < 0.6 * lasted_ms + 500, "half of the time at most, and what two Pythons take to start"


def test_bursts_without_duty_take_what_their_partition_reserves(tmp_path: Path) -> None:
    frames = Bursts(every=ms(50))

    assert load_words("frames", frames, tmp_path, 3, 40.0)[-3:] == ("3", "20000000", "30000000")
    with pytest.raises(CannotStart, match="the load needs a `duty`"):
        load_words("frames", frames, tmp_path, 3, None)


@pytest.mark.needs("linux")
def test_bursts_that_lose_a_process_end(tmp_path: Path) -> None:
    half = Bursts(every=ms(20), duty=Percent(Fraction(10)), threads=2)
    with InterferingLoad("pulses", half, StartContext(base=tmp_path)) as load:
        (inner,) = processes_with("bursts.py", "one", "1")
        os.kill(inner, signal.SIGKILL)
        until = time.perf_counter() + 20

        def watch() -> None:
            while time.perf_counter() < until:
                load.check()
                time.sleep(0.02)

        with pytest.raises(LoadEnded, match="a process of the bursts ended"):
            watch()


def test_a_command_runs_so_often_at_once(tmp_path: Path) -> None:
    program = "import os, time\nopen(f'ran-{os.getpid()}', 'w').close()\nwhile True: time.sleep(0.1)"

    with InterferingLoad(
        "others", CommandLoad(command=(sys.executable, "-c", program), instances=3), StartContext(base=tmp_path)
    ):
        until = time.perf_counter() + 20
        while len(list(tmp_path.glob("ran-*"))) < 3 and time.perf_counter() < until:
            time.sleep(0.02)

    assert len(list(tmp_path.glob("ran-*"))) == 3


def test_a_load_that_ends_is_told(tmp_path: Path) -> None:
    load = CommandLoad(command=(sys.executable, "-c", "import time, sys\ntime.sleep(0.3)\nsys.exit(5)"))

    def measure() -> None:
        with InterferingLoad("others", load, StartContext(base=tmp_path)) as running:
            until = time.perf_counter() + 20
            while time.perf_counter() < until:
                running.check()
                time.sleep(0.02)

    with pytest.raises(LoadEnded, match="instance 1 of 1 ended with exit code 5"):
        measure()


@same_everywhere
def test_a_load_that_cannot_run_is_told(tmp_path: Path) -> None:
    with pytest.raises(CannotStart):
        InterferingLoad("others", CommandLoad(command=("no-such-program-anywhere",)), StartContext(base=tmp_path))


def test_browser_shows_our_page_without_network(tmp_path: Path) -> None:
    if not any(map(shutil.which, BROWSERS)):
        with pytest.raises(CannotStart, match="browser was not found on the PATH"):
            load_words("browsers", Browser(instances=2), tmp_path, 1, None)
        return

    words = load_words("browsers", Browser(instances=2), tmp_path, 1, None)

    page = Path(words[-1].removeprefix("file://"))
    assert f"--user-data-dir={tmp_path / 'profile-{n}'}" in words
    assert STREAMS in page.read_text(encoding="utf-8")
    assert "http" not in page.read_text(encoding="utf-8")


@pytest.mark.needs("linux", "stress-ng")
@pytest.mark.parametrize("stressor", ["timer", "switch", *(("hdd", "stream", "sock") if LONG else ())])
def test_ended_stress_workers_leave_nothing(tmp_path: Path, stressor: str) -> None:
    with InterferingLoad("stress", Stress(stressor=stressor, workers=2), StartContext(base=tmp_path)) as load:
        until = time.perf_counter() + 20
        while len(processes_with(f"stress-ng-{stressor}")) < 2 and time.perf_counter() < until:
            time.sleep(0.02)
        assert len(processes_with(f"stress-ng-{stressor}")) >= 2, "stress-ng names its workers so"
        load.check()

    assert processes_with(f"stress-ng-{stressor}") == []


@pytest.mark.needs("linux", "stress-ng")
def test_a_stressor_that_is_not_known_is_told(tmp_path: Path) -> None:
    with pytest.raises(CannotStart, match="unrecognized option"):
        InterferingLoad("stress", Stress(stressor="nosuch"), StartContext(base=tmp_path)).close()


def test_without_stress_ng_the_load_cannot_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))

    with pytest.raises(CannotStart, match="stress-ng was not found on the PATH"):
        load_words("stress", Stress(stressor="timer"), tmp_path, 2, None)


if LONG:  # a browser takes its time to start

    @pytest.mark.needs("chromium")
    def test_browsers_stream_and_nothing_of_them_stays(tmp_path: Path) -> None:
        with InterferingLoad("browsers", Browser(instances=1), StartContext(base=tmp_path)) as load:
            load.check()
            assert processes_with("stream.html")

        assert processes_with("stream.html") == []


def test_several_components_run_at_once(tmp_path: Path) -> None:
    slow = a_run("while True:\n    say('{\"ms\": 1}')\n    time.sleep(0.02)", until=5)
    fast = a_run("while True:\n    say('{\"ms\": 2}')\n    time.sleep(0.01)", until=7)
    runs = [component(slow, tmp_path), component(fast, tmp_path)]

    with run_in_parallel(runs) as samples:
        found = [sample.response_ms for _, sample in samples]

    assert sorted(sample or 0 for sample in found) == [1.0] * 5 + [2.0] * 7
    assert [run.ending for run in runs] == [SamplingEnd.UNTIL] * 2


@same_everywhere
def test_parallel_components_end_at_any_moment(tmp_path: Path) -> None:
    endless = a_run("while True: say('{\"ms\": 1}')", until=1_000_000)
    runs = [component(endless, tmp_path), component(endless, tmp_path)]

    with run_in_parallel(runs) as samples:
        next(samples)

    assert [run.ending for run in runs] == [SamplingEnd.CLOSED] * 2
    assert all(run.series().elapsed_ms >= 0 for run in runs)


@same_everywhere
def test_a_component_can_be_ended_by_another_thread(tmp_path: Path) -> None:
    runs = [component(a_run("time.sleep(60)"), tmp_path)]

    with run_in_parallel(runs) as samples:
        runs[0].interrupt()
        assert list(samples) == []
