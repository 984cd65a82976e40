"""`rarms select`: choose a level of performance."""

from dataclasses import replace

import click

from rarms_iac.app.files import STANDARD_INPUT, write_file
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import ManifestSource
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.configuration import record_choices
from rarms_iac.cli.datalogs import measurements_of
from rarms_iac.cli.options import json_option, manifest_options
from rarms_iac.cli.selecting import Unclear, choice_of, edit_of, select
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.cli.telling import tell
from rarms_iac.views.select import selection_json, selection_text


@rarms_command("select")
@click.argument("component")
@click.option("--at", required=True, metavar="LEVEL", help='What is good enough: "100 ms", "95 %", "24 /s".')
@click.option("--index", metavar="INDEX", help="Of which performance index, where the level fits several.")
@click.option("--dry-run", is_flag=True, help="Write nothing; show what would follow.")
@manifest_options
@json_option
def command(
    session: Session,
    *,
    component: str,
    at: str,
    index: str | None,
    dry_run: bool,
    source: ManifestSource,
    as_json: bool,
) -> ExitCode:
    """Choose the performance that is good enough for COMPONENT, and write it into the manifest as its APT.

    Shows the reservation that follows from what was measured, and what is left on the host. Comments of the manifest
    stay; what an overlay says is changed there. Exit code 4, and nothing is written, where no measured reservation
    meets the level; a reserve that the manifest fixes is not looked up.
    """
    if source.manifest == STANDARD_INPUT and not dry_run:
        raise click.UsageError("Standard input cannot be changed: name a file.", click.get_current_context())
    manifest = load_manifest(source)
    system = manifest.system
    try:
        choice = choice_of(system, component, at, index)
        measured = measurements_of(system, manifest.folder, source)
        selected = select(choice, measured, manifest)
    except Unclear as problem:
        raise click.UsageError(str(problem), click.get_current_context()) from None
    file = ""
    if not dry_run:
        edit = edit_of(choice, manifest)
        file = edit.file
        if edit.after != edit.before:
            write_file(edit.file, edit.after.encode("utf-8"))
        record_choices(replace(measured, system=selected.system), (component,))
    if as_json:
        session.terminal.data(selection_json(selected.selection, file, written=not dry_run))
    else:
        session.terminal.show(selection_text(selected.selection))
        tell(session.terminal, selected.findings, manifest.sources)
        session.terminal.talk("Nothing was written." if dry_run else f"Written to {file}.")
    return ExitCode.DONE
