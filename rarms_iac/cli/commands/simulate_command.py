"""`rarms simulate change`: play somebody else at a simulated host."""

import click

from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.app.simulate import IntruderChange, change_behind_rarms
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import host_options, manifest_options
from rarms_iac.cli.session import Session, rarms_command


@rarms_command("simulate")
@click.argument("event", type=click.Choice(["change"]))
@click.argument("partition")
@click.option("--reserve", type=click.IntRange(0, 100), metavar="PERCENT", help="Set this reserve, of each processor.")
@click.option("--on/--off", "running", default=None, help="Start it, or turn it off.")
@click.option("--remove", is_flag=True, help="Turn it off and remove it.")
@manifest_options
@host_options
def command(
    session: Session,
    *,
    event: str,  # noqa: ARG001 - there is one
    partition: str,
    reserve: int | None,
    running: bool | None,
    remove: bool,
    source: ManifestSource,
    host_selection: HostSelection,
) -> ExitCode:
    """Change PARTITION on its simulated host behind rarms' back, so that `rarms drift` finds it."""
    hosts = select_hosts(load_manifest(source), host_selection)
    change = IntruderChange(partition=partition, reserve=reserve, running=running, is_removed=remove)
    host = change_behind_rarms(hosts, change)
    session.terminal.tell(f"{host}: changed {partition} as somebody else would. `rarms drift` finds it.")
    return ExitCode.DONE
