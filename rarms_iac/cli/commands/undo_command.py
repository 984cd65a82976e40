"""`rarms undo`: take the last apply back."""

from collections.abc import Sequence

from rarms_iac.app.errors import RequestError
from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource, RunOptions
from rarms_iac.app.undo import LastApply, last_applies, preview, undo_applies
from rarms_iac.cli.applying import ask, report_end
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.messages import TerminalReporter, tell
from rarms_iac.cli.options import host_options, json_option, manifest_options, run_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.views.run import undo_text


@rarms_command("undo")
@manifest_options
@host_options
@run_options
@json_option
def command(
    session: Session, *, source: ManifestSource, host_selection: HostSelection, how: RunOptions, as_json: bool
) -> ExitCode:
    """Take the last apply back, finished or not: its steps' undos, the last one first.

    Shows what comes back and what cannot, and asks. Where hosts have different last applies, --host says which.
    """
    applies = last_applies(select_hosts(load_manifest(source), host_selection))
    if not how.auto_approve and any(last.can_be_undone for last in applies):
        _show_and_ask(session, applies)
    with TerminalReporter(session, steps_as_json=as_json) as reporter:
        report = undo_applies(applies, waits=how.waits, reporter=reporter, stop=session.interrupts)
    return report_end(session, report, as_json=as_json)


def _show_and_ask(session: Session, applies: Sequence[LastApply]) -> None:
    if not session.terminal.answers:
        raise RequestError("There is no terminal to ask at. Give --auto-approve.")
    for undo in preview(applies):
        session.terminal.talk(undo_text(undo.host, undo.started, undo.steps))
        tell(session.terminal, undo.remaining)
    ask(session, "Take this back?")
