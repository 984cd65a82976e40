"""`rarms import`: take over a partition that rarms did not make."""

from dataclasses import replace

import click

from rarms_iac.app.hosts import Hosts, observe_hosts, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.cli.applying import plan_ask_apply
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import RunOptions, host_options, json_option, manifest_options, run_options
from rarms_iac.cli.planning import Wish
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.plan import Purpose


@rarms_command("import")
@click.argument("partition")
@click.option("--id", "machine", metavar="ID", required=True, help="The id of the machine, as `rarms plan` names it.")
@manifest_options
@host_options
@run_options
@click.option("--out", metavar="FILE", help="Only write the plan, sealed, for `rarms apply FILE`.")
@json_option
def command(
    session: Session,
    *,
    partition: str,
    machine: str,
    source: ManifestSource,
    where: HostSelection,
    how: RunOptions,
    out: str | None,
    as_json: bool,
) -> ExitCode:
    """Make the machine with this id the manifest's PARTITION: it gets a mark, and nothing else changes.

    The next plan then shows what the manifest wants to be different about it.
    """
    manifest = load_manifest(source)
    hosts = on_its_host(select_hosts(manifest, where), machine)
    wish = Wish(purpose=Purpose.IMPORT, partition=partition, machine=machine)
    return plan_ask_apply(session, hosts, wish, how, as_json=as_json, out=out)


def on_its_host(hosts: Hosts, machine: str) -> Hosts:
    """The one host that the machine is on.

    Raises:
        click.UsageError: several hosts are meant, and not exactly one has it.
    """
    if len(hosts.chosen) == 1:
        return hosts
    states = observe_hosts(hosts)
    having = [
        name
        for name in hosts.chosen
        if any(partition.id.lower() == machine.lower() for partition in states[name].partitions)
    ]
    if len(having) != 1:
        raise click.UsageError(
            f"{len(having) or 'None'} of the hosts {', '.join(hosts.chosen)} has a machine {machine}: name one with "
            "--host.",
            click.get_current_context(),
        )
    return replace(hosts, selection=HostSelection(hosts=tuple(having)))
