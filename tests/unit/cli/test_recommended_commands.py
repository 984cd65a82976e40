"""Every command that a message recommends works in the situation that the message is about.

A situation is a folder, made by commands and files, and one command more, whose findings recommend something. Each of
their `commands` is run, in a copy of that folder.
"""

import ast
import json
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import chdir
from dataclasses import KW_ONLY, dataclass, replace
from functools import cache
from pathlib import Path

import pytest

import rarms_iac
from rarms_iac.cli.ending import ExitCode
from rarms_iac.model import commands
from rarms_iac.storage.datalog.files import append_setting, begin_log, read_log
from tests.crashing import KILLED
from tests.files import copy_files
from tests.measuring import leave_logs
from tests.needs import CHECKOUT
from tests.unit.cli.running import rarms

MANIFEST = """\
schema: rarms/v1
application: { name: robot }
policy: { interference: busy-loop }
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
  speech: { criticality: 5, memory: 512 MiB, cpu: { reserve: 20 % }, simulation: { work: 20 ms } }
"""
MEASURED = MANIFEST.replace("45 %", "measured")
WIDE = MEASURED.replace("    cpu: { reserve: measured", "    processors: 2\n    cpu: { reserve: measured")
ALONE = MANIFEST[: MANIFEST.index("  speech")]
PROTECTED = MANIFEST + "partitions:\n  speech: { protect: true }\n"

PAIR = f"""{MEASURED[: MEASURED.index("  speech")]}\
  speech:
    criticality: 5
    apt: {{ mean_response_time: {{ at_most: 50 ms }} }}
    run: {{ command: [speech], until: {{ samples: 60 }}, samples: {{ from: per_run }} }}
    cpu: {{ reserve: measured }}
    memory: 512 MiB
    simulation: {{ work: 10 ms, varies: 2 % }}
"""


THIRD = PAIR[PAIR.index("  speech") :].replace("speech", "video")

LOG = "measurements/onboard/vision/busy-loop.jsonl"

LATE = MEASURED.replace("mean_response_time", "p95_response_time").replace("50 ms", "90 ms").replace("60 }", "400 }")

TWO_HOSTS = """\
schema: rarms/v1
application: { name: robot }
hosts:
  fore: { logical_processors: 2, memory: 4 GiB }
  aft: { logical_processors: 2, memory: 4 GiB }
components:
  vision: { criticality: 30, memory: 512 MiB, hosts: [fore], cpu: { reserve: 45 % } }
  speech: { criticality: 5, memory: 512 MiB, hosts: [aft], cpu: { reserve: 20 % } }
"""
PROGRAM = ALONE.replace("command: [vision]", "command: [python3, -c, pass]").replace("samples: 60", "samples: 2")
PROGRAM = PROGRAM[: PROGRAM.index("    simulation")]

ASKS = {"apply", "undo", "stop", "start", "import", "release", "destroy"}
"""Commands that ask before they change a host."""

WORKS = {ExitCode.DONE, ExitCode.FOUND, ExitCode.NOT_APPLIED}
"""Done, or a plan or drift that is not empty."""


@cache
def write(text: str) -> Callable[[], None]:
    """What writes the manifest."""

    def write_manifest() -> None:
        Path("rarms.yaml").write_text(text, encoding="utf-8", newline="\n")

    return write_manifest


@cache
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


@cache
def killed(*words: str, at: int) -> Callable[[], None]:
    """What runs a command as a process that ends without clean-up at its effect of this number."""

    def run() -> None:
        folder = str(Path.cwd())
        command = [sys.executable, "-m", "tests.crashing", str(at), "after", *words, "-f", folder]
        ended = subprocess.run(command, cwd=CHECKOUT, capture_output=True, encoding="utf-8", timeout=120)
        assert ended.returncode == KILLED, ended.stderr

    return run


def weak_log() -> None:
    """Have the data log say that its load left processors idle."""
    log = read_log(Path(LOG))
    assert log is not None
    begin_log(Path(LOG), log.header)
    for recorded in log.recorded:
        append_setting(Path(LOG), replace(recorded, provenance=replace(recorded.provenance, weak_load=True)))


@cache
def logs(**least: int) -> Callable[[], None]:
    """What leaves data logs that need so many per cent."""
    return lambda: leave_logs(Path(), least)


@dataclass(frozen=True, slots=True)
class Situation:
    """How it comes about, the command whose answer is read, and what that must recommend at least."""

    steps: tuple[Callable[[], None], ...]
    words: str
    messages: tuple[str, ...]  # words of each message that recommends something
    recommends: tuple[str, ...]
    _: KW_ONLY
    in_view: bool = False  # a view makes the sentence of facts, so that only a person reads it
    first: tuple[Callable[[], None], ...] = ()  # what the message says is to be done before the command
    asked: bool = False  # the message comes from a question at a terminal
    may_answer: ExitCode = ExitCode.DONE  # also how a command that is recommended may end: a plan that says why not


SITUATIONS = {
    "nothing is measured": Situation((write(MEASURED),), "plan", ("Or fix it for now",), ("rarms measure vision",)),
    "nothing is measured that a page could show": Situation(
        (write(MEASURED),), "report", ("Measure first: ",), ("rarms measure",)
    ),
    "partitions run where it is measured": Situation(
        (write(MANIFEST), APPLY),
        "measure vision --from 50% --to 50%",
        ("stop them and start them again afterwards",),
        ("rarms measure --stop-partitions", "rarms stop", "rarms start"),
    ),
    "a partition was stopped": Situation(
        (write(MANIFEST), APPLY, do("stop", "vision", "--auto-approve")),
        "plan",
        ("stays stopped",),
        ("rarms start vision",),
        in_view=True,
    ),
    "a stopped partition would be proven": Situation(
        (write(MANIFEST), APPLY, do("stop", "--auto-approve")),
        "prove --load-host",
        ("Start them, and prove again",),
        ("rarms start speech vision",),
    ),
    "a partition that is started by hand would be proven": Situation(
        (write(ALONE.replace("components:", "partitions: { vision: { start: manual } }\ncomponents:", 1)), APPLY),
        "prove --load-host",
        ("These partitions do not run: vision.",),
        ("rarms start vision",),
    ),
    "nothing is applied that could be proven": Situation(
        (write(MANIFEST),), "prove --load-host", ("See what is missing with",), ("rarms plan", "rarms apply")
    ),
    "an APT is missed in the layout": Situation(
        (write(ALONE.replace("45 %", "10 %")), APPLY),
        "prove --load-host",
        ("Its slowdown asks for", "Or measure what it needs"),
        ("rarms measure vision --again --stop-partitions",),
    ),
    "an apply was killed": Situation(
        (write(MANIFEST), killed("apply", "--auto-approve", at=20)),
        "plan",
        ("or `rarms apply --abandon` to leave it as it is",),
        ("rarms apply", "rarms undo", "rarms apply --abandon"),
    ),
    "a measurement was killed that had stopped partitions": Situation(
        (
            write(MANIFEST),
            APPLY,
            killed("measure", "vision", "--from", "50%", "--to", "50%", "--stop-partitions", at=30),
        ),
        "drift",
        ("A run is unfinished on ",),
        ("rarms apply",),
        in_view=True,
    ),
    "a plan was used": Situation(
        (write(MANIFEST), do("plan", "--out", "a.plan"), APPLY, do("destroy", "--auto-approve")),
        "apply a.plan",
        ("Make a new plan: `rarms plan --out FILE`",),
        ("rarms plan --out FILE",),
    ),
    "a protected partition is no longer named": Situation(
        (write(PROTECTED), APPLY, write(ALONE)),
        "plan",
        ("or let it go on without rarms: ",),
        ("rarms release speech",),
    ),
    "a machine that is not managed has a wanted name": Situation(
        (write(MANIFEST), APPLY, do("release", "vision", "--auto-approve")),
        "plan",
        (" to take it over, or give the partition another name",),
        ("rarms import vision --id",),
    ),
    "there is no terminal to ask at": Situation(
        (write(MANIFEST),),
        "apply",
        ("or write the plan down, have it reviewed, and apply that",),
        ("rarms plan --out FILE", "rarms apply FILE"),
    ),
    "a question was answered with no": Situation(
        (write(MANIFEST),), "apply", ("Run it again to be asked again",), ("rarms plan",), asked=True
    ),
    "the host is not as the manifest wants it": Situation(
        (write(MANIFEST), APPLY, write(MANIFEST.replace("45 %", "40 %"))),
        "drift",
        ("as the manifest wants",),
        ("rarms plan",),
        in_view=True,
    ),
    "no measured setting is enough": Situation(
        (write(MEASURED), do("measure", "vision", "--from", "10%", "--to", "20%")),
        "plan",
        ("says which level holds), or measure higher settings",),
        ("rarms measure vision",),
    ),
    "a level needs more than was measured": Situation(
        (write(MEASURED), do("measure", "vision", "--from", "10%", "--to", "20%")),
        "select vision --at '60 ms'",
        ("measure higher settings",),
        ("rarms measure vision --from 21% --to 100%",),
    ),
    "reservations exceed the host": Situation(
        (write(MEASURED.replace("20 %", "30 %")), logs(vision=85)), "plan", ("RARMS014",), ("rarms measure",)
    ),
    "a pair would fit": Situation((write(PAIR), logs(vision=60, speech=60)), "plan", ("RARMS014",), ("rarms tune",)),
    "a component does not use its processors": Situation(
        (write(WIDE.replace("samples: 60", "samples: 40").replace("varies: 2 %", "varies: 0 %")),),
        "measure vision",
        ("Leave `processors` out",),
        ("rarms measure vision",),
    ),
    "there is no manifest": Situation((), "plan", ("`-f PATH` names a manifest or its folder",), ("rarms init",)),
    "the manifest is empty": Situation(
        (write("\n  \n"),), "validate", ("Write a manifest, or let `rarms init` write one",), ("rarms init",)
    ),
    "the manifest begins with a byte order mark": Situation(
        (write("\ufeff" + MANIFEST),), "validate", ("or let `rarms fmt rarms.yaml` do it",), ("rarms fmt rarms.yaml",)
    ),
    "an error is accepted that cannot be": Situation(
        (
            write(
                MANIFEST.replace(
                    "interference: busy-loop",
                    "accept: { RARMS014: { at: [component/vision], reason: known, until: 2099-01-01 } }",
                )
            ),
        ),
        "plan",
        ("acceptance",),
        ("rarms explain RARMS014",),
    ),
    "another tool changed a partition": Situation(
        (write(MANIFEST), APPLY, do("simulate", "change", "vision", "--reserve", "30")),
        "plan --verbose",
        ("Find out who did it",),
        ("rarms drift", "rarms history"),
    ),
    "the host moved since the plan was made": Situation(
        (
            write(MANIFEST),
            do("plan", "--out", "a.plan"),
            APPLY,
            write(MANIFEST.replace("45 %", "40 %")),
            do("plan", "--out", "a.plan"),
            do("simulate", "change", "vision", "--reserve", "30"),
        ),
        "apply a.plan",
        ("Nothing was changed. Look with `rarms drift`",),
        ("rarms drift",),
    ),
    "a plan was edited": Situation(
        (write(MANIFEST), do("plan", "--out", "a.plan"), edit("a.plan", "vision", "Vision")),
        "apply a.plan",
        ("Make the plan again: `rarms plan --out FILE`",),
        ("rarms plan --out FILE",),
    ),
    "a file is no plan": Situation(
        (write(MANIFEST),),
        "apply rarms.yaml",
        ("Give a file that `rarms plan --out FILE` wrote",),
        ("rarms plan --out FILE",),
    ),
    "the manifest changed since the plan was made": Situation(
        (write(MANIFEST), do("plan", "--out", "a.plan"), write(MANIFEST.replace("45 %", "40 %"))),
        "apply a.plan",
        ("See what the manifest asks for now with",),
        ("rarms plan",),
    ),
    "a plan is applied elsewhere": Situation(
        (write(MANIFEST), do("plan", "--out", "a.plan"), move("rarms.yaml", "robot")),
        "apply a.plan",
        ("Apply the plan in the folder where it was made",),
        ("rarms apply PLAN -f MANIFEST",),
    ),
    "a target is not in the plan": Situation(
        (write(MANIFEST),),
        "plan --target partition/sight",
        ("(`rarms plan --verbose` lists them)",),
        ("rarms plan --verbose",),
    ),
    "a component cannot run on its host": Situation(
        (write(PROGRAM),), "measure vision", ("on a real host: `rarms run COMPONENT` tries it",), ("rarms run",)
    ),
    "a snapshot cannot be read": Situation(
        (write(MANIFEST), lambda: put("host.json", "nothing")),
        "plan --snapshot host.json",
        ("Make one with",),
        ("rarms snapshot --host NAME --out FILE", "rarms snapshot --script"),
    ),
    "late jobs may be later beside other partitions": Situation(
        (write(LATE), do("measure", "vision")), "plan", ("whether it holds",), ("rarms prove",), first=(APPLY,)
    ),
    "a threshold depends on its neighbours": Situation(
        (write(LATE.replace("busy-loop", "bursts-20")), do("measure", "vision")),
        "plan",
        ("Prove it in the layout that is applied",),
        ("rarms prove",),
        first=(APPLY,),
    ),
    "all loads are weak": Situation(
        (write(MEASURED.replace("busy-loop", "bursts-20-half")),),
        "measure vision",
        ("Name `busy-loop` in `policy.interference`",),
        ("rarms measure vision --interference busy-loop",),
    ),
    "the busy loop is weak itself": Situation(
        (write(f"{MEASURED}interference: {{ busy-loop: {{ kind: busy_loop, threads: 1 }} }}\n"),),
        "measure vision",
        ("Let `interference.busy-loop` be a busy loop without `threads`",),
        ("rarms measure vision --interference busy-loop",),
        may_answer=ExitCode.NO,
    ),
    "a load was seen to leave processors idle": Situation(
        (write(ALONE.replace("45 %", "measured")), do("measure"), weak_log),
        "plan",
        ("`busy-loop` has a thread for each of the 2 LP and was kept from running on them",),
        ("rarms measure --interference busy-loop --again",),
    ),
    "nothing was tuned": Situation(
        (write(PAIR), logs(vision=30, speech=30)),
        "explain vision",
        ("has measured nothing",),
        ("rarms tune",),
        in_view=True,
    ),
    "fixed reserves exceed the host": Situation(
        (write(MANIFEST.replace("45 %", "90 %")),),
        "tune",
        ("Lower a reserve (`rarms plan` names ways out)",),
        ("rarms plan",),
        may_answer=ExitCode.NO,
    ),
    "no component is wanted any more": Situation(
        (write(MANIFEST), APPLY, write(MANIFEST[: MANIFEST.index("components")] + "components: {}\n")),
        "plan",
        ("To remove everything, use",),
        ("rarms destroy",),
    ),
    "the application is looked at after a stop": Situation(
        (write(MANIFEST), APPLY, do("stop", "vision", "--auto-approve")),
        "status",
        ("stopped by",),
        ("rarms start vision",),
        in_view=True,
    ),
    "both names of a move are on the host": Situation(
        (
            write(MANIFEST),
            APPLY,
            write(MANIFEST.replace("  vision:", "  sight: { criticality: 1, cpu: { reserve: 1 % } }\n  vision:")),
            APPLY,
            write(MANIFEST.replace("  speech:", "  sight:") + "moved: { speech: sight }\n"),
        ),
        "plan",
        ("Remove one of them (",),
        ("rarms destroy --target partition/speech",),
    ),
    "a data log is damaged": Situation(
        (write(MEASURED), logs(vision=45), lambda: put(LOG, '{"a": 1}\n{"b": 1}\n')),
        "plan",
        ("Bring it back from git, or remove it and measure again",),
        ("rarms measure vision",),
        first=(Path(LOG).unlink,),
    ),
    "what was measured is not what the manifest says now": Situation(
        (write(MEASURED), logs(vision=45), edit("rarms.yaml", "work: 20 ms", "work: 21 ms")),
        "plan",
        ("Or take the change back.",),
        ("rarms measure vision",),
    ),
    "it was measured beside what runs on the host": Situation(
        (
            write(MANIFEST.replace("45 %", "10 %").replace("20 %", "10 %")),
            APPLY,
            write(MEASURED),
            do("measure", "vision", "--on-busy-host", "--from", "40%", "--to", "60%", "--step", "20%"),
        ),
        "plan",
        ("Measure it once more with the host to itself",),
        ("rarms measure vision --again",),
        first=(do("stop", "--auto-approve"),),
    ),
    "fixed reserves exceed the host that is declared": Situation(
        (write(MANIFEST.replace("45 %", "90 %")),),
        "validate",
        ("`rarms plan` tries which change would be enough",),
        ("rarms plan",),
        may_answer=ExitCode.NO,
    ),
    "nothing is measured, and the manifest is checked": Situation(
        (write(MEASURED),), "validate", ("`rarms measure` finds what it needs",), ("rarms measure",)
    ),
    "a component is not in the manifest": Situation(
        (write(MANIFEST),), "measure nobody", ("--help` lists what it takes",), ("rarms measure --help",)
    ),
    "an option does not exist": Situation(
        (write(MANIFEST),), "plan --nothing", ("--help` lists what it takes",), ("rarms plan --help",)
    ),
    "a plan file is not there": Situation(
        (write(MANIFEST),), "apply a.plan", ("Look at the path and its rights",), ("rarms plan --out FILE",)
    ),
    "a script is none": Situation(
        (write(MANIFEST), lambda: put("a.ps1", "exit")),
        "show --check a.ps1",
        ("Give a script that",),
        ("rarms show --script --out FOLDER", "rarms snapshot --script"),
    ),
    "no pair may be combined": Situation(
        (
            write(PAIR.replace("    memory", "    apart: [vision]\n    memory", 2).replace("    apart", "#", 1)),
            logs(vision=60, speech=60),
        ),
        "tune",
        ("Relax an APT (",),
        ("rarms select COMPONENT --at LEVEL",),
    ),
    "a log has no setting": Situation(
        (
            write(MEASURED),
            logs(vision=45),
            lambda: put(LOG, Path(LOG).read_text(encoding="utf-8").split("\n")[0] + "\n"),
        ),
        "plan",
        ("Measure it: ",),
        ("rarms measure vision",),
    ),
    "an interactive session has no terminal": Situation(
        (write(MEASURED), logs(vision=45)),
        "measure --interactive",
        ("Leave --interactive out, and choose with",),
        ("rarms select COMPONENT --at LEVEL",),
    ),
    "the manifest has only comments": Situation(
        (write("# nothing\n"),),
        "validate",
        ("Write a manifest, or move the file away",),
        ("rarms init",),
        first=(Path("rarms.yaml").unlink,),
    ),
    "what is formatted has only comments": Situation(
        (write("# nothing\n"),),
        "fmt",
        ("Write a manifest, or move the file away",),
        ("rarms init",),
        first=(Path("rarms.yaml").unlink,),
    ),
    "a component without a threshold is to be measured": Situation(
        (write(MANIFEST),),
        "measure speech",
        ("Give it one, or measure chosen settings",),
        ("rarms measure speech --from 10% --to 100%",),
    ),
    "no setting can be enough": Situation(
        (write(MEASURED.replace("50 ms", "5 ms")),),
        "measure vision",
        ("says which level holds)",),
        ("rarms select vision --at LEVEL",),
    ),
    "a plan is of another format": Situation(
        (
            write(MANIFEST),
            do("plan", "--out", "a.plan"),
            edit("a.plan", '"format_version":', '"format_version": "of old", "was":'),
        ),
        "apply a.plan",
        ("Make the plan again with this version of rarms",),
        ("rarms plan --out FILE",),
    ),
    "a file of another kind is no plan": Situation(
        (write(MANIFEST), lambda: put("a.plan", "{}")),
        "apply a.plan",
        ("Give a file that `rarms plan --out FILE` wrote",),
        ("rarms plan --out FILE",),
    ),
    "drift is looked for, and the manifest has errors": Situation(
        (
            write(MANIFEST),
            APPLY,
            write(MANIFEST.replace("45 %", "90 %")),
            do("simulate", "change", "vision", "--reserve", "30"),
        ),
        "drift",
        ("The manifest was not compared",),
        ("rarms plan",),
        may_answer=ExitCode.NO,
        in_view=True,
    ),
    "a host moved while a run was unfinished": Situation(
        (
            write(MANIFEST),
            APPLY,
            write(MANIFEST.replace("45 %", "40 %").replace("20 %", "10 %")),
            killed("apply", "--auto-approve", at=8),
            do("simulate", "change", "vision", "--reserve", "30"),
        ),
        "apply",
        ("Nothing more was changed. Look with `rarms drift`.",),
        ("rarms drift", "rarms undo", "rarms apply --abandon"),
        may_answer=ExitCode.REFUSED,
    ),
    "an apply cannot be taken back wholly": Situation(
        (write(MANIFEST), APPLY, do("destroy", "--auto-approve")),
        "undo --auto-approve",
        ("rarms cannot bring that back. Afterwards `rarms plan` says what differs",),
        ("rarms plan",),
    ),
    "one that is not managed gets less": Situation(
        (
            write(MANIFEST),
            APPLY,
            do("release", "vision", "--auto-approve"),
            write(MANIFEST.replace("vision:", "sight:").replace("20 %", "30 %").replace("45 %", "20 %")),
        ),
        "plan --verbose",
        ("or take it in: ",),
        ("rarms import PARTITION --id ID",),
        first=(edit("rarms.yaml", "sight", "vision"),),
    ),
    "a run is unfinished, and the status says so": Situation(
        (write(MANIFEST), killed("apply", "--auto-approve", at=20)),
        "status",
        ("finishes the run on",),
        ("rarms apply",),
    ),
    "nothing is measured, and the status says so": Situation(
        (write(MEASURED),), "status", ("that are not measured yet",), ("rarms measure",)
    ),
    "another tool changed a host, and the status says so": Situation(
        (write(MANIFEST), APPLY, do("simulate", "change", "vision", "--reserve", "30")),
        "status",
        ("tells what was changed on a host",),
        ("rarms drift",),
    ),
    "nothing is applied, and the status says so": Situation(
        (write(MANIFEST),), "status", ("shows what is not applied yet",), ("rarms plan",)
    ),
    "nothing is proven, and the status says so": Situation(
        (write(MANIFEST), APPLY), "status", ("compares them with their thresholds",), ("rarms prove",)
    ),
    "a pair might be combined": Situation(
        (write(PAIR), logs(vision=40, speech=45)),
        "explain vision",
        ("`rarms tune` has measured nothing",),
        ("rarms tune",),
        in_view=True,
    ),
    "the paper's procedure combined, and it is still too much": Situation(
        (write(PAIR.replace("reserve: measured", "reserve: 95 %", 1) + THIRD), logs(speech=60, video=60)),
        "tune --strategy paper",
        ("`rarms plan` tells more", "Go on: "),
        ("rarms tune --strategy paper --repeat", "rarms tune", "rarms plan"),
        may_answer=ExitCode.NO,
    ),
    "a component is not measured yet, and the report says so": Situation(
        (write(PAIR), do("measure", "vision", "--from", "40%", "--to", "80%", "--step", "40%")),
        "report",
        ("not measured: run `rarms measure", "Nothing can be applied as it is"),
        ("rarms measure speech", "rarms plan"),
        may_answer=ExitCode.NO,
        in_view=True,
    ),
    "what is measured is not applied yet, and the report says so": Situation(
        (write(MEASURED), logs(vision=45)),
        "report",
        ("`rarms plan` shows what is to be done, `rarms apply` does it",),
        ("rarms plan", "rarms apply"),
        in_view=True,
    ),
    "a component has a task class": Situation(
        (write(MANIFEST + "  drive: { criticality: 1, runs_on: host, task: Localization }\n"),),
        "explain drive",
        ("`rarms plan` shows its values",),
        ("rarms plan",),
        in_view=True,
    ),
    "fewer virtual processors may be enough": Situation(
        (
            write(WIDE.replace("50 ms", "26 ms").replace("20 %", "30 %").replace("varies: 2 %", "varies: 0 %")),
            do("measure", "vision"),
        ),
        "plan",
        (", and `rarms measure` tells: ",),
        ("rarms measure",),
        first=(edit("rarms.yaml", "    processors: 2", "    processors: 1"),),
    ),
    "more logical processors may be enough": Situation(
        (write(PAIR), logs(vision=60, speech=60)),
        "plan",
        ("may be enough. How much each partition needs there, ",),
        ("rarms measure",),
        may_answer=ExitCode.NO,
    ),
    "what was stopped to measure cannot be started again": Situation(
        (
            write(MANIFEST),
            APPLY,
            killed("measure", "vision", "--from", "50%", "--to", "50%", "--stop-partitions", at=30),
            do("simulate", "change", "speech", "--reserve", "90"),
        ),
        "measure vision --from 50% --to 50% --stop-partitions",
        ("Mend what keeps them from it, then start them",),
        ("rarms start speech vision",),
        first=(do("simulate", "change", "speech", "--reserve", "20"),),
    ),
    "the last applies of two hosts are of different plans": Situation(
        (write(TWO_HOSTS), APPLY, edit("rarms.yaml", "45 %", "50 %"), do("apply", "--host", "fore", "--auto-approve")),
        "undo --auto-approve",
        ("Take one of them back: ",),
        ("rarms undo --host aft", "rarms undo --host fore"),
    ),
    "what was stopped to measure is gone": Situation(
        (
            write(MANIFEST),
            APPLY,
            killed("measure", "vision", "--from", "50%", "--to", "50%", "--stop-partitions", at=30),
            do("simulate", "change", "speech", "--remove"),
        ),
        "measure vision --from 50% --to 50% --stop-partitions",
        ("Something else changes it too",),
        ("rarms drift",),
    ),
}


OTHER_TESTS = {
    "`rarms init` writes one.": "tests/unit/cli/test_status.py",
    "or finish it where the key is not set": "tests/unit/app/test_plan_key.py",
    "Make the plan again where the key is set: ": "tests/unit/app/test_plan_key.py",
    "Take it back with that application's manifest: ": "tests/system/test_cli_route.py",
    "Release it first: ": "test_a_machine_that_is_another_partition_is_released_as_recommended",
    "Release that one first: ": "test_a_machine_that_is_another_partition_is_released_as_recommended",
    "samples may tell: ": "tests/unit/app/experiments/test_prove.py",
    "Free some, or prove what it is without a load": "tests/unit/app/experiments/test_prove.py",
    "or prove what holds without a load": "tests/unit/app/experiments/test_prove.py",
    "nothing here defines it. On Windows": "tests/unit/test_rcss.py",
    "Run `rarms apply` from a prompt that was opened with": "tests/system/test_remote_host.py",
    "See what this kernel lacks: `rarms doctor`": "tests/system/test_linux_advice.py",
    "See what the other one did: `rarms history`": "tests/contracts/test_remote_linux.py",
    "or adopt the right machine with": "tests/system/test_remote_host.py",
    "Have `rarms show --transport --out FOLDER`": "tests/system/test_remote_host.py",  # another module there
    "No step was done. Look with": "tests/system/test_remote_host.py",  # a script's guard refused
    "it asks the host's own journal": "tests/system/test_remote_host.py",  # the connection broke
    "Run the script there by hand and look": "tests/unit/cli/test_hyperv_snapshots.py",
    "Say how the host is reached": "tests/unit/cli/test_hyperv_snapshots.py",
    "(`rarms show PLAN --script --guest {inside}": "tests/unit/cli/test_show_scripts.py",
    "yourself: `rarms prove` runs it in its own partition": "tests/twin/test_measuring.py",
    "or let `rarms destroy --remove-disks` delete": "tests/cases/destroy-with-disks",
    "cpuset.cpus of its group was changed by hand": "tests/system/test_linux_advice.py",
    "This run changed nothing since": "tests/contracts/test_remote_linux.py",  # another run took the host over
    "`rarms apply` starts what is off": "tests/system/test_linux_advice.py",  # after a restart
    "{left_out} {more}: `rarms plan` shows all": "tests/system/test_pull_requests.py",
    "`rarms tune` goes on with combining": "tests/system/test_interactive_session.py",
    "See what the other one did: ": "tests/contracts/test_remote_linux.py",
    # On Linux, or at another moment, what a situation says:
    "See what is missing with `rarms plan`, and bring it": "nothing is applied that could be proven",
    "Try it alone: `rarms run COMPONENT`": "a component cannot run on its host",
    "Look at the host again: `rarms plan`": "another tool changed a partition",
    "`rarms plan` shows what is wanted": "a stopped partition would be proven",
    "Measure the parts again (": "it was measured beside what runs on the host",
    "Nothing was shown to miss: more samples may tell": "nothing is measured",
    "If it was changing a host, run": "an apply was killed",
    "`rarms measure` may find that less is enough": "tests/unit/planner/infeasibility/test_ways_out.py",
    "A setting ends at `run.until` at the latest": "nothing is measured",
}
"""The test, the file of tests or the situation that runs what a message recommends, by words of the message."""

NOT_RECOMMENDED = (
    "so `rarms apply` will refuse it: set RARMS_PLAN_KEY",
    "`rarms apply` does the plan's steps itself",
    "no run of `rarms tune` that is on record here wrote it",
    "`rarms tune` measured no other compound with it",
    ", as `rarms tune` measured it: ",
    "`rarms tune` combined them at ",
    "A proof (`rarms prove`), beside all of its loads together.",
    "what `rarms tune` measured cannot be told",
    "All together, as `rarms prove` measured them last:",
    "`rarms measure` stopped it and ended before it started it again",
    "`rarms apply` does the plan's steps itself",
    "`rarms measure` creates and removes partitions with the names",
    "`rarms apply` starts scripts with a policy of their own and is not concerned",
    "nothing brings it back, `rarms undo` neither",
    "`rarms undo` and the undo script leave this as it is",
    "`rarms undo` takes the whole plan back after it was applied",
    "y stops them as `rarms stop` does",
    "as `rarms tune --interactive` does",
)
"""Messages that name a command and recommend nothing: what it did or does, by words of each."""

PLACEHOLDERS = {
    "FILE": "a.plan",
    "PLAN": "a.plan",
    "MANIFEST": "robot",
    "NAME": "onboard",
    "COMPONENT": "vision",
    "PARTITION": "vision",
    "LEVEL": "200 ms",
}
"""What stands for what a person has to fill in."""


def texts_of(path: Path) -> Iterator[str]:
    """The texts of a module but for docstrings and help; a value in one is its expression in braces."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    skipped: set[ast.AST] = set()
    for node in ast.walk(tree):
        match node:
            case ast.Expr(value=ast.Constant() as docstring):
                skipped.add(docstring)
            case ast.keyword(arg="help" | "description" | "epilog"):
                skipped.update(ast.walk(node))
            case ast.JoinedStr() | ast.Call(func=ast.Name(id="prose")):
                skipped.update(part for part in ast.walk(node) if part is not node)
            case _:
                continue
    for node in ast.walk(tree):
        match node:
            case ast.Constant(value=str()) | ast.JoinedStr() | ast.Call(func=ast.Name(id="prose")):
                if node not in skipped:
                    yield text_of(node)
            case _:
                continue


def text_of(node: ast.AST) -> str:
    """A text as a reader of the code sees it, its commands written out; what is no text in braces."""
    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.JoinedStr(values=parts):
            return "".join(str(part.value) if isinstance(part, ast.Constant) else ast.unparse(part) for part in parts)
        case ast.Call(func=ast.Name(id="prose"), args=parts):
            return "".join(map(text_of, parts))
        case ast.Name(id=name) if isinstance(known := getattr(commands, name, None), commands.RecommendedCommand):
            return f"`{known.text}`"
        case ast.Call(func=ast.Name(id="command"), args=arguments, keywords=options):
            words = [text_of(argument) for argument in arguments]
            for option in options:
                words.append(f"--{(option.arg or '').strip('_').replace('_', '-')}")
                words += (
                    []
                    if isinstance(option.value, ast.Constant) and option.value.value is True
                    else [text_of(option.value)]
                )
            return f"`rarms {' '.join(words)}`"
        case _:
            return f"{{{ast.unparse(node)}}}"


def recommending_texts() -> list[str]:
    """The texts of the package that name a command of rarms between backticks."""
    named = re.compile(r"`rarms [a-z{]|\{(?:[a-z]+\.)*_?again\b|\} --help`")
    modules = sorted({*Path(rarms_iac.__file__).parent.rglob("*.py")} - {Path(commands.__file__)})
    return [text for module in modules for text in texts_of(module) if named.search(text)]


def test_every_message_that_recommends_a_command_has_its_situation() -> None:
    """So that a new message brings its situation along."""
    declared = [message for situation in SITUATIONS.values() for message in situation.messages]
    known = (*declared, *OTHER_TESTS, *NOT_RECOMMENDED)
    texts = [" ".join(text.split()) for text in recommending_texts()]

    assert [text for text in texts if not any(words in text for words in known)] == []
    assert [words for words in (*OTHER_TESTS, *NOT_RECOMMENDED) if not any(words in text for text in texts)] == []
    shown_by = SITUATIONS.keys() | globals().keys()
    assert [
        place for place in OTHER_TESTS.values() if place not in shown_by and not Path(CHECKOUT, place).exists()
    ] == []


def recommended(text: str) -> tuple[str, ...]:
    """The commands that a text recommends, as printed; a line's end in one is a blank."""
    found = (" ".join(match.split()) for match in re.findall(r"`(rarms [a-z][^`]*)`", text))
    return tuple(dict.fromkeys(command for command in found if "..." not in command))


PREPARED: dict[tuple[Callable[[], None], ...], tuple[tuple[Path, bytes], ...]] = {}
"""By steps the files that they leave, below the folder."""


def prepare(steps: tuple[Callable[[], None], ...], folder: Path) -> None:
    """Do the steps in this empty folder; those that another situation began with, too, were done once for both."""
    if not steps:
        return
    if steps not in PREPARED:
        prepare(steps[:-1], folder)
        with chdir(folder):
            steps[-1]()
        PREPARED[steps] = files_in(folder)
        return
    for path, content in PREPARED[steps]:
        Path(folder, path).parent.mkdir(parents=True, exist_ok=True)
        Path(folder, path).write_bytes(content)


def files_in(folder: Path) -> tuple[tuple[Path, bytes], ...]:
    """Every file below the folder, and what is in it."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return tuple((path.relative_to(folder), path.read_bytes()) for path in files)


def answered(situation: Situation, folder: Path) -> tuple[str, tuple[str, ...]]:
    """Bring the situation about in this folder; what its command says, and the commands that this recommends."""
    prepare(situation.steps, folder)
    with chdir(folder):
        words = shlex.split(situation.words)
        ran = rarms(*words, "--json", stdin="no\n", at_a_terminal=situation.asked)
        shown = rarms(*words, *(["--text"] if words[0] == "report" else [])).out if situation.in_view else ""
    says = " ".join(re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", ran.out + ran.err + shown).split())
    return says, tuple(dict.fromkeys(commands_in(documents_in(ran.out))))


def documents_in(text: str) -> list[object]:
    """The JSON documents of this text: one, or what a run of steps writes one after the other."""
    documents = []
    while text := text.lstrip():
        document, end = json.JSONDecoder().raw_decode(text)
        documents.append(document)
        text = text[end:]
    return documents


def commands_in(document: object) -> Iterator[str]:
    """Every recommended command of a JSON document that has nothing in it that a person has to add."""
    match document:
        case {"verb": _, "text": str(text)}:
            yield from () if "..." in text else (text,)
        case dict():
            for value in document.values():
                yield from commands_in(value)
        case list():
            for value in document:
                yield from commands_in(value)
        case _:
            pass


def id_of_vision() -> str:
    """The id of its machine on the simulated host, which is made of the plan that made it."""
    machines = json.loads(Path(".rarms/hosts/onboard.json").read_text(encoding="utf-8"))["content"]["machines"]
    (found,) = (key for key, machine in machines.items() if machine["settings"]["name"] == "vision")
    return str(found)


DONE: set[tuple[str, tuple[tuple[Path, bytes], ...]]] = set()
"""Commands that ended well, with the files that they began with: the same again would show nothing new."""


def run_it(command: str, folder: Path, may_answer: ExitCode = ExitCode.DONE) -> None:
    """Run it; what asks is told not to, and a FILE is one that is there where it is read."""
    begun = (command, files_in(folder))
    if begun in DONE:
        return
    words = [PLACEHOLDERS.get(word, word) for word in shlex.split(command)[1:]]
    with chdir(folder):
        words = [id_of_vision() if word == "ID" else word for word in words]
        if words[0] == "apply" and "a.plan" in words and not Path("a.plan").exists():
            do("plan", "--out", "a.plan")()
        elif words[0] in ASKS and "--abandon" not in words:
            words.append("--auto-approve")
        elif words[0] == "prove" and "--without-load" not in words:
            words.append("--load-host")
        ran = rarms(*words)
    assert ran.code in {*WORKS, may_answer}, f"`{command}`: exit {ran.code}\n{ran.out}{ran.err}"
    if ran.code in WORKS:
        DONE.add(begun)


@pytest.mark.parametrize("situation", SITUATIONS.values(), ids=SITUATIONS.keys())
def test_what_is_recommended_works_where_it_is_recommended(situation: Situation, tmp_path: Path) -> None:
    origin = tmp_path / "origin"
    origin.mkdir()

    says, commands = answered(situation, origin)

    for message in situation.messages:
        assert message in says
    for wanted in situation.recommends:
        assert any(command.startswith(wanted) for command in commands), (wanted, commands, says)
    for number, command in enumerate(commands):
        folder = tmp_path / f"copy-{number}"
        copy_files(origin, folder)
        with chdir(folder):
            for step in situation.first:
                step()
        run_it(command, folder, situation.may_answer)


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
        run_it(command, tmp_path)


def test_a_machine_that_is_another_partition_is_released_as_recommended(tmp_path: Path) -> None:
    with chdir(tmp_path):
        write(MANIFEST)()
        APPLY()
        unknown = rarms("import", "speech", "--id", "none", "--auto-approve")
        (machine,) = re.findall(r"vision ([0-9a-f-]{36})", unknown.err)
        taken = rarms("import", "speech", "--id", machine, "--auto-approve")

    assert 'is partition "vision" of application' in taken.err
    assert recommended(taken.err) == ("rarms release vision",)
    run_it("rarms release vision", tmp_path)
