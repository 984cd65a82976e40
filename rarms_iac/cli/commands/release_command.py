"""`rarms release`: let go of a partition."""

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


@rarms_command("release")
@click.argument("partition")
@manifest_options
@host_options
@run_options
@click.option("--out", metavar="FILE", help="Only write the plan, sealed, for `rarms apply FILE`.")
@json_option
def command(
    session: Session,
    *,
    partition: str,
    source: ManifestSource,
    where: HostSelection,
    how: RunOptions,
    out: str | None,
    as_json: bool,
) -> ExitCode:
    """Take rarms' mark off PARTITION: the machine stays as it is, and rarms no longer touches it."""
    manifest = load_manifest(source)
    hosts = where_it_is_ours(select_hosts(manifest, where), partition)
    wish = Wish(purpose=Purpose.RELEASE, partition=partition)
    return plan_ask_apply(session, hosts, wish, how, as_json=as_json, out=out)


def where_it_is_ours(hosts: Hosts, partition: str) -> Hosts:
    """The host on which the partition carries our mark; where none does, all, and each then says so."""
    if len(hosts.chosen) == 1:
        return hosts
    states = observe_hosts(hosts)
    application = hosts.system.application.name
    having = [
        name
        for name in hosts.chosen
        if any(one.mark and one.mark.name == partition for one in states[name].of(application).partitions)
    ]
    if len(having) > 1:
        raise click.UsageError(
            f"{partition} is on {', '.join(having)}: name one of them with --host.", click.get_current_context()
        )
    return replace(hosts, selection=HostSelection(hosts=tuple(having))) if having else hosts
