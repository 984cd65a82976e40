"""`rarms schema`: the JSON Schemas, for editors and programs."""

import click

from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.storage.shipped import shipped_text

SCHEMAS = ("manifest", "overlay", "plan", "snapshot", "output", "datalog")


@rarms_command("schema")
@click.argument(
    "name", type=click.Choice(SCHEMAS), default="manifest", metavar="[manifest|overlay|plan|snapshot|output|datalog]"
)
def command(session: Session, *, name: str) -> ExitCode:
    """Print a JSON Schema: of a manifest, an overlay, a plan, a snapshot, what --json prints, or a line of a data log.

    An editor that knows the manifest's schema completes keys and shows what each is for.
    """
    session.terminal.data(shipped_text(f"schemas/{name}.json"))
    return ExitCode.DONE
