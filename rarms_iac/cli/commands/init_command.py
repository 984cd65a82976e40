"""`rarms init`: a first manifest, with comments that say what else there is."""

import click

from rarms_iac.app.manifest_files import write_first_manifest
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import json_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.views.as_json import as_json as to_json
from rarms_iac.views.output.common import WrittenOutput


@rarms_command("init")
@click.argument("folder", default=".")
@click.option("--name", help="The application's name. [default: as the folder]")
@click.option("--tutorial", is_flag=True, help="The manifest of the tutorial: what it asks for does not fit at first.")
@json_option
def command(session: Session, *, folder: str, name: str | None, tutorial: bool, as_json: bool) -> ExitCode:
    """Write a commented rarms.yaml into FOLDER (default: here) that validates and plans as it is.

    It describes two components on a simulated host, which needs nothing installed. A FOLDER that is not
    there is made; a manifest that is there stays. rarms.schema.json beside it is what editors check it against.
    """
    paths = write_first_manifest(folder, name, tutorial=tutorial)
    if as_json:
        session.terminal.data(to_json(WrittenOutput(files=paths)))
    else:
        session.terminal.talk(f"Wrote {paths[0]}, and {paths[1]} for your editor.")
        session.terminal.tell("Edit it, then: rarms validate, rarms measure, rarms plan, rarms apply.")
    return ExitCode.DONE
