"""Several processes as one component, their users and variables, and lines from files and sockets."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.model.run import Process, Run, Samples, TimeField
from rarms_iac.running.environment import changed_digests
from rarms_iac.running.orders import CannotStart, StartContext
from rarms_iac.running.start import order_of
from tests.unit.running.programs import HEARD, JSON_LINES, a_run, all_of, component, failures, responses

pytestmark = pytest.mark.needs("linux")

DETECTS = "\nwhile True: say(json.dumps({'ms': 5})); time.sleep(0.02)"


def program(text: str, *words: str) -> Process:
    return Process(command=(sys.executable, "-S", "-c", HEARD + text, *words))


def several(failures: int = 0, until: int = 3, **processes: Process) -> Run:
    samples = replace(JSON_LINES, process="detector")
    return replace(a_run((), samples=samples, failures=failures, until=until), processes=processes)


def test_processes_start_in_order_and_end_together(tmp_path: Path) -> None:
    said = tmp_path / "said"
    says = "open(sys.argv[1], 'a').write(f'{sys.argv[2]} {os.getpid()}' + chr(10)); "
    run = several(
        camera=program(says + "time.sleep(60)", str(said), "camera"),
        detector=program("time.sleep(0.3); " + says + DETECTS, str(said), "detector"),
    )

    samples = all_of(run, tmp_path)

    words = [line.split() for line in said.read_text(encoding="utf-8").splitlines()]
    assert responses(samples) == [5, 5, 5]
    assert [name for name, _ in words] == ["camera", "detector"]
    assert not any(Path(f"/proc/{pid}").exists() for _, pid in words)


def test_process_that_ends_fails_the_sample(tmp_path: Path) -> None:
    run = several(failures=9, until=40, camera=program("time.sleep(0.3); sys.exit(3)"), detector=program(DETECTS))

    samples = all_of(run, tmp_path)

    assert set(failures(samples)) == {"its process camera ended with exit code 3"}
    first = next(number for number, sample in enumerate(samples) if sample.failure)
    assert any(not sample.failure for sample in samples[first:])  # all of them were started again


@pytest.mark.parametrize("code", [0, 3])
def test_end_of_the_sampled_process_has_its_name(tmp_path: Path, code: int) -> None:
    ends = f"\nsay(json.dumps({{'ms': 5}})); time.sleep(0.1); sys.exit({code})"
    run = several(failures=9, until=4, camera=program("time.sleep(60)"), detector=program(ends))

    assert set(failures(all_of(run, tmp_path))) == {f"its process detector ended with exit code {code}"}


def test_none_stays_where_one_cannot_start(tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    broken.write_text("does not contain a program", encoding="utf-8")
    broken.chmod(0o755)
    said = tmp_path / "said"
    run = several(camera=program("open(sys.argv[1], 'w').write(str(os.getpid())); time.sleep(60)", str(said)))
    run = replace(run, processes={**run.processes, "detector": Process(command=("./broken",))})

    with pytest.raises(CannotStart, match="its process detector: "):
        all_of(run, tmp_path)

    assert not said.exists() or not Path(f"/proc/{said.read_text(encoding='utf-8')}").exists()


def test_variables_come_from_file_and_setup(tmp_path: Path) -> None:
    (tmp_path / "robot.env").write_text("# ours\nROS_DOMAIN_ID=7\nLEVEL=1\n", encoding="utf-8")
    (tmp_path / "setup.bash").write_text('echo sourced\nexport BOTH="$ROS_DOMAIN_ID $LEVEL"\n', encoding="utf-8")
    run = a_run("say(json.dumps({'ms': int(os.environ['BOTH'].replace(' ', ''))})); time.sleep(60)", until=1)
    environment = {"from_file": "robot.env", "LEVEL": "3"}

    samples = all_of(replace(run, environment=environment, setup=("setup.bash",)), tmp_path)

    assert responses(samples) == [73]


def test_digest_of_a_longer_path_is_stable() -> None:
    here = changed_digests({"PATH": "/bin", "HOME": "/"}, {"PATH": "/opt/ros/bin:/bin", "HOME": "/"})
    there = changed_digests({"PATH": "/usr/bin:/bin"}, {"PATH": "/opt/ros/bin:/usr/bin:/bin", "HOME": "/"})

    assert here.keys() == {"PATH"}
    assert here["PATH"] == there["PATH"]
    assert there.keys() == {"PATH", "HOME"}


@pytest.mark.needs("root")
def test_a_component_runs_as_its_user(tmp_path: Path) -> None:
    shown = "[os.getuid(), os.geteuid(), os.getgid(), *os.getgroups()]"
    run = a_run(f"print({shown}, os.environ['USER'], file=sys.stderr); say('{{\"ms\": 1}}'); time.sleep(60)", until=1)
    tmp_path.chmod(0o755)

    with component(replace(run, user="nobody", groups=("video",)), tmp_path) as running:
        assert len(list(running)) == 1
        tail = running.tail

    import grp
    import pwd

    nobody, video = pwd.getpwnam("nobody"), grp.getgrnam("video")
    groups = sorted({nobody.pw_gid, video.gr_gid})
    assert tail.strip() == f"{[nobody.pw_uid, nobody.pw_uid, nobody.pw_gid, *groups]} nobody"


@pytest.mark.needs("root")
def test_root_takes_nothing_from_user_variables(tmp_path: Path) -> None:
    setpriv = tmp_path / "setpriv"
    setpriv.write_text(f"#!/bin/sh\ntouch {tmp_path}/run-by-root\n", encoding="utf-8")
    setpriv.chmod(0o755)
    tmp_path.chmod(0o755)
    says = 'echo "$LD_TRIED" >&2; echo \'{"ms": 1}\'; exec sleep 60'
    run = a_run(("/bin/sh", "-c", says), until=1)
    variables = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "LD_TRIED": "as the user"}

    with component(replace(run, user="nobody", environment=variables), tmp_path) as running:
        assert len(list(running)) == 1
        tail = running.tail

    order = order_of("c", replace(run, user="nobody", environment=variables), StartContext(base=tmp_path))
    assert tail.strip() == "as the user"
    assert "LD_TRIED" not in order.processes[0].environment, "setpriv would load what LD_ variables name"
    assert not (tmp_path / "run-by-root").exists()


def test_an_unknown_user_is_named(tmp_path: Path) -> None:
    with pytest.raises(CannotStart, match="the user robot-7 does not exist here"):
        all_of(replace(a_run("say('{}')"), user="robot-7"), tmp_path)


def test_lines_come_from_a_file(tmp_path: Path) -> None:
    (tmp_path / "out.jsonl").write_text('{"ms": 99}\n', encoding="utf-8")  # of an earlier run
    samples = Samples(source="json_lines", file="out.jsonl", response_time=TimeField(field="ms", unit="ms"))
    lines = "for n in range(9): open('out.jsonl', 'a').write(json.dumps({'ms': n}) + chr(10)); time.sleep(0.02)\n"
    run = a_run(f"say(json.dumps({{'ms': 77}}))\n{lines}time.sleep(60)", samples=samples)

    assert responses(all_of(run, tmp_path)) == [0, 1, 2]


def test_lines_come_from_a_socket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    samples = Samples(source="json_lines", socket="s.sock", response_time=TimeField(field="ms", unit="ms"))
    sends = "import socket\ns = socket.socket(socket.AF_UNIX)\ns.connect('s.sock')\n"
    sends += "for n in range(9): s.sendall((json.dumps({'ms': n}) + chr(10)).encode())\ntime.sleep(60)"

    found = all_of(a_run(sends, samples=samples), Path(os.curdir))

    assert responses(found) == [0, 1, 2]
    assert not (tmp_path / "s.sock").exists()
