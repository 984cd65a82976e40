"""`rarms init`: a first manifest, with comments that say what else there is."""

from pathlib import Path

import click

from rarms_iac.app.errors import Outcome, UseCaseError, in_the_way
from rarms_iac.app.files import make_folder, write_file
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import json_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.manifest.init import initial_manifest, name_from
from rarms_iac.manifest.load import DEFAULT_NAME
from rarms_iac.model.names import is_name
from rarms_iac.views.as_json import as_json as to_json
from rarms_iac.views.output.common import WrittenOutput


@rarms_command("init")
@click.argument("folder", default=".")
@click.option("--name", help="The application's name. [default: as the folder]")
@json_option
def command(session: Session, *, folder: str, name: str | None, as_json: bool) -> ExitCode:
    """Write a commented rarms.yaml into FOLDER (default: here) that validates and plans as it is.

    It describes two components on a simulated host, which needs nothing installed. A FOLDER that is not
    there is made; a manifest that is there stays.
    """
    if name is not None and not is_name(name):
        raise click.UsageError(
            f"{name!r} cannot be an application's name: small letters, digits and hyphens, 63 at most.",
            click.get_current_context(),
        )
    path = Path(folder) / DEFAULT_NAME
    if path.exists() or path.is_symlink():
        raise UseCaseError(Outcome.FAILED, [in_the_way(path.as_posix())])
    text = initial_manifest(name or name_from(path.resolve().parent.name))
    make_folder(path.parent.as_posix())
    write_file(str(path), text.encode())
    if as_json:
        session.terminal.data(to_json(WrittenOutput(files=(path.as_posix(),))))
    else:
        session.terminal.talk(f"Wrote {path.as_posix()}.")
        session.terminal.talk("Edit it, then: rarms validate, rarms measure, rarms plan, rarms apply.")
    return ExitCode.DONE
