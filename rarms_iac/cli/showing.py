"""What `rarms show --script` shows: scripts as they run, compared, checked, and what carries them over ssh."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from rarms_iac.app.wiring import bootstrap_script
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.scripts import (
    Choice,
    PlanScript,
    check_file,
    chosen,
    outline_in,
    outline_of,
    plan_scripts,
    write_scripts,
)
from rarms_iac.cli.session import Session
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.model.plan import Plan
from rarms_iac.powershell.difference import difference
from rarms_iac.views.as_json import as_json as written
from rarms_iac.views.console import stack
from rarms_iac.views.finding_forms import findings_json
from rarms_iac.views.findings import findings_text
from rarms_iac.views.output.plan import ScriptOutput, ScriptsOutput
from rarms_iac.views.scripts import difference_json, difference_text, script_text

if TYPE_CHECKING:
    from rich.console import RenderableType


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptOptions:
    """Which scripts, and how."""

    hosts: tuple[str, ...] = ()
    guest: str = ""
    undo: bool = False
    whole: bool = False
    raw: bool = False
    out: str | None = None
    against: str | None = None
    as_json: bool = False


def show_scripts(session: Session, plan: Plan, options: ScriptOptions) -> ExitCode:
    """Show, write or compare the scripts of a plan that the options choose."""
    everything = plan_scripts(plan)
    found = chosen(everything, Choice(hosts=options.hosts, guest=options.guest, undo=options.undo), plan)
    if options.out is not None:
        return _write(session, _with_undo(everything, found, options), options)
    if options.against is not None:
        return _compare(session, found, options.against, as_json=options.as_json)
    if options.as_json:
        session.terminal.data(written(ScriptsOutput(plan=plan.id, scripts=tuple(map(_output, found)))))
    elif options.raw:
        _raw(session, found)
    else:
        for script in found:
            session.terminal.show(_headed(script.name, script.text, whole=options.whole))
    _tell_others(session, everything, found)
    return ExitCode.DONE


def show_check(session: Session, path: str, *, as_json: bool) -> ExitCode:
    """What is wrong with a script that somebody edited; nothing else is looked at."""
    text, found = check_file(path)
    if as_json:
        session.terminal.data(findings_json(found))
    elif found:
        session.terminal.show(findings_text(found, {path: text}))
    else:
        session.terminal.data(f"{path} may run: it is made as rarms makes its scripts, whatever values it holds.\n")
    return ExitCode.FOUND if has_errors(found) else ExitCode.DONE


def show_transport(session: Session, options: ScriptOptions) -> ExitCode:
    """The one fixed command that receives scripts at the other end of ssh."""
    script = bootstrap_script()
    if options.raw:
        session.terminal.data(script)
    else:
        session.terminal.show(_headed("bootstrap.ps1, given to ssh as one command", script, whole=True))
    return ExitCode.DONE


def _headed(name: str, text: str, *, whole: bool) -> "RenderableType":
    return stack(name, script_text(text, whole=whole), "")


def _output(script: PlanScript) -> ScriptOutput:
    return ScriptOutput(
        name=script.name, host=script.host, guest=script.guest, undo=script.undo, sha256=script.sha256, text=script.text
    )


def _raw(session: Session, found: tuple[PlanScript, ...]) -> None:
    if len(found) != 1:
        raise _one_only("--raw", found)
    session.terminal.exactly(found[0].text)


def _compare(session: Session, found: tuple[PlanScript, ...], against: str, *, as_json: bool) -> ExitCode:
    if len(found) != 1:
        raise _one_only("--against", found)
    told = difference(outline_in(against, found[0]), outline_of(found[0]))
    if as_json:
        session.terminal.data(difference_json(told, against, found[0].name))
    else:
        session.terminal.show(difference_text(told, against, found[0].name))
    return ExitCode.DONE


def _with_undo(
    everything: tuple[PlanScript, ...], found: tuple[PlanScript, ...], options: ScriptOptions
) -> tuple[PlanScript, ...]:
    """What is written out: without a choice all, and beside every script the one that takes it back."""
    if not options.guest and not options.undo:
        return tuple(script for script in everything if not options.hosts or script.host in options.hosts)
    pairs = {(script.host, script.guest) for script in found}
    return tuple(script for script in everything if (script.host, script.guest) in pairs)


def _write(session: Session, found: tuple[PlanScript, ...], options: ScriptOptions) -> ExitCode:
    assert options.out is not None
    for path in write_scripts(found, options.out):
        session.terminal.talk(f"Wrote {path}.")
    if not found:
        session.terminal.talk("The plan changes nothing, so it has no scripts.")
    return ExitCode.DONE


def _tell_others(session: Session, everything: tuple[PlanScript, ...], found: tuple[PlanScript, ...]) -> None:
    guests = sorted({script.guest for script in everything if script.guest} - {script.guest for script in found})
    if not found:
        session.terminal.talk("The plan changes nothing on the hosts themselves.")
    if guests:
        session.terminal.talk(f"Guests have scripts of their own: {', '.join(guests)} (--guest NAME).")


def _one_only(option: str, found: tuple[PlanScript, ...]) -> click.UsageError:
    told = (
        f"those of {', '.join(script.host for script in found)} are meant"
        if found
        else "the plan has none of that kind"
    )
    return click.UsageError(f"{option} takes one script, and {told}: choose with --host.", click.get_current_context())
