"""`rarms undo`: take the last apply back."""

from collections.abc import Sequence

import click

from rarms_iac.app.hosts import hold_hosts, host_errors, owner, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.apply.undo import can_be_undone, not_undone_findings, steps_undone, undo
from rarms_iac.cli.applying import ask, ended, reporter_of
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.commands.apply_command import worst
from rarms_iac.cli.options import RunOptions, host_options, json_option, manifest_options, run_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.cli.telling import tell
from rarms_iac.model.journal import Journal, ScriptRun
from rarms_iac.providers.interface import LiveHost
from rarms_iac.views.run import undo_text


@rarms_command("undo")
@manifest_options
@host_options
@run_options
@json_option
def command(
    session: Session, *, source: ManifestSource, where: HostSelection, how: RunOptions, as_json: bool
) -> ExitCode:
    """Take the last apply back, finished or not: its steps' undos, the last one first.

    Shows what comes back and what cannot, and asks. Where hosts have different last applies, --host says which.
    """
    manifest = load_manifest(source)
    hosts = select_hosts(manifest, where)
    live = [hosts.open(name) for name in hosts.chosen]
    with host_errors():
        journals = [(host, host.journal()) for host in live]
    meant = last_applies(journals) or journals[:1]
    if len({journal.started.plan for _, journal in meant if journal is not None}) > 1:
        raise click.UsageError(
            f"The hosts have different last applies. Choose with --host: {', '.join(host.name for host, _ in meant)}.",
            click.get_current_context(),
        )
    if not how.auto_approve and any(journal is not None and can_be_undone(journal) for _, journal in meant):
        _show_and_ask(session, meant)
    taken = tuple(host for host, _ in meant)
    with hold_hosts(taken, how.lock_timeout_ms), session.interrupts.gently(), reporter_of(session) as reporter:
        reports = [undo(host, owner(), reporter, session.interrupts.should_stop, how.waits) for host in taken]
    return ended(session, worst(reports), as_json=as_json)


Found = Sequence[tuple[LiveHost, Journal | ScriptRun | None]]


def last_applies(journals: Found) -> Found:
    """The hosts on which there is something to take back, or to go on with."""
    return [(host, journal) for host, journal in journals if journal is not None and can_be_undone(journal)]


def _show_and_ask(session: Session, meant: Found) -> None:
    if not session.terminal.answers:
        raise click.UsageError("There is no terminal to ask at. Give --auto-approve.", click.get_current_context())
    for host, journal in meant:
        if journal is not None:
            steps = steps_undone(journal)
            session.terminal.talk(undo_text(host.name, journal.started, steps))
            tell(session.terminal, not_undone_findings(host.name, journal))
    ask(session, "Take this back?")
