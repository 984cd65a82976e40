"""No process outlives its component's run: no matter who ends it and how it tries to get away."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rarms_iac.running.start import SupervisorLost
from tests.needs import CHECKOUT
from tests.unit.running.programs import PER_RUN, a_run, component, same_everywhere

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
