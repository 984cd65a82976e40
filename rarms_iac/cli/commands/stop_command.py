"""`rarms stop`: stop partitions until they are started again."""

import click

from rarms_iac.app.requests import HostSelection, ManifestSource, RunOptions
from rarms_iac.cli.applying import stop_or_start
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import host_options, json_option, manifest_options, plan_run_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.plan import Purpose


@rarms_command("stop")
@click.argument("partitions", metavar="[PARTITION]...", nargs=-1)
@manifest_options
@host_options
@plan_run_options
@json_option
def command(
    session: Session,
    *,
    partitions: tuple[str, ...],
    source: ManifestSource,
    host_selection: HostSelection,
    how: RunOptions,
    as_json: bool,
) -> ExitCode:
    """Stop PARTITIONs of this application until `rarms start`; without PARTITION: all of them.

    Plan, show, ask, and do it. Each one's mark says that it was stopped: it is no drift, and no plan starts it. What is
    set of it stays, and so does what the host promises it.
    """
    return stop_or_start(session, source, host_selection, Purpose.STOP, partitions, how, as_json=as_json)
