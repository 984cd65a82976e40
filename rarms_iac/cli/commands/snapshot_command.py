"""`rarms snapshot`: what a host looks like, as a file."""

from pathlib import Path

import click

from rarms_iac.app.files import make_folder, write_file
from rarms_iac.app.hosts import record_host, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.app.scripts import OBSERVE_NAME, observe_script
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import host_options, manifest_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.views.messages import snapshot_script_text


@rarms_command("snapshot")
@manifest_options
@host_options
@click.option("--out", metavar="PATH", help="A file for one host; a folder, which gets HOST.json, for any number.")
@click.option("--script", is_flag=True, help="Write the script that looks, to be run on a Hyper-V host or in a guest.")
def command(
    session: Session, *, source: ManifestSource, host_selection: HostSelection, out: str | None, script: bool
) -> ExitCode:
    """Write down what the hosts look like, in JSON. Only reads.

    `rarms plan --snapshot FILE` plans from it where the host cannot be reached, as in a pull request. --script writes
    observe.ps1 instead, which needs neither manifest nor rarms: what it prints is what rarms writes of a Hyper-V host.
    """
    if script:
        return _script(session, out)
    manifest = load_manifest(source)
    hosts = select_hosts(manifest, host_selection)
    several = len(hosts.chosen) != 1
    if several and (out is None or Path(out).is_file()):
        raise click.UsageError(
            f"There are {len(hosts.chosen)} hosts: name one with --host, or a folder with --out.",
            click.get_current_context(),
        )
    if several and out is not None:
        make_folder(out)
    into_folder = out is not None and Path(out).is_dir()
    for name in hosts.chosen:
        data = record_host(hosts.open(name))
        if out is None:
            session.terminal.data(data.decode("utf-8"))
        else:
            path = (Path(out) / f"{name}.json").as_posix() if into_folder else out
            write_file(path, data)
            session.terminal.talk(f"Wrote {path}. Plan from it with: rarms plan --snapshot {name}={path}")
    return ExitCode.DONE


def _script(session: Session, out: str | None) -> ExitCode:
    text = observe_script()
    if out is None:
        session.terminal.exactly(text)
        return ExitCode.DONE
    path = (Path(out) / OBSERVE_NAME).as_posix() if Path(out).is_dir() else out
    write_file(path, text.encode("ascii"))
    session.terminal.talk(snapshot_script_text(path, Path(path).name))
    return ExitCode.DONE
