"""Commands about hosts as they are: `rarms doctor`, `status`, `history`, `drift`, `snapshot` and `simulate`."""

from pathlib import Path

import click

from rarms_iac.app.doctor import examine_hosts
from rarms_iac.app.drift import look_for_drift
from rarms_iac.app.files import make_folder, write_file
from rarms_iac.app.hosts import record_host, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.app.scripts import OBSERVE_NAME, observe_script
from rarms_iac.app.simulate import IntruderChange, change_behind_rarms
from rarms_iac.app.status import history_of_hosts, overview_of
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.messages import write_outputs
from rarms_iac.cli.options import host_options, host_or_snapshot_options, json_option, manifest_options, output_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.views.finding_forms import OutputTarget
from rarms_iac.views.hosts import doctor_as, drift_text, snapshot_script_text
from rarms_iac.views.json_output import json_of
from rarms_iac.views.status import history_text, status_text


@rarms_command("doctor")
@manifest_options
@host_or_snapshot_options
@output_option
def doctor_command(
    session: Session, *, source: ManifestSource, host_selection: HostSelection, outputs: tuple[OutputTarget, ...]
) -> ExitCode:
    """Look at the hosts and tell what makes a plan ineffective or unsafe there, with what to do. Only reads.

    A host is looked at live, or as `rarms snapshot` or the observe script wrote it down (--snapshot). Errors end with
    exit code 2; warnings and notes do not.
    """
    hosts = select_hosts(load_manifest(source), host_selection)
    examined = examine_hosts(hosts)
    write_outputs(
        session.terminal,
        outputs,
        lambda form: doctor_as(form, examined, hosts.manifest.sources),
    )
    return ExitCode.FOUND if has_errors(examined.findings) else ExitCode.DONE


@rarms_command("status")
@manifest_options
@host_or_snapshot_options
@json_option
def status_command(
    session: Session, *, source: ManifestSource, host_selection: HostSelection, as_json: bool
) -> ExitCode:
    """Show hosts, partitions and their components, what was applied and proven, what no longer holds. Only reads.

    `rarms` alone, in a folder with a manifest, does the same.
    """
    overview = overview_of(select_hosts(load_manifest(source), host_selection))
    if as_json:
        session.terminal.data(json_of(overview))
    else:
        session.terminal.show(status_text(overview))
    return ExitCode.DONE


@rarms_command("history")
@manifest_options
@host_options
@json_option
def history_command(
    session: Session, *, source: ManifestSource, host_selection: HostSelection, as_json: bool
) -> ExitCode:
    """Show what was applied to the hosts by whom, when and with which plan, and what was undone. Only reads."""
    hosts = select_hosts(load_manifest(source), host_selection)
    history = history_of_hosts(hosts)
    if as_json:
        session.terminal.data(json_of(history))
    else:
        session.terminal.show(history_text(history))
    return ExitCode.DONE


@rarms_command("drift")
@manifest_options
@host_or_snapshot_options
@json_option
def drift_command(
    session: Session, *, source: ManifestSource, host_selection: HostSelection, as_json: bool
) -> ExitCode:
    """Tell what was changed on the hosts, and what is not applied yet. Only reads.

    Exit code 2 where a host was changed, 5 where something is only not applied yet, 0 where there is neither.
    """
    hosts = select_hosts(load_manifest(source), host_selection)
    report = look_for_drift(hosts)
    if as_json:
        session.terminal.data(json_of(report))
    else:
        session.terminal.show(drift_text(report))
    for host, plan in report.unfinished.items():
        session.terminal.tell(
            f"{host}: a run of plan {plan} is unfinished; what it has yet to do is listed as changed."
        )
    if any(host.host_changed for host in report.hosts):
        return ExitCode.FOUND
    return ExitCode.NOT_APPLIED if any(host.not_applied for host in report.hosts) else ExitCode.DONE


@rarms_command("snapshot")
@manifest_options
@host_options
@click.option("--out", metavar="PATH", help="A file for one host; a folder, which gets HOST.json, for any number.")
@click.option("--script", is_flag=True, help="Write the script that looks, to be run on a Hyper-V host or in a guest.")
def snapshot_command(
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


@rarms_command("simulate")
@click.argument("event", type=click.Choice(["change"]))
@click.argument("partition")
@click.option("--reserve", type=click.IntRange(0, 100), metavar="PERCENT", help="Set this reserve, of each processor.")
@click.option("--on/--off", "running", default=None, help="Start it, or turn it off.")
@click.option("--remove", is_flag=True, help="Turn it off and remove it.")
@manifest_options
@host_options
def simulate_command(
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
