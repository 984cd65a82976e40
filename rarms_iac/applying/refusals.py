"""Why a run was not begun, or ended early: the findings of applying."""

from collections.abc import Sequence
from typing import Any

from rarms_iac.diff.readings import VALUE
from rarms_iac.model.commands import (
    APPLY,
    APPLY_ABANDON,
    DRIFT,
    HISTORY,
    MEASURE,
    PLAN,
    PLAN_OUT,
    UNDO,
    command,
    prose,
    sentences,
)
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.facets import Readings
from rarms_iac.model.journal import Journal, RunKind, RunStarted, ScriptRun, ScriptStarted
from rarms_iac.model.plan import Step
from rarms_iac.model.system import Application
from rarms_iac.model.version import __version__
from rarms_iac.providers.interface import HostDamaged, HostError, HostUnreachable
from rarms_iac.providers.robot import OtherVersion
from rarms_iac.storage.marks import ForeignValue
from rarms_iac.texts.findings import DAMAGED, NOTHING_CHANGED, OTHER_VERSION, SCRIPT_REFUSED, Finding
from rarms_iac.texts.messages import in_a_row, quoted

HOST_FAILED = Finding.error("RARMS189", "The host cannot be reached, read or changed")

MOVED = Finding.error("RARMS182", "The host has changed since the plan was made")

OTHERS_RUN = Finding.error("RARMS340", "The host or run belongs to another application or robot")

LOCKED = Finding.error("RARMS184", "Another run has locked the host")

UNFINISHED = Finding.error("RARMS183", "Another run is unfinished on the host")

STEP_FAILED = Finding.error("RARMS186", "A step failed")


UNDO_PARTIAL = Finding.warning("RARMS193", "Not everything can be undone")
UNDO_FOREIGN = Finding.warning("RARMS402", "An undo would restore a value that rarms did not set")
NOT_ACCEPTED = Finding.error("RARMS109", "The plan has provisional reservations that are not accepted")
UNSIGNED = Finding.error("RARMS341", "The plan is not signed with the key")

_LEAVE = prose(APPLY_ABANDON, " to leave the host as it is.")
GO_ON = prose("Run the same command again to finish the run, ", UNDO, " to reverse it, or ", _LEAVE)
_NEW_PLAN = prose("Make a new plan: ", PLAN_OUT, ".")
_LOST = prose("After the undo, run ", PLAN, " to show the differences to the manifest.")


def not_accepted(plan: str, host: str, partitions: Sequence[str]) -> Diagnostic:
    """Refuse a plan that would set provisional reservations on a host that is not simulated."""
    return NOT_ACCEPTED.of_host(
        host,
        "Plan {plan} has provisional reservations for {host}: {partitions:all}.",
        prose(
            "Nothing was changed. Measure the rest: ",
            MEASURE,
            ". Or accept the reservations in a plan file: ",
            PLAN_OUT.also(accept_provisional=True),
            ". Then apply that file.",
        ),
        plan=plan,
        partitions=tuple(partitions),
    )


def used(host: str, plan: str) -> Diagnostic:
    """Refuse a plan that was used, or that another run has overtaken."""
    return MOVED.of_host(
        host,
        "Plan {plan} was applied to {host}, or another apply or undo has run there since the plan was made.",
        _NEW_PLAN,
        plan=plan,
    )


def moved(host: str, parts: Sequence[str]) -> Diagnostic:
    """Refuse a plan whose host differs in these parts from what the plan saw."""
    return MOVED.of_host(
        host,
        "Changed on {host} since the plan was made: {differences:;}.",
        prose("Nothing was changed. Show the changes with ", DRIFT, ". ", _NEW_PLAN),
        differences=tuple(parts),
    )


def different_host(host: str, serial: int, planned: int) -> Diagnostic:
    """Refuse a host that knows of fewer runs than the plan: it is another one, as a host keeps all its runs."""
    return MOVED.of_host(
        host,
        (
            "{host} is not the host of the plan, or was restored from a backup. The host has {serial} applies "
            "and undos; the plan expects {planned_serial}."
        ),
        sentences("Nothing was changed. Check that the folder and the machine are correct.", _NEW_PLAN),
        serial=serial,
        planned_serial=planned,
    )


def unfinished(host: str, journal: Journal | ScriptRun) -> Diagnostic:
    """Refuse a host on which a run of another plan is unfinished."""
    if isinstance(journal, Journal) and (other := begun_by_another_version(host, journal)) is not None:
        return other
    started = journal.started
    either = prose(APPLY, " to finish the run, ", UNDO, " to reverse it")
    if started.run is RunKind.UNDO:
        either = prose(UNDO, " to finish the run")
    return UNFINISHED.of_host(
        host,
        "{_run} on {host}, started by {owner}, is unfinished.",
        prose("If that process is still running, wait. Otherwise run ", either, ", or ", _LEAVE),
        run=started.run.value,
        plan=started.plan,
        owner=started.started_by,
        _run=_run(started),
    )


def begun_by_another_version(host: str, journal: Journal) -> Diagnostic | None:
    """Return the refusal of an unfinished run of another version; None: this version began it, or it is finished."""
    started = journal.started
    if not journal.unfinished or started.rarms == __version__:
        return None
    advice = prose(
        "Nothing was changed. On a host over ssh, run ",
        command("install", host=host),
        f" to finish the run with rarms {started.rarms}. Otherwise run ",
        APPLY,
        f" with rarms {started.rarms}. Or run ",
        _LEAVE,
    )
    return UNFINISHED.of_host(
        host,
        "{_run} on {host}, started by rarms {began}, is unfinished. This is rarms {version}.",
        advice,
        plan=started.plan,
        began=started.rarms,
        version=__version__,
        owner=started.started_by,
        _run=_run(started),
    )


def unsigned(host: str, plan: str, *, is_begun: bool) -> Diagnostic:
    """Return the refusal of a signature, of a plan or of an unfinished run's journal, that the key does not fit."""
    subject = "The unfinished run" if is_begun else "The part"
    advice = (
        prose(
            "Check the journal. Then close the run with ",
            APPLY_ABANDON,
            ", or finish the run in an environment without the key.",
        )
        if is_begun
        else prose("Make the plan again in an environment that has the key: ", PLAN_OUT, ".")
    )
    return UNSIGNED.of_host(
        host,
        "{_subject} of plan {plan} on {host} is not signed with the key of this environment.",
        advice,
        plan=plan,
        _subject=subject,
    )


def without_key(plan: str) -> Diagnostic:
    """Refuse a plan where its manifest demands signed plans and no key is set."""
    return UNSIGNED.at(
        None,
        "The manifest of plan {plan} has `signed_plans: true`, but no key is set in this environment.",
        "Set RARMS_PLAN_KEY or RARMS_PLAN_KEY_FILE both for making and for applying plans.",
        plan=plan,
    )


def is_run_of(journal: Journal | ScriptRun, application: Application) -> bool:
    """Return whether a run is this application's and this robot's; one that names no robot is any robot's."""
    started = journal.started
    return started.application == application.name and started.robot in {"", application.robot}


def run_of_another(host: str, journal: Journal | ScriptRun, application: Application) -> Diagnostic:
    """Refuse to undo a run of another application or robot, which alone may do that."""
    started = journal.started
    begun_for, own = (
        f"{quoted(each)} of the robot {quoted(robot)}" if robot else quoted(each)
        for each, robot in ((started.application, started.robot), (application.name, application.robot))
    )
    advice = prose("Undo it with that application's manifest: ", command("undo", f="MANIFEST"), ".")
    if started.application == application.name:
        advice = prose(f"Use that robot's overlay, {started.robot}.yaml, as the last overlay.")
    return OTHERS_RUN.of_host(
        host,
        "{_run} on {host}, started by {owner}, belongs to the application {_begun_for}. This manifest is for {_own}.",
        sentences("Nothing was changed.", advice),
        plan=started.plan,
        application=started.application,
        own_application=application.name,
        robot=started.robot,
        own_robot=application.robot,
        owner=started.started_by,
        _run=_run(started),
        _begun_for=begun_for,
        _own=own,
    )


def lock_held(host: str, detail: str) -> Diagnostic:
    """Refuse a host that another run holds, as `detail` says."""
    advice = "Wait for that run to end, or let rarms wait: `--lock-timeout 60s`."
    return LOCKED.of_host(host, "{host}: {reason}.", advice, reason=detail)


def step_moved(host: str, step: Step, live: Readings) -> Diagnostic:
    """Report that a step found neither what the plan saw nor what it wants."""
    return MOVED.at(
        step.place,
        "{resource} on {host}, before `{step}`: {_differences}.",
        prose("Nothing more was changed. Show the state with ", DRIFT, ". ", GO_ON),
        address=str(step.address),
        _differences=differences(live, step.before),
        **_step_facts(host, step),
        **_reading_facts(live, step.before),
    )


def step_failed(host: str, step: Step, error: HostError) -> Diagnostic:
    """Report that the host refused a step or failed in it."""
    return STEP_FAILED.at(
        step.place,
        "{resource} on {host}, `{step}`: {reason}.",
        sentences(error.advice, GO_ON),
        address=str(step.address),
        reason=error.message,
        **_step_facts(host, step),
    )


def step_missed(host: str, step: Step, live: Readings) -> Diagnostic:
    """Report that a step's call went through, and that the host still shows something else."""
    return STEP_FAILED.at(
        step.place,
        "{resource} on {host}, after `{step}`: {_differences}.",
        GO_ON,
        address=str(step.address),
        _differences=differences(live, step.after),
        **_step_facts(host, step),
        **_reading_facts(live, step.after),
    )


def _step_facts(host: str, step: Step) -> dict[str, Any]:
    return {"host": host, "step": step.title, "resource": str(step.address)}


def _reading_facts(live: Readings, expected: Readings) -> dict[str, Any]:
    """Return both values of each setting that differs: `is_reserve` 50, `expected_reserve` 70."""
    names = [name for name in expected if live.get(name) != expected[name]]
    return {f"expected_{_label(name)}": expected[name] for name in names} | {
        f"is_{_label(name)}": live[name] for name in names if name in live
    }


def host_failed(error: HostError) -> Diagnostic:
    """Return the failure to reach, read or change a host, or of damaged files of ours there."""
    detail, reason = "{host}: {reason}.", error.message
    if isinstance(error, HostUnreachable):
        return HOST_FAILED.of_host(error.host, detail, error.advice, reason=reason, unreachable=True)
    if isinstance(error, OtherVersion):
        installed = error.installed
        return OTHER_VERSION.of_host(
            error.host, detail, error.advice, reason=reason, installed=installed, version=__version__
        )
    finding = DAMAGED if isinstance(error, HostDamaged) else HOST_FAILED
    return finding.of_host(error.host, detail, error.advice, reason=reason)


def journal_missing(host: str, marked: Sequence[str]) -> Diagnostic:
    """Report a host that has marks of rarms and has no record of a run that made them."""
    return DAMAGED.of_host(
        host,
        "{_describe_missing_journal} rarms cannot undo anything there.",
        "Nothing was changed. Restore the journal from a copy, or undo the other hosts with --host.",
        marked=tuple(marked),
        _describe_missing_journal=describe_missing_journal(host, marked),
    )


def describe_missing_journal(host: str, marked: Sequence[str]) -> str:
    """Say that the journal of a host is missing, and how that shows."""
    have = "has" if len(marked) == 1 else "have"
    return f"The journal of {host} is missing: no run is recorded, but {in_a_row(marked)} {have} a mark of rarms."


def not_reached(host: str, address: str, difference: str) -> Diagnostic:
    """Report a difference that another look shows after all steps went through."""
    return STEP_FAILED.at(
        None,
        "{resource} on {host}: {difference}.",
        prose("Another tool also changes this setting. Show the changes with ", DRIFT, "."),
        address=address,
        host=host,
        resource=address,
        difference=difference,
    )


def nothing_to_undo(host: str, why: str) -> Diagnostic:
    """Report that no apply can be undone."""
    advice = prose(HISTORY, " lists the runs on each host.")
    return NOTHING_CHANGED.of_host(host, "{host} has nothing to undo: {reason}.", advice, reason=why)


def undo_partial(host: str, step: Step) -> Diagnostic:
    """Warn of a step that cannot be undone, or not wholly."""
    return UNDO_PARTIAL.at(
        None,  # the step's line is of the manifest that was applied, which may name another component by now
        "{resource} on {host}, `{step}`: {reason}.",
        _LOST,
        address=str(step.address),
        reason=step.undo.message,
        **_step_facts(host, step),
    )


def undo_script_partial(host: str, lost: str) -> Diagnostic:
    """Warn of what an undo script cannot undo, as it says of itself."""
    return UNDO_PARTIAL.of_host(host, "{host}: {reason}.", _LOST, reason=lost.rstrip("."))


def undo_foreign(host: str, value: ForeignValue, *, can_keep: bool) -> Diagnostic:
    """Warn of a value that the undo sets again and that rarms had not set."""
    set_again = prose("After the undo, ", APPLY, f" sets {value.applied} again.")
    keep = prose(f"To keep {value.applied}, run ", command("undo", keep=True), " instead.") if can_keep else ""
    return UNDO_FOREIGN.at(
        None,
        "{resource} on {host}: rarms did not set {setting} {foreign}; the last apply set {applied}.",
        sentences(keep, set_again),
        address=str(value.address),
        host=host,
        setting=value.name,
        foreign=value.foreign,
        applied=value.applied,
        resource=str(value.address),
    )


def undo_script_foreign(host: str, line: str) -> Diagnostic:
    """Warn of a value that an undo script sets again although rarms had not set it, as it says of itself."""
    advice = prose("After the undo, ", APPLY, " sets the manifest's value again.")
    return UNDO_FOREIGN.of_host(host, "{host}, not set by rarms: {value}.", advice, value=line)


def no_script(host: str, plan: str) -> Diagnostic:
    """Return the refusal of a plan without the script that its host needs."""
    return SCRIPT_REFUSED.of_host(host, "Plan {plan} does not have a script for {host}.", _NEW_PLAN, plan=plan)


def differences(live: Readings, expected: Readings) -> str:
    """Write what differs from the expected readings, sorted by name: `reserve is 50, not 70`."""
    changes = [
        f"{_label(name)} is {_format_reading(live[name])}, not {_format_reading(expected[name])}"
        if name in live
        else f"{_label(name)} does not exist"
        for name in sorted(expected)
        if live.get(name) != expected[name]
    ]
    return ", ".join(changes)


def _label(name: str) -> str:
    """Return the name of a reading as people know it: of a task class's value, its own."""
    return name.removeprefix(VALUE)


def _format_reading(value: bool | int | str) -> str:
    match value:
        case bool():
            return "yes" if value else "no"
        case "":
            return "empty"
        case _:
            return str(value)


def _run(started: RunStarted | ScriptStarted) -> str:
    match started.run:
        case RunKind.APPLY:
            return f"The apply of plan {started.plan}"
        case RunKind.UNDO:
            return f"The undo of plan {started.plan}"
