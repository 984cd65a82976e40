"""One run of the command line: all that happens in it becomes text for a person and an exit code."""

import traceback
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import click

from rarms_iac.app.use_case_errors import Outcome, UseCaseError, bug_finding, system_finding, usage_finding
from rarms_iac.cli.ending import CODES, ExitCode, Interrupted, Interrupts, WrongRequest, confirm_signal
from rarms_iac.cli.group import root_group
from rarms_iac.cli.session import Session
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.views.terminal import Terminal, this_terminal

if TYPE_CHECKING:
    from rich.console import RenderableType

    from rarms_iac.model.diagnostics import Sources


def run_command_line(arguments: Sequence[str]) -> int:
    """Run the command that these words ask for and return its exit code. Raises nothing."""
    terminal = this_terminal()
    session = Session(terminal=terminal, interrupts=Interrupts(on_request=partial(confirm_signal, terminal.err)))
    try:
        code = run_guarded(session, arguments, _invoke)
        session.terminal.flush()
    except OSError as error:
        code = _tell(session, ExitCode.FAILED, [system_finding(error)])
    return int(code)


def run_guarded(
    session: Session, arguments: Sequence[str], invoke: Callable[[Session, Sequence[str]], ExitCode]
) -> ExitCode:
    """Return the command's exit code; every exception becomes words on standard error and an exit code."""
    terminal = session.terminal
    try:
        with session.interrupts.listening():
            return invoke(session, arguments)
    except click.exceptions.Exit as ending:
        return ExitCode(ending.exit_code)
    except click.UsageError as error:
        session.as_json = session.as_json or "--json" in arguments
        terminal.talk(usage_text(error))
        _tell_programs(session, [_usage_finding(error)])
        return ExitCode.USAGE
    except UseCaseError as problem:
        _trace(terminal)
        by_signal = session.interrupts.exit_code if problem.outcome is Outcome.INTERRUPTED else None
        if by_signal and not problem.findings:
            return _interrupted(session, by_signal)
        return _tell(session, by_signal or CODES[problem.outcome], problem.findings, problem.sources)
    except KeyboardInterrupt as interrupt:
        return _interrupted(session, interrupt.code if isinstance(interrupt, Interrupted) else ExitCode.INTERRUPTED)
    except OSError as error:
        _trace(terminal)
        return _tell(session, ExitCode.FAILED, [system_finding(error)])
    except (Exception, RecursionError) as error:  # noqa: BLE001 - the last line of defence: no traceback reaches a user
        _trace(terminal)
        return _tell(session, ExitCode.FAILED, [bug_finding(error)])


def _interrupted(session: Session, code: ExitCode) -> ExitCode:
    from rarms_iac.views.run import interruption_text

    session.terminal.talk(interruption_text(code.name.lower(), session.command, begun=session.interrupts.begun))
    return code


def _invoke(session: Session, arguments: Sequence[str]) -> ExitCode:
    group = root_group()
    with group.make_context("rarms", list(arguments), obj=session) as context:
        answer = group.invoke(context)
    return ExitCode(answer)


def usage_text(error: click.UsageError) -> "RenderableType":
    """Return the usage, the error in the words and the advice."""
    from rarms_iac.views.console import paragraph, stack

    usage = paragraph(error.ctx.get_usage()) if error.ctx else None
    finding = _usage_finding(error)
    return stack(usage, paragraph(finding.detail), paragraph(finding.advice))


def _usage_finding(error: click.UsageError) -> Diagnostic:
    advice = error.advice if isinstance(error, WrongRequest) else ""
    is_named = error.ctx is not None and error.ctx.parent is not None
    return usage_finding(error.format_message(), advice, (error.ctx.info_name or "") if error.ctx and is_named else "")


def _tell(
    session: Session, code: ExitCode, diagnostics: Sequence[Diagnostic], sources: "Sources | None" = None
) -> ExitCode:
    from rarms_iac.cli.messages import tell

    tell(session.terminal, diagnostics, sources)
    _tell_programs(session, diagnostics)
    return code


def _tell_programs(session: Session, diagnostics: Sequence[Diagnostic]) -> None:
    """Write the findings as the JSON answer, unless there is an answer already."""
    if session.as_json and not session.terminal.answered:
        from rarms_iac.model.diagnostics import Findings, in_order
        from rarms_iac.views.json_output import json_of

        session.terminal.data(json_of(Findings(findings=in_order(tuple(diagnostics)))))


def _trace(terminal: Terminal) -> None:
    if terminal.debug:
        terminal.talk(traceback.format_exc().rstrip())
