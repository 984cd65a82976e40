"""`rarms run`: components as real processes, their samples live, and what they come to beside the APT."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import jsonschema
import pytest

from rarms_iac import rcss
from rarms_iac.app.manifests import load_manifest, start_warnings
from rarms_iac.app.requests import ManifestSource
from rarms_iac.model.setting import OutsideWork
from rarms_iac.running.work_places import WorkPlaces
from rarms_iac.storage.shipped import shipped
from scripts.output_schema import output_schema
from tests.contracts.benches import forget_host, groups_of, slice_of
from tests.needs import CHECKOUT
from tests.unit.cli.running import rarms
from tests.unit.running.programs import same_everywhere

HEAD = """schema: rarms/v1
application: { name: robot }
hosts: { onboard: { logical_processors: 2, memory: 4 GiB } }
components:
"""
SAMPLES = 60
QUICK = """
import json, time
while True:
    print(json.dumps({"ms": 2}), flush=True)
    time.sleep(0.001)
"""


ROOT = """\
schema: rarms/v1
application: { name: robot }
hosts: { onboard: { provider: linux, logical_processors: 2, memory: 1 GiB } }
components:
  ears: { criticality: 1, run: { command: ["true"] } }
  eyes: { criticality: 1, run: { command: ["true"] } }
  arm: { criticality: 1, run: { command: ["true"], user: robot } }
  box: { criticality: 1, run: { container: { engine: podman, image: box } } }
  old: { criticality: 1, run: { command: ["true"] } }
policy: { accept: { RARMS441: { at: [component/old], reason: Known. } } }
"""


@pytest.mark.needs("linux")
def test_one_warning_names_components_of_root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "rarms.yaml").write_text(ROOT, encoding="utf-8")
    manifest = load_manifest(ManifestSource(manifest=str(tmp_path)))
    components = [*manifest.system.components.values()]

    monkeypatch.setattr(os, "geteuid", lambda: 0)
    (finding,) = start_warnings(manifest, components)
    monkeypatch.setattr(os, "geteuid", lambda: 1000)

    assert (finding.code, finding.values["components"]) == ("RARMS441", ("ears", "eyes"))
    assert start_warnings(manifest, components) == ()


def test_run_names_a_too_short_secret(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = Path(manifest(tmp_path, vision=QUICK), "rarms.yaml")
    text = path.read_text("utf-8").replace(
        "      until:", "      environment: { TOKEN: { from_env: TOKEN } }\n      until:"
    )
    path.write_text(text, encoding="utf-8")
    found = {}
    for value in ("short", "longer"):
        monkeypatch.setenv("TOKEN", value)
        answer = rarms("run", "-f", str(path), "--json")
        found[value] = [each["code"] for each in json.loads(answer.out)["findings"]]

    accepted = text + "policy: { accept: { RARMS345: { at: [component/vision], reason: no secret } } }\n"
    path.write_text(accepted, encoding="utf-8")
    monkeypatch.setenv("TOKEN", "short")
    assert "RARMS345" not in rarms("run", "-f", str(path), "--json").out
    assert "RARMS345" in found["short"]
    assert "RARMS345" not in found["longer"]


def manifest(folder: Path, apt: str = "{ mean_response_time: { at_most: 5 ms } }", **programs: str) -> str:
    """A manifest whose components are these Python programs."""
    text = HEAD
    for name, program in programs.items():
        (folder / f"{name}.py").write_text(program, encoding="utf-8")
        text += (
            f"  {name}:\n    criticality: 10\n    memory: 64 MiB\n    cpu: {{ reserve: 10 % }}\n    apt: {apt}\n"
            f"    run:\n      command: [python3, {name}.py]\n      until: {{ samples: {SAMPLES} }}\n"
            "      samples: { from: json_lines, response_time: { field: ms, unit: ms } }\n"
        )
    (folder / "rarms.yaml").write_text(text, encoding="utf-8")
    return str(folder)


def test_samples_are_shown_and_what_they_come_to(tmp_path: Path) -> None:
    ran = rarms("run", "-f", manifest(tmp_path, vision=QUICK))

    assert ran.code == 0, ran.err
    assert "beside everything else" not in ran.err  # no Linux host: nothing could reserve
    assert [line.split()[:2] for line in ran.lines[:3]] == [["vision", "1"], ["vision", "2"], ["vision", "3"]]
    assert ran.lines[0].endswith("response 2 ms")
    assert ran.lines[SAMPLES].startswith("vision: 60 samples in ")
    assert ran.lines[SAMPLES + 2] == "  mean_response_time  2 ms (1.82 to 2.18 ms)  <= 5 ms    met in this run"


@same_everywhere
def test_an_apt_that_is_missed_here_is_told(tmp_path: Path) -> None:
    ran = rarms("run", "-f", manifest(tmp_path, "{ mean_response_time: { at_most: 0.5 ms } }", vision=QUICK))

    assert ran.code == 0
    assert "missed in this run" in ran.out
    assert "RARMS288" in ran.err


@pytest.mark.parametrize(
    ("others", "load", "told"),
    [
        ((("make", 4000.0), ("rarms", 9000.0)), (), "other programs used 4 s of processor time. A reservation"),
        ((("make", 1.0),), (), "Other programs used little processor time, so a reservation would not help."),
        ((), ("--interference", "busy-loop"), "The load busy-loop ran at the same time. A reservation may help."),
    ],
)
def test_miss_on_busy_machine_advises_to_measure(
    others: tuple[tuple[str, float], ...],
    load: tuple[str, ...],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen = tuple(OutsideWork(name=name, group="", cpu_ms=cpu_ms) for name, cpu_ms in others)
    monkeypatch.setattr(WorkPlaces, "others", lambda *_: seen)
    folder = manifest(tmp_path, "{ mean_response_time: { at_most: 0.5 ms } }", vision=QUICK)

    text = " ".join(rarms("run", "-f", folder, *load).err.split())

    assert told in text
    assert ("Measure whether a reservation helps" in text) != ("would not help" in told)


@same_everywhere
def test_more_failed_samples_than_allowed_are_answer_no(tmp_path: Path) -> None:
    program = "import sys\nsys.stderr.write('no camera\\n')\nprint('loading', flush=True)\n"

    ran = rarms("run", "-f", manifest(tmp_path, vision=program))

    assert ran.code == 4
    assert 'failed: it ended without a sample; 1 line was not a JSON object ("loading")' in ran.out
    assert "RARMS113" in ran.err
    assert "  no camera" in ran.err


@same_everywhere
@pytest.mark.parametrize(
    ("apt", "code", "shown"),
    [
        ("mean_response_time: { at_most: 9 s }", 4, "failed: it ended with exit code 2"),
        ("mean_response_time: { at_most: 1 ms }", 4, "failed: it ended with exit code 2"),
        ("success_rate: { at_least: 95 % }", 0, "success_rate  0 %"),
    ],
)
def test_program_that_never_does_its_job_meets_nothing(tmp_path: Path, apt: str, code: int, shown: str) -> None:
    text = (
        HEAD
        + f"  sorter: {{ criticality: 10, memory: 64 MiB, apt: {{ {apt} }}, run: {{ command: [python3, no.py] }} }}"
    )
    (tmp_path / "rarms.yaml").write_text(text, encoding="utf-8")

    ran = rarms("run", "-f", str(tmp_path), "--samples", "20")

    assert ran.code == code
    assert shown in ran.out
    assert ("RARMS113" in ran.err) == bool(code)
    assert "RARMS288" not in ran.err or not code, "no reserve would help a program that does not exist"
    assert "can't open file" in ran.err


@same_everywhere
@pytest.mark.parametrize(
    ("instead_of", "written", "message"),
    [
        ("[python3,", "[no-such-program-anywhere,", 'the program "no-such-program-anywhere"'),
        (
            "until:",
            "environment: { A: { from_env: RARMS_NOT_SET } }\n      until:",
            ("Set RARMS_NOT_SET in the environment of rarms; on a Linux host over ssh, in /etc/rarms/environment."),
        ),
    ],
)
def test_what_cannot_be_started_fails(tmp_path: Path, instead_of: str, written: str, message: str) -> None:
    folder = manifest(tmp_path, vision=QUICK)
    text = (tmp_path / "rarms.yaml").read_text(encoding="utf-8").replace(instead_of, written)
    (tmp_path / "rarms.yaml").write_text(text, encoding="utf-8")

    ran = rarms("run", "-f", folder)

    assert ran.code == 1
    assert "RARMS285" in ran.err
    assert message in " ".join(ran.err.split())


def test_programs_get_the_same_as_json(tmp_path: Path) -> None:
    ran = rarms("run", "-f", manifest(tmp_path, vision=QUICK, speech=QUICK), "--together", "--samples", "4", "--json")

    told = json.loads(ran.out)
    jsonschema.Draft202012Validator(json.loads(output_schema())).validate(told)
    assert ran.code == 0
    assert [
        (each["series"]["component"], each["ending"], len(each["series"]["samples"])) for each in told["results"]
    ] == [
        ("vision", "until", 4),
        ("speech", "until", 4),
    ]
    assert told["results"][0]["verdicts"]["mean_response_time"] == "inconclusive"


@same_everywhere
def test_run_may_last_time_against_load(tmp_path: Path) -> None:
    ran = rarms(
        "run", "vision", "-f", manifest(tmp_path, vision=QUICK), "--for", "300ms", "--interference", "busy-loop"
    )

    assert ran.code == 0, ran.err
    assert "in 0.3 s" in ran.out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("visoin",), """The manifest does not have the component "visoin". Did you mean "vision"?"""),
        (("--interference", "busy-lop"), 'The manifest does not have the interference "busy-lop".'),
        (("--for", "5"), '"5" is not a time such as 60s. Units: us, ms, s, min, h.'),
        (("--for", "0,5s"), "Units: us, ms, s, min, h. The decimal separator is a point."),
        (("--for", "5s", "--samples", "3"), "Give --for or --samples, not both."),
    ],
)
def test_words_that_do_not_fit_are_wrong_usage(tmp_path: Path, words: tuple[str, ...], message: str) -> None:
    ran = rarms("run", *words, "-f", manifest(tmp_path, vision=QUICK))

    assert ran.code == 64
    assert message in " ".join(ran.err.split())


def test_component_that_does_not_say_how_is_told(tmp_path: Path) -> None:
    (tmp_path / "rarms.yaml").write_text(
        HEAD + "  vision: { criticality: 10, memory: 64 MiB, cpu: { reserve: 10 % }, simulation: { work: 1 ms } }\n",
        encoding="utf-8",
    )

    ran = rarms("run", "-f", str(tmp_path))

    assert ran.code == 4
    assert "RARMS285" in ran.err


def test_the_shipped_robot_runs_for_real() -> None:
    ran = rarms("run", "-f", str(shipped("manifests") / "delivery-robot"), "--samples", "2", "--together")

    assert ran.code == 0, ran.err
    assert "failed" not in ran.out
    for name in ("face-detection", "speech-recognition", "path-planning", "video-streaming"):
        assert f"{name}: 2 samples in " in ran.out


@pytest.mark.needs("posix")
def test_ctrl_c_ends_the_component_and_the_command(tmp_path: Path) -> None:
    program = "import os\nopen('pid', 'w').write(str(os.getpid()))\n" + QUICK
    words = [sys.executable, "-m", "rarms_iac.cli.main", "run", "-f", manifest(tmp_path, vision=program), "--for", "1h"]
    with subprocess.Popen(words, cwd=CHECKOUT, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=120)

    assert process.returncode == 130
    pid = int((tmp_path / "pid").read_text(encoding="ascii"))
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


JOB = "import time\ndef job():\n    time.sleep(0.001)\n    return {'ms': 1}\n"


@pytest.mark.needs("windows")
@pytest.mark.parametrize(
    ("run", "task", "message"),
    [
        ("call: 'vision:job'", "ObjectIdentification", "vision runs in the task class ObjectIdentification."),
        (
            "call: 'vision:job'",
            "MotionControl",
            'without its task class: cannot join the task class "MotionControl" (1550)',
        ),
        ("command: [python3, vision.py]", "ObjectIdentification", "its own code must join ObjectIdentification"),
    ],
)
def test_windows_runner_joins_only_for_calls(
    run: str, task: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rcss, "_AVRT", str(CHECKOUT / ".cache" / "windows" / "avrt" / "avrt.dll"))
    manifest(tmp_path, vision=JOB if "call" in run else QUICK)
    text = (tmp_path / "rarms.yaml").read_text(encoding="utf-8")
    text = text.replace("criticality: 10", f"criticality: 10\n    task: {task}")
    text = text.replace("command: [python3, vision.py]", run)
    (tmp_path / "rarms.yaml").write_text(text, encoding="utf-8")

    ran = rarms("run", "-f", str(tmp_path), "--samples", "2")

    assert ran.code == 0, ran.err
    assert message in " ".join(ran.err.split())


WHERE = """
import json, os, time
groups = open("/proc/self/cgroup").read()
with open("where.json", "w") as file:
    json.dump([groups, os.sched_getscheduler(0), os.sched_getparam(0).sched_priority], file)
while True:
    print(json.dumps({"ms": 2}), flush=True)
    time.sleep(0.001)
"""


@pytest.fixture
def linux_folder(tmp_path: Path) -> Iterator[Path]:
    """A folder whose host makes control groups; they are gone after the test."""
    yield tmp_path
    forget_host(tmp_path)


def on_linux(folder: Path, component: str = "", settings: str = "") -> Path:
    """Write a manifest whose host is this machine; return the file that tells where its component ran."""
    manifest(folder, vision=WHERE)
    file = folder / "rarms.yaml"
    text = file.read_text(encoding="utf-8").replace("criticality: 10", f"criticality: 10{component}")
    linux = f"onboard: {{ provider: linux, linux: {{ slice: {slice_of(folder)}{settings} }}, "
    file.write_text(text.replace("onboard: {", linux), encoding="utf-8")
    return folder / "where.json"


@pytest.mark.needs("control-groups")
@pytest.mark.alone
def test_component_runs_in_its_partition_and_class(linux_folder: Path) -> None:
    """And without, as long as it is not applied; what it left behind is gone with it."""
    seen, slice_name = on_linux(linux_folder, "\n    task: MotionControl"), slice_of(linux_folder)

    before = rarms("run", "-f", str(linux_folder), "--samples", "2")
    outside = json.loads(seen.read_text(encoding="utf-8"))
    assert rarms("apply", "-f", str(linux_folder), "--auto-approve").code == 0
    after = rarms("run", "-f", str(linux_folder), "--samples", "2")
    inside = json.loads(seen.read_text(encoding="utf-8"))
    assert rarms("stop", "-f", str(linux_folder), "--auto-approve").code == 0
    stopped = rarms("run", "-f", str(linux_folder), "--samples", "2")

    assert "vision runs without a reservation: onboard: the partition vision of robot does not exist." in before.err
    assert "vision runs without a reservation: onboard: the partition vision of robot is stopped." in stopped.err
    assert after.err.startswith("vision runs in its partition vision on onboard (chrt --fifo 23).")
    assert slice_name not in outside[0]
    assert f"/{slice_name}/vision" in inside[0]
    assert (outside[1], inside[1], inside[2]) == (os.SCHED_OTHER, os.SCHED_FIFO, 23)
    assert groups_of(linux_folder).processes("vision") == ()


HUNGRY = """
import time
eaten = []
while True:
    eaten.append(bytearray(8 << 20))
    time.sleep(0.001)
"""


@pytest.mark.needs("control-groups")
@pytest.mark.alone
def test_a_memory_kill_advises_more_memory(linux_folder: Path) -> None:
    on_linux(linux_folder)
    (linux_folder / "vision.py").write_text(HUNGRY, encoding="utf-8")
    assert rarms("apply", "-f", str(linux_folder), "--auto-approve").code == 0

    ran = rarms("run", "-f", str(linux_folder))

    assert ran.code == 4
    assert "The kernel killed 1 process of its partition" in ran.err
    assert "Raise `memory`" in ran.err
    assert "run.failures` allows some" not in ran.err


ITSELF = """
import os, signal, sys
print(sys.stdin.read(), os.environ["GREETING"], open("/proc/self/cgroup").read(), flush=True)
print("to standard error", file=sys.stderr)
os.kill(os.getpid(), signal.SIGTERM) if "end" in sys.argv else sys.exit(7)
"""


@pytest.mark.needs("control-groups")
@pytest.mark.alone
def test_rarms_becomes_the_component_in_its_partition(linux_folder: Path) -> None:
    on_linux(linux_folder)
    (linux_folder / "vision.py").write_text(ITSELF, encoding="utf-8")
    assert rarms("apply", "-f", str(linux_folder), "--auto-approve").code == 0

    def run_itself() -> subprocess.CompletedProcess[str]:
        words = [sys.executable, "-m", "rarms_iac.cli.main", "run", "--exec", "vision", "-f", str(linux_folder)]
        greeting = {**os.environ, "GREETING": "good day"}
        return subprocess.run(words, input="Another program", capture_output=True, text=True, env=greeting, timeout=60)

    exited = run_itself()
    file = linux_folder / "rarms.yaml"
    file.write_text(file.read_text(encoding="utf-8").replace("vision.py]", "vision.py, end]"), encoding="utf-8")
    killed = run_itself()

    assert (exited.returncode, killed.returncode) == (7, -signal.SIGTERM), exited.stderr
    assert exited.stdout.startswith("Another program good day ")
    assert f"/{slice_of(linux_folder)}/vision" in exited.stdout
    assert exited.stderr == "vision runs in its partition vision on onboard.\nto standard error\n"


@pytest.mark.needs("control-groups")
@pytest.mark.alone
def test_measure_and_prove_refuse_component_of_run_exec(linux_folder: Path) -> None:
    on_linux(linux_folder)
    (linux_folder / "vision.py").write_text(QUICK, encoding="utf-8")
    folder = str(linux_folder)
    assert rarms("apply", "-f", folder, "--auto-approve").code == 0
    words = [sys.executable, "-m", "rarms_iac.cli.main", "run", "--exec", "vision", "-f", folder]
    with subprocess.Popen(words, cwd=CHECKOUT, stdout=subprocess.PIPE) as service:
        assert service.stdout is not None
        service.stdout.readline()
        proven = rarms("prove", "-f", folder, "--load-host")
        measured = rarms("measure", "-f", folder, "--stop-partitions")
        still_runs = service.poll() is None
        service.terminate()

    for refused in (proven, measured):
        assert refused.code == 1, refused.err
        assert f'"vision" already runs: process {service.pid} is from' in " ".join(refused.err.split())
    assert still_runs


@pytest.mark.needs("linux")
def test_run_refuses_component_of_run_exec(tmp_path: Path) -> None:
    folder = manifest(tmp_path, vision=QUICK, speech=QUICK)
    words = [sys.executable, "-m", "rarms_iac.cli.main", "run", "--exec", "vision", "-f", folder]
    with subprocess.Popen(words, cwd=CHECKOUT, stdout=subprocess.PIPE) as service:
        assert service.stdout is not None
        service.stdout.readline()
        refused = rarms("run", "-f", folder, "--samples", "2")
        other = rarms("run", "speech", "-f", folder, "--samples", "2")
        service.terminate()
    again = rarms("run", "-f", folder, "--samples", "2")

    assert (refused.code, other.code, again.code) == (1, 0, 0), refused.err
    assert refused.out == ""
    assert "RARMS285" in refused.err
    assert f'"vision" already runs: process {service.pid} is from `rarms run --exec`.' in " ".join(refused.err.split())
    assert "speech" not in refused.err


@pytest.mark.needs("posix")
@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["vision", "--samples", "2"], 64, "--exec takes one COMPONENT"),
        ([], 64, "--exec takes one COMPONENT"),
        (["speech"], 64, "--exec needs a `command`"),
        (["vision"], 1, '"vision" cannot be started'),
    ],
)
def test_what_rarms_cannot_become(words: list[str], code: int, message: str, tmp_path: Path) -> None:
    manifest(tmp_path, vision=QUICK, speech=QUICK)
    file = tmp_path / "rarms.yaml"
    text = file.read_text(encoding="utf-8").replace("command: [python3, vision.py]", "command: [/dev/null]")
    file.write_text(text.replace("command: [python3, speech.py]", "call: 'speech:job'"), encoding="utf-8")

    ran = rarms("run", "--exec", *words, "-f", str(tmp_path))

    assert ran.code == code, ran.err
    assert message in " ".join(ran.err.split())


@pytest.mark.needs("control-groups")
@pytest.mark.alone
def test_deadline_needs_first_thread_and_all_processors(linux_folder: Path) -> None:
    seen = on_linux(linux_folder, settings=", mechanism: deadline")
    assert rarms("apply", "-f", str(linux_folder), "--auto-approve").code == 0

    ran = rarms("run", "-f", str(linux_folder), "--samples", "2")

    assert ran.code == 0, ran.err
    assert json.loads(seen.read_text(encoding="utf-8"))[1] == 6 | os.SCHED_RESET_ON_FORK, "SCHED_DEADLINE"
    tree = groups_of(linux_folder)
    tree.write("vision", replace(tree.read("vision"), processors=(0,)))
    refused = rarms("run", "-f", str(linux_folder), "--samples", "2")
    assert "The kernel refuses SCHED_DEADLINE to a thread that may not run on all processors" in refused.err


@pytest.mark.needs("control-groups")
def test_host_component_runs_outside_in_its_class(linux_folder: Path) -> None:
    seen = on_linux(linux_folder, "\n    task: MotionControl\n    runs_on: host")
    file = linux_folder / "rarms.yaml"
    file.write_text(file.read_text(encoding="utf-8").replace("    cpu: { reserve: 10 % }\n", ""), encoding="utf-8")

    ran = rarms("run", "-f", str(linux_folder), "--samples", "2")

    assert "vision runs on onboard itself (chrt --fifo 23)." in ran.err
    groups, policy, priority = json.loads(seen.read_text(encoding="utf-8"))
    assert slice_of(linux_folder) not in groups
    assert (policy, priority) == (os.SCHED_FIFO, 23)
