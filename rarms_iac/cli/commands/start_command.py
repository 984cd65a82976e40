"""`rarms start`: start partitions that were stopped."""

import click

from rarms_iac.app.requests import HostSelection, ManifestSource, RunOptions
from rarms_iac.cli.applying import stop_or_start
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import host_options, json_option, manifest_options, plan_run_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.plan import Purpose


@rarms_command("start")
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
    """Start PARTITIONs again that `rarms stop` stopped, or a measurement that was killed; without PARTITION: all.

    Plan, show, ask, and do it. A PARTITION that is named starts also where somebody else stopped it.
    """
    return stop_or_start(session, source, host_selection, Purpose.START, partitions, how, as_json=as_json)
