"""Every command that a message recommends works in the situation that the message is about.

A situation is a folder, made by commands and files, and one command more, whose findings recommend something. Each of
their `commands` is run, in a copy of that folder.
"""

import ast
import json
import re
import shlex
from collections.abc import Callable, Iterator
from contextlib import chdir
from dataclasses import KW_ONLY, dataclass
from functools import cache
from pathlib import Path
from typing import TypeAlias

import pytest

import rarms_iac
from rarms_iac.cli.ending import ExitCode
from rarms_iac.model import commands
from rarms_iac.storage import disk
from tests.crashing import Crash, CrashingDisk, When
from tests.files import copy_files, machines_on
from tests.fluid import without_scheduler
from tests.measuring import leave_logs, rewrite_log, with_weak_load
from tests.needs import CHECKOUT
from tests.unit.cli.running import rarms

MANIFEST = """\
schema: rarms/v1
application: { name: robot }
policy: { interference: busy-loop, measuring: { setting: 3 s } }
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
WIDE = MEASURED.replace("    cpu: { reserve: m", "    processors: 2\n    cpu: { reserve: m").replace(
    "varies: 2 %", "varies: 0 %"
)
ACCEPTED = MANIFEST.replace(
    "interference: busy-loop", "accept: { RARMS014: { at: [component/vision], reason: known, until: 2099-01-01 } }"
)
ALONE = MANIFEST[: MANIFEST.index("  speech")]
PAIR = f"""{MEASURED[: MEASURED.index("  speech")]}\
  speech:
    criticality: 5
    apt: {{ mean_response_time: {{ at_most: 50 ms }} }}
    run: {{ command: [speech], until: {{ samples: 60 }}, samples: {{ from: per_run }} }}
    cpu: {{ reserve: measured }}
    memory: 512 MiB
    simulation: {{ work: 10 ms, varies: 2 % }}
"""
THREE = PAIR.replace("reserve: measured", "reserve: 95 %", 1) + PAIR[PAIR.index("  speech") :].replace(
    "speech", "video"
)
LATE = MEASURED.replace("mean_response_time", "p90_response_time").replace("50 ms", "90 ms").replace("60 }", "100 }")
LATE = LATE.replace("setting: 3 s", "setting: 20 s")
PROGRAM = ALONE.replace("command: [vision]", "command: [python3, -c, pass]").replace("samples: 60", "samples: 2")
PROGRAM = PROGRAM[: PROGRAM.index("    simulation")]
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
LOG = "measurements/onboard/vision/busy-loop.jsonl"

ASKS = {"apply", "undo", "stop", "start", "import", "release", "destroy"}
"""Commands that ask before they change a host."""

WORKS = {ExitCode.DONE, ExitCode.FOUND, ExitCode.NOT_APPLIED}
"""Done, or a plan or drift that is not empty."""

Step: TypeAlias = str | Callable[[], object]
"""A command that must work, without `rarms` and without the consent that it asks for; or what else is done."""


def do(step: Step) -> None:
    """Do the step in this folder."""
    if not isinstance(step, str):
        step()
        return
    words = shlex.split(step)
    ran = rarms(*words, *(["--auto-approve"] if words[0] in ASKS else []))
    assert ran.code in WORKS, (step, ran.err)


@cache
def write(text: str, name: str = "rarms.yaml") -> Step:
    """What writes a file, the manifest where no other is named."""
    return lambda: Path(name).write_text(text, encoding="utf-8", newline="\n")


@cache
def edit(before: str, after: str, name: str = "rarms.yaml") -> Step:
    """What changes a word of a file, of the manifest where no other is named."""
    return lambda: Path(name).write_text(
        Path(name).read_text(encoding="utf-8").replace(before, after), encoding="utf-8", newline="\n"
    )


def move() -> None:
    """Move the manifest into a folder."""
    Path("robot").mkdir()
    Path("rarms.yaml").rename("robot/rarms.yaml")


def killed(command: str, at: int) -> Step:
    """What runs a command that ends without clean-up at its effect of this number."""

    def run() -> None:
        with disk.use(CrashingDisk(at, When.AFTER)), pytest.raises(Crash):
            rarms(*command.split())

    return run


MEASURE = "measure vision --from 50% --to 50% --stop-partitions"
APPLY_KILLED = killed("apply --auto-approve", at=20)
MEASURE_KILLED = killed(MEASURE, at=30)


def weak_log() -> None:
    """Have the data log say that its load left processors idle."""
    rewrite_log(Path(LOG), with_weak_load)


def empty_log() -> None:
    """Leave the data log its head alone."""
    write(Path(LOG).read_text(encoding="utf-8").partition("\n")[0] + "\n", LOG)()  # type: ignore[operator]  # no command


@cache
def logs(**least: int) -> Step:
    """What leaves data logs that need so many per cent."""
    return lambda: leave_logs(Path(), least)


def given(manifest: str = "", *steps: Step) -> tuple[Step, ...]:
    """The steps that bring a situation about, of which the first writes the manifest where there is one."""
    return (write(manifest), *steps) if manifest else steps


@dataclass(frozen=True, slots=True)
class Ask:
    """A command whose answer is read, and what that must say and recommend at least."""

    words: str
    says: str | tuple[str, ...]  # words of each message that recommends something
    recommends: str | tuple[str, ...]  # how commands begin, without `rarms`
    _: KW_ONLY
    in_view: bool = False  # a view makes the sentence of facts, so that only a person reads it
    first: tuple[Step, ...] = ()  # what the message says is to be done before the command
    at_a_terminal: bool = False  # the message comes from a question
    may_answer: ExitCode = ExitCode.DONE  # also how a command that is recommended may end: a plan that says why not


NO, REFUSED = ExitCode.NO, ExitCode.REFUSED
SITUATIONS: dict[str, tuple[tuple[Step, ...], *tuple[Ask, ...]]] = {
    "nothing is there": (given(), Ask("plan", "`-f PATH` names a manifest or its folder", "init")),
    "the manifest is empty": (
        given("\n  \n"),
        Ask("validate", "Or move the file away and run", "init", first=(Path("rarms.yaml").unlink,)),
    ),
    "the manifest has only comments": (
        given("# nothing\n"),
        Ask("validate", "Or move the file away and run", "init", first=(Path("rarms.yaml").unlink,)),
        Ask("fmt", "Or move the file away and run", "init", first=(Path("rarms.yaml").unlink,)),
    ),
    "an error is accepted that cannot be": (
        given(ACCEPTED),
        Ask("plan", "acceptance", "explain RARMS014"),
    ),
    "nothing is measured": (
        given(MEASURED),
        Ask("plan", "Or set a fixed reserve", "measure vision"),
        Ask("report", "Measure first: ", "measure"),
        Ask("validate", "`rarms measure` finds the reservation", "measure"),
        Ask("status", "measures the missing reservations", "measure"),
    ),
    "nothing is applied": (
        given(MANIFEST),
        Ask("prove --load-host", "Show the changes with", ("plan", "apply")),
        Ask("apply", "or write a plan file and apply it", ("plan --out FILE", "apply FILE")),
        Ask("apply", "Run the same command again and answer `yes`", "plan", at_a_terminal=True),
        Ask("undo", "lists the runs on each host", "history"),
        Ask("apply a.plan", "Check the path and its permissions", "plan --out FILE"),
        Ask("apply rarms.yaml", "Give a file written by `rarms plan --out FILE`", "plan --out FILE"),
        Ask(
            "plan --target partition/sight",
            "`rarms plan --verbose` lists the changes with their addresses",
            "plan --verbose",
        ),
        Ask("plan --nothing", "--help` lists its options", "plan --help"),
        Ask("measure another", "--help` lists its options", "measure --help"),
        Ask("measure speech", "Add an `apt`, or measure chosen settings", "measure speech --from 10% --to 100%"),
        Ask("status", "shows the changes that are not applied yet", "plan"),
    ),
    "it is applied": (
        given(MANIFEST, "apply"),
        Ask(
            "measure vision --from 50% --to 50%",
            "To stop these partitions and restart them afterwards",
            ("measure --stop-partitions", "stop", "start"),
        ),
        Ask("status", "compares them with their thresholds", "prove"),
    ),
    "a partition was stopped": (
        given(MANIFEST, "apply", "stop vision"),
        Ask("plan", "stays stopped", "start vision", in_view=True),
        Ask("status", "stopped by", "start vision", in_view=True),
    ),
    "all partitions were stopped": (
        given(MANIFEST, "apply", "stop"),
        Ask("prove --load-host", "Start them", "start speech vision"),
    ),
    "a partition is started by hand": (
        given(ALONE.replace("components:", "partitions: { vision: { start: manual } }\ncomponents:", 1), "apply"),
        Ask("prove --load-host", "These partitions are not running: vision.", "start vision"),
    ),
    "an APT is missed in the layout": (
        given(ALONE.replace("45 %", "10 %"), "apply"),
        Ask(
            "prove --load-host",
            ("At this slowdown it needs", "Or measure the reservation again"),
            "measure vision --again --stop-partitions",
        ),
    ),
    "an apply was killed": (
        given(MANIFEST, APPLY_KILLED),
        Ask("drift", "A run is unfinished on ", "apply", in_view=True),
        Ask(
            "plan",
            ("`rarms undo` to reverse it", "`rarms apply --abandon` to leave the host as it is"),
            ("apply", "undo", "apply --abandon"),
        ),
        Ask("status", "finishes the run on", "apply"),
    ),
    "an undo was killed": (
        given(MANIFEST, "apply", killed("undo --auto-approve", at=12)),
        Ask("plan", "Otherwise run `rarms undo` to finish the run", ("undo", "apply --abandon")),
    ),
    "a host moved while a run was unfinished": (
        given(
            MANIFEST,
            "apply",
            write(MANIFEST.replace("45 %", "40 %").replace("20 %", "10 %")),
            killed("apply --auto-approve", at=8),
            "simulate change vision --reserve 30",
        ),
        Ask(
            "apply",
            "Nothing more was changed. Show the state with `rarms drift`.",
            ("drift", "undo", "apply --abandon"),
            may_answer=REFUSED,
        ),
    ),
    "what was stopped to measure cannot be started again": (
        given(MANIFEST, "apply", MEASURE_KILLED, "simulate change speech --reserve 90"),
        Ask(
            MEASURE,
            "Correct the cause, then start them",
            "start speech vision",
            first=("simulate change speech --reserve 20",),
        ),
    ),
    "a plan was used": (
        given(MANIFEST, "plan --out a.plan", "apply", "destroy"),
        Ask("apply a.plan", "Make a new plan: `rarms plan --out FILE`", "plan --out FILE"),
    ),
    "a plan was edited": (
        given(MANIFEST, "plan --out a.plan", edit(" vision:", " Vision:", "a.plan")),
        Ask("apply a.plan", "Make the plan again: `rarms plan --out FILE`", "plan --out FILE"),
    ),
    "a plan is of another format": (
        given(MANIFEST, "plan --out a.plan", edit('"format_version":', '"format_version": "of old", "was":', "a.plan")),
        Ask("apply a.plan", "Make the plan again with this version of rarms", "plan --out FILE"),
    ),
    "a plan file is of another kind": (
        given(MANIFEST, write("{}", "a.plan")),
        Ask("apply a.plan", "Give a file written by `rarms plan --out FILE`", "plan --out FILE"),
    ),
    "the manifest changed since the plan was made": (
        given(MANIFEST, "plan --out a.plan", edit("45 %", "40 %")),
        Ask("apply a.plan", "To see the changes for the current manifest, run", "plan"),
    ),
    "a plan is applied elsewhere": (
        given(MANIFEST, "plan --out a.plan", move),
        Ask("apply a.plan", "Apply the plan in the folder where it was made", "apply PLAN -f MANIFEST"),
    ),
    "the host moved since the plan was made": (
        given(MANIFEST, "apply", edit("45 %", "40 %"), "plan --out a.plan", "simulate change vision --reserve 30"),
        Ask("apply a.plan", "Nothing was changed. Show the changes with `rarms drift`", "drift"),
    ),
    "an apply cannot be undone wholly": (
        given(MANIFEST, "apply", "destroy"),
        Ask("undo --auto-approve", "After the undo, run `rarms plan` to show the differences", "plan"),
    ),
    "the last applies of two hosts are of different plans": (
        given(TWO_HOSTS, "apply", edit("45 %", "50 %"), "apply --host fore"),
        Ask("undo --auto-approve", "Undo one plan: ", ("undo --host aft", "undo --host fore")),
    ),
    "a protected partition is no longer named": (
        given(MANIFEST + "partitions:\n  speech: { protect: true }\n", "apply", write(ALONE)),
        Ask("plan", "To keep it without rarms: ", "release speech"),
    ),
    "no component is wanted any more": (
        given(MANIFEST, "apply", write(MANIFEST[: MANIFEST.index("components")] + "components: {}\n")),
        Ask("plan", "To remove everything, use", "destroy"),
    ),
    "a machine that is not managed has a wanted name": (
        given(MANIFEST, "apply", "release vision"),
        Ask("plan", " to import it, or give the partition another name", "import vision --id"),
    ),
    "a host without machines has none to import": (
        given(MANIFEST),
        Ask("import vision --id none --auto-approve", "The host has no machine to import. ", "plan"),
    ),
    "a machine that is not managed gets less": (
        given(
            MANIFEST,
            "apply",
            "release vision",
            write(MANIFEST.replace("vision:", "sight:").replace("20 %", "30 %").replace("45 %", "20 %")),
        ),
        Ask("plan --verbose", "or import it: ", "import PARTITION --id ID", first=(edit("sight", "vision"),)),
    ),
    "both names of a move are on the host": (
        given(
            MANIFEST,
            "apply",
            edit("  vision:", "  sight: { criticality: 1, cpu: { reserve: 1 % } }\n  vision:"),
            "apply",
            write(MANIFEST.replace("  speech:", "  sight:") + "moved: { speech: sight }\n"),
        ),
        Ask("plan", "Remove one of them (", "destroy --target partition/speech"),
    ),
    "the host is not as in the manifest": (
        given(MANIFEST, "apply", edit("45 %", "40 %")),
        Ask("drift", "shows the changes", "plan", in_view=True),
    ),
    "another tool changed a partition": (
        given(MANIFEST, "apply", "simulate change vision --reserve 30"),
        Ask("plan --verbose", "Find the cause", ("drift", "history")),
        Ask("status", "shows the changes", "drift"),
    ),
    "another tool changed a partition, and the manifest has errors": (
        given(MANIFEST, "apply", edit("45 %", "90 %"), "simulate change vision --reserve 30"),
        Ask("drift", "The manifest was not compared", "plan", may_answer=NO, in_view=True),
    ),
    "no measured setting is enough": (
        given(MEASURED, "measure vision --from 10% --to 20%"),
        Ask("plan", "shows the levels that can be met), or measure higher settings", "measure vision"),
        Ask("select vision --at '60 ms'", "measure higher settings", "measure vision --from 21% --to 100%"),
    ),
    "no setting can be enough": (
        given(MEASURED.replace("50 ms", "5 ms")),
        Ask("measure vision", "Relax the threshold: ", "select vision --at LEVEL"),
    ),
    "reservations exceed the host": (
        given(MEASURED.replace("20 %", "30 %"), logs(vision=85)),
        Ask("plan", "RARMS014", "measure"),
    ),
    "fixed reserves exceed the host": (
        given(MANIFEST.replace("45 %", "90 %")),
        Ask("validate", "`rarms plan` finds a change that is enough", "plan", may_answer=NO),
        Ask("graph", "Search for the causes and for changes that help: ", "plan", may_answer=NO),
    ),
    "a pair would fit": (
        given(PAIR, logs(vision=60, speech=60)),
        Ask("plan", ("RARMS014", "may be enough. Measure the partitions there: "), ("tune", "measure")),
    ),
    "the paper's procedure combined, and it is still too much": (
        given(THREE, logs(speech=60, video=60)),
        Ask(
            "tune --strategy paper",
            ("Show the causes: ", "Continue: "),
            ("tune --strategy paper --repeat", "tune", "plan"),
            may_answer=NO,
        ),
    ),
    "nothing was tuned": (
        given(PAIR, logs(vision=30, speech=30)),
        Ask("explain vision", "has measured nothing", "tune", in_view=True),
    ),
    "a pair might be combined": (
        given(PAIR, logs(vision=40, speech=45)),
        Ask("explain vision", "`rarms tune` has measured nothing", "tune", in_view=True),
    ),
    "a component does not use its processors": (
        given(WIDE.replace("samples: 60", "samples: 40")),
        Ask("measure vision", "Remove `processors`", "measure"),
    ),
    "fewer virtual processors may be enough": (
        given(WIDE.replace("50 ms", "26 ms").replace("20 %", "30 %"), "measure vision"),
        Ask(
            "plan",
            "may be enough. Check with `rarms measure`: ",
            "measure",
            first=(edit("    processors: 2", "    processors: 1"),),
        ),
    ),
    "a component cannot run on its host": (
        given(PROGRAM),
        Ask("measure vision", "on a real host: `rarms run COMPONENT` tries it", "run"),
    ),
    "a component has a task class": (
        given(MANIFEST + "  drive: { criticality: 1, runs_on: host, task: Localization }\n"),
        Ask("explain drive", "Next: ", "plan", in_view=True),
    ),
    "late jobs may be later with other partitions": (
        given(LATE, "measure vision --from 60% --to 60%"),
        Ask("plan", "Then prove the applied layout", "prove", first=("apply",)),
    ),
    "a threshold depends on its neighbours": (
        given(LATE.replace("busy-loop", "bursts-20"), "measure vision"),
        Ask("plan", "Prove the applied layout", "prove", first=("apply",)),
    ),
    "all loads are weak": (
        given(MEASURED.replace("busy-loop", "bursts-20-half")),
        Ask("measure vision", "Add `busy-loop` to `policy.interference`", "measure vision --interference busy-loop"),
    ),
    "the busy loop is weak itself": (
        given(f"{MEASURED}interference: {{ busy-loop: {{ kind: busy_loop, threads: 1 }} }}\n"),
        Ask(
            "measure vision",
            "Make `interference.busy-loop` a busy loop without `threads`",
            "measure vision --interference busy-loop",
            may_answer=NO,
        ),
    ),
    "a load was seen to leave processors idle": (
        given(ALONE.replace("45 %", "measured"), "measure", weak_log),
        Ask(
            "plan",
            "`busy-loop` has a thread for each of the 2 LP, but",
            "measure --interference busy-loop --again",
        ),
    ),
    "it is measured": (
        given(MEASURED, logs(vision=45)),
        Ask("report", "`rarms plan` shows the changes, `rarms apply` makes them", ("plan", "apply"), in_view=True),
        Ask("measure --interactive", "Omit --interactive. Afterwards choose a level:", "select COMPONENT --at LEVEL"),
    ),
    "one of two components is measured": (
        given(PAIR, "measure vision --from 40% --to 80% --step 40%"),
        Ask(
            "report",
            ("Measure the missing reservations: ", "The manifest cannot be applied"),
            ("measure", "plan"),
            may_answer=NO,
            in_view=True,
        ),
    ),
    "what was measured is not what the manifest says now": (
        given(MEASURED, logs(vision=45), edit("work: 20 ms", "work: 21 ms")),
        Ask("plan", "Or undo the change.", "measure vision"),
    ),
    "it was measured with what runs on the host": (
        given(
            MANIFEST.replace("45 %", "10 %").replace("20 %", "10 %"),
            "apply",
            write(MEASURED),
            "measure vision --on-busy-host --from 40% --to 60% --step 20%",
        ),
        Ask("plan", "Measure again while nothing else runs on the host", "measure vision --again", first=("stop",)),
    ),
    "it was measured on another machine": (
        given(MEASURED, logs(vision=45), edit("logical_processors: 2", "logical_processors: 4")),
        Ask("plan", "If this is another machine, ", "measure vision --again"),
    ),
    "a data log is damaged": (
        given(MEASURED, logs(vision=45), write('{"a": 1}\n{"b": 1}\n', LOG)),
        Ask("plan", "remove it and measure again: ", "measure vision", first=(Path(LOG).unlink,)),
    ),
    "one of several loads is measured": (
        given(MEASURED, logs(vision=45), edit("busy-loop,", "[busy-loop, bursts-20],")),
        Ask("plan", "Measure the other loads: ", "measure vision"),
        Ask("status", "measures the missing reservations", "measure"),
        Ask(
            "measure --interference busy-loop --from 50% --to 50%",
            "Next: ",
            "measure",
            in_view=True,
        ),
    ),
    "a log has no setting": (
        given(MEASURED, logs(vision=45), empty_log),
        Ask("plan", "Measure first: ", "measure vision"),
    ),
    "a snapshot cannot be read": (
        given(MANIFEST, write("nothing", "host.json")),
        Ask(
            "plan --snapshot host.json",
            "Make a snapshot with",
            ("snapshot --host NAME --out FILE", "snapshot --script"),
        ),
    ),
    "a script cannot be read": (
        given(MANIFEST, write("exit", "a.ps1")),
        Ask("show --check a.ps1", "or write the script again", "show --script --out FOLDER"),
    ),
}


OTHER_TESTS = {
    '"{component}" already runs: process {process} is from ': "tests/unit/measuring/test_run_component.py",
    "Measure the rest: `rarms measure`.": "tests/unit/measuring/test_passes.py",
    "Or accept the reservations in a plan file: ": "tests/unit/measuring/test_passes.py",
    "Set the governor ": "tests/unit/app/test_data_logs.py",
    "Measurements on a simulated host are never valid for a real one. ": "tests/unit/app/test_data_logs.py",
    "or more, 1.2 times the peak": "tests/unit/app/test_data_logs.py",
    "Start it: `rarms start '{partition}'`.": "tests/unit/measuring/test_run_component.py",
    "Measure whether a reservation helps: ": "tests/unit/measuring/test_run_component.py",
    "Another tool also changes this setting": "tests/unit/applying/test_applying.py",
    "`rarms undo` to finish the run": "tests/system/test_killed_and_run_again.py",
    "run `rarms undo --keep` instead": "tests/unit/cli/test_undo.py",
    "After the undo, `rarms apply` sets": "tests/unit/cli/test_undo.py",
    "then `rarms apply` to restore the values of the manifest": "tests/unit/cli/test_undo.py",
    "Write a first manifest: `rarms init`.": "tests/unit/cli/test_status.py",
    "or finish the run in an environment without the key": "tests/unit/app/test_plan_key.py",
    "Make the plan again in an environment that has the key: ": "tests/unit/app/test_plan_key.py",
    "Undo it with that application's manifest: ": "tests/system/test_cli_route.py",
    "Release the machine first: ": "test_machine_of_another_partition_is_released_as_recommended",
    "Release that machine first: ": "test_machine_of_another_partition_is_released_as_recommended",
    "samples of each component, in about": "tests/unit/measuring/test_prove.py",
    "or prove without a load": "tests/unit/measuring/test_prove.py",
    "nothing here defines it. On Windows": "tests/unit/test_rcss.py",
    "Run `rarms apply` from a prompt opened with": "tests/system/test_remote_host.py",
    "Check the kernel: `rarms doctor`": "tests/system/test_linux_advice.py",
    "or import the correct machine with": "tests/system/test_remote_host.py",
    "Have `rarms show --transport --out FOLDER`": "tests/system/test_remote_host.py",  # another module there
    "No step was done. Show the state with": "tests/system/test_remote_host.py",  # a script's guard refused
    "to read the journal of the host": "tests/system/test_remote_host.py",  # the connection broke
    "Run the script there by hand and check": "tests/unit/cli/test_plan.py",
    "Write the connection to the host": "tests/unit/cli/test_plan.py",
    "Write the script: `rarms show PLAN --script --guest ": "tests/unit/cli/test_show_scripts.py",
    "in the manifest: `rarms prove` runs it in its own partition": "tests/fake_powershell/test_measuring.py",
    "or run `rarms destroy --remove-disks` to delete": "tests/cases/destroy-with-disks",
    "Another tool changed cpuset.cpus of its group": "tests/system/test_linux_advice.py",
    "`rarms apply` starts them": "tests/system/test_linux_advice.py",  # after a restart
    "{left_out} {more}: `rarms plan` shows all": "tests/system/test_pull_requests.py",
    "`rarms plan` shows the cause": "tests/unit/measuring/test_stopping.py",
    "`rarms start` corrects the mark": "tests/unit/measuring/test_stopping.py",
    "`rarms tune` continues combining": "tests/system/test_interactive_session.py",
    "then run `rarms install --host": "tests/unit/app/test_install.py",
    "then run {again}.": "tests/unit/app/test_install.py",
    "The version in use was not changed. Run {again} again.": "tests/unit/app/test_install.py",
    "Finish the run: ": "tests/unit/app/test_install.py",
    "Remove the partitions first: ": "tests/unit/app/test_install.py",
    "{boot}": "tests/unit/app/test_install.py",
    "Next: `rarms doctor`": "tests/system/test_robot.py",
    "Install this version there: ": "tests/system/test_install.py",
    "Choose one host: ": "tests/system/test_robot_measures.py",
    "On a host over ssh, run ": "tests/unit/cli/test_every_command.py",
    # On Linux, or at another moment, what a situation says:
    "Show the changes with `rarms plan`, and apply them": "nothing is applied",
    "Run the component alone: `rarms run COMPONENT`": "a component cannot run on its host",
    "Check the host again: `rarms plan`": "another tool changed a partition",
    "Measure the parts again: ": "it was measured with what runs on the host",
    "More samples may give a verdict. ": "nothing is measured",
    "If it was changing a host, run": "an apply was killed",
    "`rarms measure` may find a smaller reservation": "tests/unit/planner/infeasibility/test_ways_out.py",
    "`run.until` ended the setting": "nothing is measured",
    "Run the component alone and correct the cause: ": "a component cannot run on its host",
    "raise the reserves until `rarms prove` passes": "it is applied",
    "`rarms apply --abandon` to leave the host as it is.": "an apply was killed",
    "to finish the run, `rarms undo` to reverse it": "an apply was killed",
}
"""The test, the file of tests or the situation that runs what a message recommends, by words of the message."""

NOT_RECOMMENDED = (
    "Measuring, proving and `rarms run` need it.",
    "so `rarms apply` will refuse it. Set RARMS_PLAN_KEY",
    "so `rarms apply` will refuse it. Run `rarms measure`, or plan again",
    "`rarms apply` runs the steps directly",
    "The longest time for a proof (`rarms prove`) with all of its loads.",
    "All components together, from the last `rarms prove`:",
    "`rarms measure` stopped it and was interrupted",
    "`rarms measure` creates and removes a partition with the name",
    "`rarms apply` sets the policy of its own processes",
    "`rarms undo` cannot restore the disk",
    "for the guest, but `rarms apply` does not run it",
    "`rarms undo` of the apply that created the partition still removes it",
    "`rarms undo` and the undo script cannot restore them",
    "y: stop {them} like `rarms stop`",
    "like `rarms tune --interactive`",
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
    """A text as a reader of the code sees it, its commands written out; what is not text in braces."""
    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.JoinedStr(values=parts):
            return "".join(str(part.value) if isinstance(part, ast.Constant) else ast.unparse(part) for part in parts)
        case ast.Call(func=ast.Name(id="prose"), args=parts):
            return "".join(map(text_of, parts))
        case ast.Name(id=name) | ast.Attribute(value=ast.Name(id="commands"), attr=name) if isinstance(
            known := getattr(commands, name, None), commands.RecommendedCommand
        ):
            return f"`{known.text}`"
        case ast.Call(
            func=ast.Name(id="command") | ast.Attribute(value=ast.Name(id="commands"), attr="command"),
            args=arguments,
            keywords=options,
        ):
            values = {str(option.arg): literal_or_text(option.value) for option in options}
            verb, *more = map(text_of, arguments)
            return f"`{commands.command(verb, *more, **values).text}`"
        case _:
            return f"{{{ast.unparse(node)}}}"


def literal_or_text(node: ast.AST) -> str | int:
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, int) else text_of(node)


def recommending_texts() -> list[str]:
    """The texts of the package that name a command of rarms between backticks."""
    named = re.compile(r"`rarms [a-z{]|\{(?:[a-z]+\.)*_?again\b|\} --help`")
    modules = sorted({*Path(rarms_iac.__file__).parent.rglob("*.py")} - {Path(commands.__file__)})
    return [text for module in modules for text in texts_of(module) if named.search(text)]


def several(words: str | tuple[str, ...]) -> tuple[str, ...]:
    """One as several."""
    return (words,) if isinstance(words, str) else words


def test_every_message_that_recommends_command_has_its_situation() -> None:
    """So that a new message brings its situation along."""
    declared = [words for _, *asks in SITUATIONS.values() for ask in asks for words in several(ask.says)]
    known = (*declared, *OTHER_TESTS, *NOT_RECOMMENDED)
    texts = [" ".join(text.split()) for text in recommending_texts()]

    assert [text for text in texts if not any(words in text for words in known)] == []
    assert [words for words in (*OTHER_TESTS, *NOT_RECOMMENDED) if not any(words in text for text in texts)] == []
    shown_by = SITUATIONS.keys() | globals().keys()
    assert [
        place for place in OTHER_TESTS.values() if place not in shown_by and not Path(CHECKOUT, place).exists()
    ] == []


Files: TypeAlias = tuple[tuple[Path, bytes], ...]
"""Every file below a folder, and what is in it."""


def files_in(folder: Path) -> Files:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return tuple((path.relative_to(folder), path.read_bytes()) for path in files)


PREPARED: dict[tuple[Step, ...], Files] = {}
"""By steps what they leave."""


def prepare(steps: tuple[Step, ...], folder: Path) -> None:
    """Do the steps in this empty folder; those that another situation began with, too, were done once for both."""
    if not steps:
        return
    if steps not in PREPARED:
        prepare(steps[:-1], folder)
        with chdir(folder):
            do(steps[-1])
        PREPARED[steps] = files_in(folder)
        return
    for path, content in PREPARED[steps]:
        Path(folder, path).parent.mkdir(parents=True, exist_ok=True)
        Path(folder, path).write_bytes(content)


def answer_to(ask: Ask, folder: Path) -> tuple[str, tuple[str, ...]]:
    """What the command says in this folder, and the commands that this recommends."""
    with chdir(folder):
        words = shlex.split(ask.words)
        ran = rarms(*words, "--json", stdin="no\n", at_a_terminal=ask.at_a_terminal)
        shown = rarms(*words, *(["--text"] if words[0] == "report" else [])).out if ask.in_view else ""
    says = " ".join(re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", ran.out + ran.err + shown).split())
    return says, tuple(dict.fromkeys([*commands_in(documents_in(ran.out)), *recommended(shown)]))


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
    (found,) = (machine["id"] for machine in machines_on(Path()) if machine["settings"]["name"] == "vision")
    return str(found)


DONE: set[tuple[str, Files]] = set()
"""Commands that ended well, with the files that they began with: the same again would show nothing new."""


def run_it(command: str, folder: Path, may_answer: ExitCode = ExitCode.DONE) -> None:
    """Run it; what asks is told not to, and a FILE is one that is there where it is read."""
    begun = (command, files_in(folder))
    if begun in DONE:
        return
    words = [PLACEHOLDERS.get(word, word) for word in shlex.split(command)[1:]]
    with chdir(folder), without_scheduler():
        words = [id_of_vision() if word == "ID" else word for word in words]
        if words[0] == "apply" and "a.plan" in words and not Path("a.plan").exists():
            do("plan --out a.plan")
        elif words[0] in ASKS and "--abandon" not in words:
            words.append("--auto-approve")
        elif words[0] == "prove" and "--without-load" not in words:
            words.append("--load-host")
        ran = rarms(*words)
    assert ran.code in {*WORKS, may_answer}, f"`{command}`: exit {ran.code}\n{ran.out}{ran.err}"
    if ran.code in WORKS:
        DONE.add(begun)


@pytest.mark.parametrize(
    ("steps", "ask"),
    [
        pytest.param(steps, ask, id=f"{name}: {ask.words}")
        for name, (steps, *asks) in SITUATIONS.items()
        for ask in asks
    ],
)
def test_what_is_recommended_works_where_it_is_recommended(steps: tuple[Step, ...], ask: Ask, tmp_path: Path) -> None:
    origin = tmp_path / "origin"
    origin.mkdir()
    prepare(steps, origin)

    says, commands = answer_to(ask, origin)

    for message in several(ask.says):
        assert message in says
    for wanted in several(ask.recommends):
        assert any(command.startswith(f"rarms {wanted}") for command in commands), (wanted, commands, says)
    for number, command in enumerate(commands):
        folder = copy_files(origin, tmp_path / f"copy-{number}")
        with chdir(folder):
            for step in ask.first:
                do(step)
        run_it(command, folder, ask.may_answer)


def recommended(text: str) -> tuple[str, ...]:
    """The commands that a text recommends, as printed; a line's end in one is a blank."""
    found = (" ".join(match.split()) for match in re.findall(r"`(rarms [a-z][^`]*)`", text))
    return tuple(dict.fromkeys(command for command in found if "..." not in command))


def test_recommended_commands_name_the_manifest(tmp_path: Path) -> None:
    folder = tmp_path / "my robot"
    folder.mkdir()
    prepare(given(MEASURED), folder)
    Path(tmp_path, "test.yaml").write_text("policy: { headroom: none }\n", encoding="utf-8")

    with chdir(tmp_path):
        ran = rarms("plan", "-f", "my robot", "--overlay", "test.yaml")
    commands = recommended(ran.err)

    assert "rarms measure vision -f 'my robot' --overlay test.yaml" in commands
    for command in commands:
        run_it(command, tmp_path)


def test_machine_of_another_partition_is_released_as_recommended(tmp_path: Path) -> None:
    prepare(given(MANIFEST, "apply"), tmp_path)
    with chdir(tmp_path):
        unknown = rarms("import", "speech", "--id", "none", "--auto-approve")
        (machine,) = re.findall(r"vision ([0-9a-f-]{36})", unknown.err)
        taken = rarms("import", "speech", "--id", machine, "--auto-approve")

    assert 'is already the partition "vision" of the application' in taken.err
    assert recommended(taken.err) == ("rarms release vision",)
    run_it("rarms release vision", tmp_path)
