"""`rarms snapshot`: what a host looks like, as a file."""

from pathlib import Path

import click

from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.files import write_file
from rarms_iac.cli.hosts import hosts_of, observe
from rarms_iac.cli.manifests import system_of
from rarms_iac.cli.options import HostOptions, ManifestOptions, host_options, manifest_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.planfile.snapshot import write_snapshot


@rarms_command("snapshot")
@manifest_options
@host_options
@click.option("--out", metavar="PATH", help="A file for one host; a folder, which gets HOST.json, for any number.")
def command(session: Session, *, source: ManifestOptions, where: HostOptions, out: str | None) -> ExitCode:
    """Write down what the hosts look like, in JSON. Only reads.

    `rarms plan --snapshot FILE` plans from it where the host cannot be reached, as in a pull request.
    """
    system, opened = system_of(source)
    hosts = hosts_of(system, opened, source, where)
    into_folder = out is not None and Path(out).is_dir()
    if len(hosts.chosen) != 1 and not into_folder:
        raise click.UsageError(
            f"There are {len(hosts.chosen)} hosts: name one with --host, or a folder that exists with --out.",
            click.get_current_context(),
        )
    for name in hosts.chosen:
        data = write_snapshot(observe(hosts.open(name)))
        if out is None:
            session.terminal.data(data.decode("utf-8"))
        else:
            path = (Path(out) / f"{name}.json").as_posix() if into_folder else out
            write_file(path, data)
            session.terminal.talk(f"Wrote {path}. Plan from it with: rarms plan --snapshot {name}={path}")
    return ExitCode.DONE
