"""Every command that a message recommends works in the situation that the message is about.

A situation is a folder, made by commands and files, and one command more, whose output recommends something. What
stands there between backticks and begins with `rarms` is run as it is printed, each in a copy of that folder.
"""

import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterable
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path

import pytest

from rarms_iac.cli.codes import ExitCode
from rarms_iac.storage.datalog.files import append_setting
from rarms_iac.storage.datalog.log import Recorded
from tests.builders_measured import a_series, a_setting
from tests.crashing import KILLED
from tests.files import copy_files
from tests.measuring import TAKEN, leave_logs
from tests.needs import CHECKOUT
from tests.unit.cli.running import rarms

MANIFEST = """\
schema: rarms/v1
application: { name: robot }
hosts:
  onboard: { logical_processors: 2, memory: 4 GiB }
components:
  vision:
    criticality: 30
    apt: { mean_response_time: { at_most: 50 ms } }
    run: { command: [vision], until: { samples: 60 }, samples: { from: per_run } }
    cpu: { reserve: 45 % }
    memory: 512 MiB
    simulation: { work: 20 ms, varies: 2 % }
  speech: { criticality: 5, memory: 512 MiB, cpu: { reserve: 20 % }, simulation: { work: 1 ms } }
"""
MEASURED = MANIFEST.replace("45 %", "measured")
ALONE = MANIFEST[: MANIFEST.index("  speech")]

PAIR = f"""{MEASURED[: MEASURED.index("  speech")]}\
  speech:
    criticality: 5
    apt: {{ mean_response_time: {{ at_most: 100 ms }} }}
    run: {{ command: [speech], until: {{ samples: 60 }}, samples: {{ from: per_run }} }}
    cpu: {{ reserve: measured }}
    memory: 512 MiB
    simulation: {{ work: 1 ms, varies: 2 % }}
"""

PROGRAM = ALONE.replace("command: [vision]", "command: [python3, -c, pass]").replace("samples: 60", "samples: 2")
PROGRAM = PROGRAM[: PROGRAM.index("    simulation")]

ASKS = {"apply", "undo", "stop", "start", "import", "release", "destroy"}
"""Commands that ask before they change a host."""

WORKS = {ExitCode.DONE, ExitCode.FOUND, ExitCode.NOT_APPLIED}
"""Done, or a plan or drift that is not empty."""


def write(text: str) -> Callable[[], None]:
    """What writes the manifest."""

    def write_manifest() -> None:
        Path("rarms.yaml").write_text(text, encoding="utf-8", newline="\n")

    return write_manifest


def do(*words: str) -> Callable[[], None]:
    """What runs a command that must work."""

    def run() -> None:
        ran = rarms(*words)
        assert ran.code in WORKS, (words, ran.err)

    return run


def put(name: str, text: str) -> None:
    """Write a file."""
    Path(name).write_text(text, encoding="utf-8")


def edit(name: str, before: str, after: str) -> Callable[[], None]:
    """What changes a word of a file."""
    return lambda: put(name, Path(name).read_text(encoding="utf-8").replace(before, after))


def move(name: str, folder: str) -> Callable[[], None]:
    """What moves a file into a new folder."""

    def into() -> None:
        Path(folder).mkdir()
        Path(name).rename(Path(folder, name))

    return into


APPLY = do("apply", "--auto-approve")


def killed(*words: str, at: int) -> Callable[[], None]:
    """What runs a command as a process that ends without clean-up at its effect of this number."""

    def run() -> None:
        folder = str(Path.cwd())
        command = [sys.executable, "-m", "tests.crashing", str(at), "after", *words, "-f", folder]
        ended = subprocess.run(command, cwd=CHECKOUT, capture_output=True, encoding="utf-8", timeout=120)
        assert ended.returncode == KILLED, ended.stderr

    return run


def logs(**least: int) -> Callable[[], None]:
    """What leaves data logs that need so many per cent."""
    return lambda: leave_logs(Path(), least)


def drifting(component: str, reserves: Iterable[int]) -> Callable[[], None]:
    """What adds settings to a data log at which each job takes longer than the one before, whatever it reserves."""

    def append() -> None:
        log = Path("measurements", "onboard", component, "busy-loop.jsonl")
        slower = a_series(component, [20 + 0.4 * job for job in range(60)])
        for reserve in reserves:
            append_setting(log, Recorded(setting=a_setting(reserve, slower), provenance=TAKEN))

    return append


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """How it comes about, the command whose message is read, and what that must recommend at least."""

    steps: tuple[Callable[[], None], ...]
    words: tuple[str, ...]
    says: str  # a finding's id, or words of the message
    recommends: tuple[str, ...]
    asked: bool = False  # the message comes from a question at a terminal
    may_answer: ExitCode = (
        ExitCode.DONE
    )  # also what a command that is recommended may end with: a plan that says why not


SITUATIONS = {
    "nothing is measured": Situation(
        steps=(write(MEASURED),), words=("plan",), says="RARMS100", recommends=("rarms measure vision",)
    ),
    "nothing is measured that a page could show": Situation(
        steps=(write(MEASURED),), words=("report",), says="no data log", recommends=("rarms measure",)
    ),
    "partitions run where it is measured": Situation(
        steps=(write(MANIFEST), APPLY),
        words=("measure", "vision", "--from", "50%", "--to", "50%"),
        says="RARMS115",
        recommends=("rarms measure --stop-partitions", "rarms stop", "rarms start"),
    ),
    "a partition was stopped": Situation(
        steps=(write(MANIFEST), APPLY, do("stop", "vision", "--auto-approve")),
        words=("plan",),
        says="stays stopped",
        recommends=("rarms start vision",),
    ),
    "a stopped partition would be proven": Situation(
        steps=(write(MANIFEST), APPLY, do("stop", "--auto-approve")),
        words=("prove",),
        says="stopped by rarms",
        recommends=("rarms start speech vision",),
    ),
    "nothing is applied that could be proven": Situation(
        steps=(write(MANIFEST),), words=("prove",), says="on no host", recommends=("rarms plan", "rarms apply")
    ),
    "an APT is missed in the layout": Situation(
        steps=(write(ALONE.replace("45 %", "10 %")), APPLY),
        words=("prove", "--interference", "busy-loop"),
        says="its threshold is",
        recommends=("rarms measure vision --again --stop-partitions",),
    ),
    "an apply was killed": Situation(
        steps=(write(MANIFEST), killed("apply", "--auto-approve", at=20)),
        words=("plan",),
        says="RARMS183",
        recommends=("rarms apply", "rarms undo", "rarms apply --abandon"),
    ),
    "a measurement was killed that had stopped partitions": Situation(
        steps=(
            write(MANIFEST),
            APPLY,
            killed("measure", "vision", "--from", "50%", "--to", "50%", "--stop-partitions", at=30),
        ),
        words=("drift",),
        says="A run is unfinished on onboard",
        recommends=("rarms apply",),
    ),
    "a plan was used": Situation(
        steps=(write(MANIFEST), do("plan", "--out", "a.plan"), APPLY, do("destroy", "--auto-approve")),
        words=("apply", "a.plan"),
        says="was applied to onboard, or another",
        recommends=("rarms plan --out FILE",),
    ),
    "a partition is no longer wanted": Situation(
        steps=(write(MANIFEST), APPLY, write(ALONE), APPLY),
        words=("plan",),
        says="is unused and stopped",
        recommends=("rarms destroy --target partition/speech",),
    ),
    "a machine that is not managed has a wanted name": Situation(
        steps=(write(MANIFEST), APPLY, do("release", "vision", "--auto-approve")),
        words=("plan",),
        says="RARMS150",
        recommends=("rarms import vision --id",),
    ),
    "there is no terminal to ask at": Situation(
        steps=(write(MANIFEST),),
        words=("apply",),
        says="no terminal",
        recommends=("rarms plan --out FILE", "rarms apply FILE"),
    ),
    "a question was answered with no": Situation(
        steps=(write(MANIFEST),), words=("apply",), says="Nothing was changed", recommends=("rarms plan",), asked=True
    ),
    "the host is not as the manifest wants it": Situation(
        steps=(write(MANIFEST), APPLY, write(MANIFEST.replace("45 %", "40 %"))),
        words=("drift",),
        says="as the manifest wants",
        recommends=("rarms plan",),
    ),
    "no measured setting is enough": Situation(
        steps=(write(MEASURED), do("measure", "vision", "--from", "10%", "--to", "20%")),
        words=("plan",),
        says="RARMS10",
        recommends=("rarms measure vision",),
    ),
    "a level needs more than was measured": Situation(
        steps=(write(MEASURED), do("measure", "vision", "--from", "10%", "--to", "20%")),
        words=("select", "vision", "--at", "60 ms"),
        says="measure higher settings",
        recommends=("rarms measure vision --from 21% --to 100%",),
    ),
    "reservations exceed the host": Situation(
        steps=(
            write(MEASURED.replace("20 %", "30 %")),
            logs(vision=85),
        ),
        words=("plan",),
        says="RARMS014",
        recommends=("rarms measure",),
    ),
    "a pair would fit": Situation(
        steps=(write(PAIR), logs(vision=60, speech=60)),
        words=("plan",),
        says="RARMS014",
        recommends=("rarms tune",),
    ),
    "a component cannot use its processors": Situation(
        steps=(write(MEASURED.replace("samples: 60", "samples: 40").replace("varies: 2 %", "varies: 0 %")),),
        words=("measure", "vision"),
        says="and measures again",
        recommends=("rarms measure vision --write-processors",),
    ),
    "settings below have no steady state": Situation(
        steps=(
            write(MEASURED),
            do("measure", "vision", "--from", "10%", "--to", "60%", "--step", "50%"),
            drifting("vision", range(11, 60)),
        ),
        words=("measure", "vision"),
        says="RARMS267",
        recommends=("rarms measure vision --again --samples 2000",),
    ),
    "there is no manifest": Situation(steps=(), words=("plan",), says="with `-f PATH`", recommends=("rarms init",)),
    "the manifest is empty": Situation(
        steps=(write("\n  \n"),), words=("validate",), says="The file has no content", recommends=("rarms init",)
    ),
    "the manifest begins with a byte order mark": Situation(
        steps=(write("\ufeff" + MANIFEST),), words=("validate",), says="RARMS006", recommends=("rarms fmt",)
    ),
    "an error is accepted that cannot be": Situation(
        steps=(
            write(
                MANIFEST
                + "policy: { accept: { RARMS014: { at: [component/vision], reason: known, until: 2099-01-01 } } }\n"
            ),
        ),
        words=("plan",),
        says="acceptance",
        recommends=("rarms explain RARMS014",),
    ),
    "somebody changed a partition": Situation(
        steps=(write(MANIFEST), APPLY, do("simulate", "change", "vision", "--reserve", "30")),
        words=("plan", "--verbose"),
        says="This plan makes it as the manifest wants it",
        recommends=("rarms drift", "rarms history"),
    ),
    "the host moved since the plan was made": Situation(
        steps=(
            write(MANIFEST),
            do("plan", "--out", "a.plan"),
            APPLY,
            write(MANIFEST.replace("45 %", "40 %")),
            do("plan", "--out", "a.plan"),
            do("simulate", "change", "vision", "--reserve", "30"),
        ),
        words=("apply", "a.plan"),
        says="no longer as the plan saw it",
        recommends=("rarms drift",),
    ),
    "a plan was edited": Situation(
        steps=(write(MANIFEST), do("plan", "--out", "a.plan"), edit("a.plan", "vision", "Vision")),
        words=("apply", "a.plan"),
        says="it was edited",
        recommends=("rarms plan --out FILE",),
    ),
    "a file is no plan": Situation(
        steps=(write(MANIFEST),),
        words=("apply", "rarms.yaml"),
        says="not a plan",
        recommends=("rarms plan --out FILE",),
    ),
    "the manifest changed since the plan was made": Situation(
        steps=(write(MANIFEST), do("plan", "--out", "a.plan"), write(MANIFEST.replace("45 %", "40 %"))),
        words=("apply", "a.plan"),
        says="has changed since plan",
        recommends=("rarms plan",),
    ),
    "a plan is applied elsewhere": Situation(
        steps=(write(MANIFEST), do("plan", "--out", "a.plan"), move("rarms.yaml", "robot")),
        words=("apply", "a.plan"),
        says="which is not here",
        recommends=("rarms apply PLAN -f MANIFEST",),
    ),
    "a target is not in the plan": Situation(
        steps=(write(MANIFEST),),
        words=("plan", "--target", "partition/sight"),
        says="no change has this address",
        recommends=("rarms plan --verbose",),
    ),
    "a component cannot run on its host": Situation(
        steps=(write(PROGRAM),), words=("measure", "vision"), says="cannot run vision", recommends=("rarms run",)
    ),
    "a snapshot cannot be read": Situation(
        steps=(write(MANIFEST), lambda: put("host.json", "nothing")),
        words=("plan", "--snapshot", "host.json"),
        says="Make one with",
        recommends=("rarms snapshot --host NAME --out FILE", "rarms snapshot --script"),
    ),
    "late jobs may be later beside other partitions": Situation(
        steps=(write(MANIFEST.replace("mean_response_time", "p95_response_time").replace("45 %", "70 %")), APPLY),
        words=("plan", "--verbose"),
        says="RARMS313",
        recommends=("rarms prove --interference busy-loop",),
    ),
    "nothing was tuned": Situation(
        steps=(write(PAIR), logs(vision=30, speech=30)),
        words=("explain", "vision"),
        says="has measured nothing",
        recommends=("rarms tune",),
    ),
    "fixed reserves exceed the host": Situation(
        steps=(write(MANIFEST.replace("45 %", "90 %")),),
        words=("tune",),
        says="The manifest fixes all reserves",
        recommends=("rarms plan",),
        may_answer=ExitCode.NO,
    ),
    "no component is wanted any more": Situation(
        steps=(write(MANIFEST), APPLY, write(MANIFEST[: MANIFEST.index("components")] + "components: {}\n")),
        words=("plan",),
        says="describes no component",
        recommends=("rarms destroy",),
    ),
    "the application is looked at after a stop": Situation(
        steps=(write(MANIFEST), APPLY, do("stop", "vision", "--auto-approve")),
        words=("status",),
        says="stopped by",
        recommends=("rarms stop", "rarms start vision"),
    ),
    "both names of a move are on the host": Situation(
        steps=(
            write(MANIFEST),
            APPLY,
            write(MANIFEST.replace("  vision:", "  sight: { criticality: 1, cpu: { reserve: 1 % } }\n  vision:")),
            APPLY,
            write(MANIFEST.replace("  speech:", "  sight:") + "moved: { speech: sight }\n"),
        ),
        words=("plan",),
        says="RARMS156",
        recommends=("rarms destroy --target partition/speech",),
    ),
}


def recommended(text: str) -> tuple[str, ...]:
    """The commands that a text recommends, as printed; a line's end in one is a blank."""
    found = (" ".join(match.split()) for match in re.findall(r"`(rarms [a-z][^`]*)`", text))
    return tuple(dict.fromkeys(command for command in found if "..." not in command))


def made(situation: Situation, folder: Path) -> str:
    """Bring the situation about in this folder; what its command says."""
    with chdir(folder):
        for step in situation.steps:
            step()
        ran = rarms(*situation.words, stdin="no\n", at_a_terminal=situation.asked)
    return " ".join(re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", ran.out + ran.err).split())


def run_as_printed(command: str, folder: Path, may_answer: ExitCode = ExitCode.DONE) -> None:
    """Run it; what asks is told not to, and a FILE is one that is there where it is read."""
    places = {"FILE": "a.plan", "PLAN": "a.plan", "MANIFEST": "robot", "NAME": "onboard"}
    words = [places.get(word, word) for word in shlex.split(command)[1:]]
    with chdir(folder):
        if words[0] == "apply" and "a.plan" in words and not Path("a.plan").exists():
            do("plan", "--out", "a.plan")()
        elif words[0] in ASKS and "--abandon" not in words:
            words.append("--auto-approve")
        ran = rarms(*words)
    assert ran.code in {*WORKS, may_answer}, f"`{command}`: exit {ran.code}\n{ran.out}{ran.err}"


@pytest.mark.parametrize("situation", SITUATIONS.values(), ids=SITUATIONS.keys())
def test_what_is_recommended_works_where_it_is_recommended(situation: Situation, tmp_path: Path) -> None:
    origin = tmp_path / "origin"
    origin.mkdir()

    says = made(situation, origin)

    assert situation.says in says
    commands = recommended(says)
    for wanted in situation.recommends:
        assert any(command.startswith(wanted) for command in commands), (wanted, commands, says)
    for number, command in enumerate(commands):
        folder = tmp_path / f"copy-{number}"
        copy_files(origin, folder)
        run_as_printed(command, folder, situation.may_answer)


def test_a_manifest_that_was_named_is_named_in_what_is_recommended(tmp_path: Path) -> None:
    folder = tmp_path / "my robot"
    folder.mkdir()
    with chdir(folder):
        write(MEASURED)()
    Path(tmp_path, "test.yaml").write_text("policy: { headroom: none }\n", encoding="utf-8")

    with chdir(tmp_path):
        ran = rarms("plan", "-f", "my robot", "--overlay", "test.yaml")
    commands = recommended(ran.err)

    assert "rarms measure vision -f 'my robot' --overlay test.yaml" in commands
    for command in commands:
        run_as_printed(command, tmp_path)


def test_a_machine_that_is_another_partition_is_released_as_recommended(tmp_path: Path) -> None:
    with chdir(tmp_path):
        write(MANIFEST)()
        APPLY()
        unknown = rarms("import", "speech", "--id", "none", "--auto-approve")
        (machine,) = re.findall(r"vision ([0-9a-f-]{36})", unknown.err)
        taken = rarms("import", "speech", "--id", machine, "--auto-approve")

    assert 'is partition "vision" of application' in taken.err
    assert recommended(taken.err) == ("rarms release vision",)
    run_as_printed("rarms release vision", tmp_path)
