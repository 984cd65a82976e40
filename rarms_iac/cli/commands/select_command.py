"""`rarms select`: choose a level of performance."""

import click

from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import ManifestSource
from rarms_iac.app.select import SelectRequest, select_level
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.messages import tell
from rarms_iac.cli.options import json_option, manifest_options
from rarms_iac.cli.prompts import refuse_standard_input
from rarms_iac.cli.session import Session, rarms_command
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
    if not dry_run:
        refuse_standard_input(source)
    manifest = load_manifest(source)
    request = SelectRequest(component=component, level=at, index=index, dry_run=dry_run)
    outcome = select_level(manifest, request)
    if as_json:
        session.terminal.data(selection_json(outcome.selection, outcome.file, written=not dry_run))
        return ExitCode.DONE
    session.terminal.show(selection_text(outcome.selection))
    tell(session.terminal, outcome.findings, manifest.sources)
    session.terminal.talk("Nothing was written." if dry_run else f"Written to {outcome.file}.")
    return ExitCode.DONE
