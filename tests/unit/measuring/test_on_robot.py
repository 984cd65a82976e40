"""What a robot may do to this side during an experiment; the robot is a program that says what a test wants."""

import json
import sys
from datetime import date
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.app.control import MeasuringReporter, WorkBegun
from rarms_iac.app.hosts import Hosts, load
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.measuring.on_robot import ExperimentJob, different_files
from rarms_iac.measuring.tune import TunedThere, TuneRequest, TuningResult, UnattendedTuning, tune_components
from rarms_iac.planner.combining.oracle import Members
from rarms_iac.providers.channel import ProgramChannel
from rarms_iac.providers.interface import RobotListener
from rarms_iac.providers.robot import READY, YES, Answer, ReporterCall, calls_sent_by, line_of, perform_call
from rarms_iac.storage.codec import decode_union, encode
from rarms_iac.storage.datalog.decisions import TuningRun, append_run, read_runs
from rarms_iac.storage.json_text import parse_json

pytestmark = pytest.mark.needs("posix")

MANIFEST = """\
schema: rarms/v1
application: { name: cell }
hosts:
  onboard:
    { provider: linux, logical_processors: 2, memory: 1 GiB, connect: { ssh: cell, folder: /opt/robot } }
components:
  eyes: { criticality: 2, memory: 64 MiB, cpu: { reserve: 0.1 LP } }
"""
RUN = TuningRun(
    when="2026-11-29T02:00:00Z",
    rarms_version="0.1.0",
    strategy="default",
    ending="successful",
    message="",
    capacity=200,
    fixed=0,
    before=120,
    after=60,
    proved=True,
    contradictions=(),
    partitions=(),
    trail=(),
    written=True,
)
PROGRAM = """
import sys
print({ready!r}, flush=True)
sys.stdin.readline()
for line in {lines!r}:
    print(line, flush=True)
answers = (line for line in sys.stdin if line != "here\\n")
print({result!r} if not {asks!r} or next(answers) == {yes!r} else "no", flush=True)
"""


class Asked(UnattendedTuning):
    """Remembers what it was asked."""

    def __init__(self) -> None:
        self.combinations: list[tuple[Members, int, int]] = []

    def allows(self, members: Members, settings: int, gain: int) -> bool:
        self.combinations.append((members, settings, gain))
        return True


def call(target: str, method: str, *arguments: Any) -> str:
    return json.dumps({"kind": "call", "target": target, "method": method, "arguments": arguments})


def robot_says(folder: Path, *lines: str, file: str = "", asks: bool = False) -> Hosts:
    """The hosts of a manifest whose robot says these lines, and then that it changed a file of the manifest."""
    manifest = folder / "rarms.yaml"
    manifest.write_text(MANIFEST, encoding="utf-8")
    result = TuningResult(platform="onboard", hosts=("onboard",), run=RUN, findings=(), files=(str(manifest),))
    tuned = TunedThere(result=result, texts={file or str(manifest): f"{MANIFEST}# tuned\n"})
    values = {
        "ready": READY,
        "lines": lines,
        "result": json.dumps({"kind": "result", "value": encode(tuned)}),
        "yes": f"{YES}\n",
    }
    words = (sys.executable, "-c", PROGRAM.format(**values, asks=asks))
    return load(manifest, channels={"onboard": ProgramChannel(host="onboard", target="cell", words=words)})


def test_a_question_travels_and_the_manifest_is_written(tmp_path: Path) -> None:
    append_run(tmp_path / "came", RUN)
    log = (tmp_path / "came").read_text(encoding="utf-8")
    question = call("tuning", "allows", ["ears", "eyes"], 4, 60)
    hosts = robot_says(tmp_path, call("reports", "log", "onboard/tuning.jsonl", 0, log), question, asks=True)
    asked = Asked()

    result = tune_components(hosts, TuneRequest(), prompt=asked)

    assert asked.combinations == [(("ears", "eyes"), 4, 60)]
    assert result.run == RUN
    assert read_runs(tmp_path / "measurements/onboard/tuning.jsonl") == (RUN,)
    assert (tmp_path / "rarms.yaml").read_text(encoding="utf-8") == f"{MANIFEST}# tuned\n"


@pytest.mark.parametrize(
    "work",
    [WorkBegun(units=3), WorkBegun(units=3, more_follows=True, unit_ms=180_000.0, later_ms=7_200_000.0)],
    ids=["unknown length", "known length"],
)
def test_work_is_announced_from_robot(work: WorkBegun) -> None:
    class Heard(MeasuringReporter):
        def work_begun(self, work: WorkBegun) -> None:
            begun.append(work)

    begun: list[WorkBegun] = []

    def send(call: ReporterCall) -> None:
        answer: Answer = decode_union(Answer, parse_json(line_of(call).decode("ascii")))
        assert isinstance(answer, ReporterCall)
        perform_call(RobotListener(reporters={"settings": (MeasuringReporter, Heard())}), answer)

    calls_sent_by(MeasuringReporter, "settings", send, lambda: False).work_begun(work)

    assert begun == [work]


@pytest.mark.parametrize(
    "line",
    [
        call("reports", "log", "../../evil/x.jsonl", 0, "x\n"),
        call("reports", "log", "other/eyes/busy-loop.jsonl", 0, "x\n"),
        call("reports", "log", "onboard/nobody/busy-loop.jsonl", 0, "x\n"),
        call("reports", "log", "onboard/eyes/busy-loop.jsonl", 7, "x\n"),
        call("reports", "log", "onboard/eyes/busy-loop.jsonl", 0, "no log\n"),
        call("reports", "__init__"),
        call("tuning", "confirms", 7),
        call("shell", "run", "reboot"),
    ],
    ids=["path", "platform", "component", "kept", "text", "method", "argument", "target"],
)
def test_what_is_not_of_this_experiment_is_refused(tmp_path: Path, line: str) -> None:
    hosts = robot_says(tmp_path, line)

    with pytest.raises(UseCaseError):
        tune_components(hosts)

    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [tmp_path / "rarms.yaml"]
    assert (tmp_path / "rarms.yaml").read_text(encoding="utf-8") == MANIFEST


def test_no_other_file_is_written(tmp_path: Path) -> None:
    other = tmp_path / "other.yaml"

    with pytest.raises(UseCaseError):
        tune_components(robot_says(tmp_path, file=str(other)))

    assert not other.exists()


def test_files_that_differ_on_robot_are_named() -> None:
    job = ExperimentJob(
        texts=(),
        today=date(2026, 11, 29),
        folder="/opt/robot",
        files={"ears": "1", "eyes": "2", "legs": "3"},
        logs={},
        hosts=("onboard",),
        others={},
        may_stop=False,
        request={},
    )

    found = different_files("onboard", job, {"eyes": "0", "legs": "3"})

    assert [each.code for each in found] == ["RARMS411"] * 2
    assert [each.detail for each in found] == [
        "ears is missing in /opt/robot on onboard.",
        "eyes differs in /opt/robot on onboard.",
    ]
