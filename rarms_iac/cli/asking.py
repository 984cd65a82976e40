"""The use scenario on a terminal: after each component, a level of performance is picked from what was measured."""

import sys
from dataclasses import replace
from pathlib import Path

import click

from rarms_iac.app.errors import UseCaseError
from rarms_iac.app.files import STANDARD_INPUT, write_file
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.measure import ExperimentResult
from rarms_iac.app.report_model import Measurement
from rarms_iac.app.requests import ManifestSource
from rarms_iac.cli.datalogs import measurements_of
from rarms_iac.cli.reporting import reported, speaks_ascii_only
from rarms_iac.cli.selecting import Unclear, choice_of, edit_of, select
from rarms_iac.cli.session import Session
from rarms_iac.cli.telling import tell
from rarms_iac.measuring.strategies import apts_of
from rarms_iac.model.outcomes import Swept
from rarms_iac.statistics.curves import curves_of, least_reserve
from rarms_iac.views.measure import settings_text
from rarms_iac.views.reports.terminal import TerminalPlot, legend
from rarms_iac.views.select import selection_text


def refuse_without_terminal(session: Session, source: ManifestSource) -> None:
    """Asking needs somebody to ask, and a file to write the answer into.

    Raises:
        click.UsageError: one of them is missing.
    """
    if not session.terminal.answers:
        says = "There is no terminal to ask at. Leave --interactive out, and choose with `rarms select`."
        raise click.UsageError(says, click.get_current_context())
    if source.manifest == STANDARD_INPUT:
        raise click.UsageError("Standard input cannot be changed: name a file.", click.get_current_context())


def ask_levels(session: Session, hosts: Hosts, result: ExperimentResult) -> ExperimentResult:
    """Show what was measured, and take a level for each component until the answer is empty; what it comes to then."""
    source = hosts.manifest.source
    session.terminal.talk("")
    session.terminal.talk(settings_text(result))
    for measurement in reported(source, result.experiment.setup.members).measurements:
        if measurement.rests:
            _show_plots(session, measurement)
    for name in result.experiment.setup.members:
        while at := _answer(session, name):
            if _chosen(session, source, name, at):
                break
    return _as_chosen(hosts, result)


def _as_chosen(hosts: Hosts, result: ExperimentResult) -> ExperimentResult:
    """The same beside the thresholds that the manifest has by now; what was searched for others is not told."""
    system = load_manifest(hosts.manifest.source).system
    before = result.experiment
    members = tuple(replace(member, apt=system.components[member.name].apt) for member in before.members)
    if members == before.members:
        return result
    experiment = replace(before, members=members)
    planned = least_reserve(curves_of(result.settings, experiment.runs, apts_of(experiment)))
    return replace(result, experiment=experiment, conclusion=Swept(), planned=planned)


def _show_plots(session: Session, measurement: Measurement) -> None:
    terminal = session.terminal
    for index in measurement.indexes:
        terminal.talk("")
        terminal.talk(TerminalPlot(curve=index, ascii_only=speaks_ascii_only(terminal)))
    terminal.talk(legend(ascii_only=speaks_ascii_only(terminal)))


def _answer(session: Session, name: str) -> str:
    session.terminal.flush()
    session.terminal.status(f"\nA level for {name}, as 100 ms or 95 %, or Enter to go on: ")
    return sys.stdin.readline().strip()


def _chosen(session: Session, source: ManifestSource, name: str, at: str) -> bool:
    """Write the level into the manifest, read anew each time; False where it cannot be had, which is told."""
    manifest = load_manifest(source)
    system = manifest.system
    try:
        choice = choice_of(system, name, at, None)
        selected = select(choice, measurements_of(system, manifest.folder, source), manifest)
    except Unclear as problem:
        session.terminal.talk(str(problem))
        return False
    except UseCaseError as halted:
        tell(session.terminal, halted.diagnostics, halted.sources)
        return False
    edit = edit_of(choice, manifest)
    if edit.after != edit.before:
        write_file(edit.file, edit.after.encode("utf-8"))
    session.terminal.talk(selection_text(selected.selection))
    session.terminal.talk(f"Written to {Path(edit.file).as_posix()}.")
    return True
