"""Commands about hosts as they are: `rarms doctor`, `status`, `history`, `drift`, `snapshot`, `simulate`, `install`."""

from dataclasses import dataclass
from pathlib import Path

from rarms_iac.app.control import Control
from rarms_iac.app.doctor import examine_hosts, report_examinations
from rarms_iac.app.drift import look_for_drift
from rarms_iac.app.files import make_folder, write_file, write_new_file
from rarms_iac.app.hosts import record_host, select_hosts
from rarms_iac.app.install import InstallRequest, install
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource, SnapshotSelection, flag, option
from rarms_iac.app.scripts import OBSERVE_NAME, observe_script
from rarms_iac.app.simulate import IntruderChange, change_behind_rarms
from rarms_iac.app.status import history_of_hosts, overview_of
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.cli.command import rarms_command
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.messages import OutputOptions, TerminalReporter, tell, write_outputs
from rarms_iac.cli.session import Session
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.views.changes import drift_text
from rarms_iac.views.doctor import doctor_as, installation_text
from rarms_iac.views.json_output import json_of
from rarms_iac.views.status import history_text, status_text


@dataclass(frozen=True, slots=True, kw_only=True)
class DoctorOptions:
    """A second answer of the doctor."""

    report: str | None = option(
        "--report", metavar="FILE", help="Also write a file for a bug report, without names and secrets."
    )


@rarms_command("doctor")
def doctor_command(
    session: Session,
    source: ManifestSource,
    host_selection: SnapshotSelection,
    options: OutputOptions,
    file: DoctorOptions,
) -> ExitCode:
    """Find settings of the hosts that make a plan ineffective or unsafe, and show the actions. Only reads.

    rarms looks at the live host, or at a file of `rarms snapshot` or of the observe script (--snapshot). Errors end
    with exit code 2; warnings and notes do not.
    """
    outputs = options.targets(session)
    hosts = select_hosts(load_manifest(source), host_selection)
    examined = examine_hosts(hosts)
    if file.report is not None:
        write_new_file(file.report, json_of(report_examinations(hosts, examined)).encode("ascii"))
        session.terminal.tell(f"Wrote {file.report}, without names and secrets. Attach it to a bug report.")
    write_outputs(session.terminal, outputs, lambda form: doctor_as(form, examined, hosts.manifest))
    return ExitCode.FOUND if has_errors(examined.findings) else ExitCode.DONE


@rarms_command("status")
def status_command(session: Session, source: ManifestSource, host_selection: SnapshotSelection) -> ExitCode:
    """Show hosts, partitions and components: the applied layout, proofs, and values that are out of date. Only reads.

    `rarms` alone, in a folder with a manifest, does the same.
    """
    overview = overview_of(select_hosts(load_manifest(source), host_selection))
    session.answer(lambda: json_of(overview), lambda: status_text(overview))
    return ExitCode.FAILED if overview.unknown else ExitCode.DONE


@rarms_command("history")
def history_command(session: Session, source: ManifestSource, host_selection: HostSelection) -> ExitCode:
    """Show each apply and undo on the hosts: who, when, and with which plan. Only reads."""
    hosts = select_hosts(load_manifest(source), host_selection)
    history = history_of_hosts(hosts)
    session.answer(lambda: json_of(history), lambda: history_text(history))
    return ExitCode.DONE


@rarms_command("drift")
def drift_command(session: Session, source: ManifestSource, host_selection: SnapshotSelection) -> ExitCode:
    """Show what other tools changed on the hosts, and what is not applied yet. Only reads.

    Exit code 2: another tool changed a host. Exit code 5: the manifest has changes that are not applied. Exit code 0:
    neither.
    """
    hosts = select_hosts(load_manifest(source), host_selection)
    report = look_for_drift(hosts)
    session.answer(lambda: json_of(report), lambda: drift_text(report))
    for host, plan in report.unfinished.items():
        session.terminal.tell(
            f"{host}: a run of plan {plan} is unfinished. Its remaining steps are listed as not applied."
        )
    if any(host.host_changed for host in report.hosts):
        return ExitCode.FOUND
    return ExitCode.NOT_APPLIED if any(host.not_applied for host in report.hosts) else ExitCode.DONE


@dataclass(frozen=True, slots=True, kw_only=True)
class SnapshotOptions:
    """Options of `rarms snapshot` alone."""

    out: str | None = option(
        "--out", metavar="PATH", help="Write one host to this file, or each host to HOST.json in this folder."
    )
    script: bool = flag("--script", help="Write the script that reads a Hyper-V host or a guest. Run it there.")


@rarms_command("snapshot", json=False)
def snapshot_command(
    session: Session, source: ManifestSource, host_selection: HostSelection, options: SnapshotOptions
) -> ExitCode:
    """Write the state of the hosts as JSON. Only reads.

    `rarms plan --snapshot FILE` plans from the file without a connection, for example in a pull request. --script
    writes observe.ps1 instead. This script prints the same JSON, without a manifest and without rarms on the host.
    """
    out = options.out
    if options.script:
        return _script(session, out)
    hosts = select_hosts(load_manifest(source), host_selection)
    several = len(hosts.chosen) != 1
    if several and (out is None or Path(out).is_file()):
        raise RequestError(f"There are {len(hosts.chosen)} hosts: choose one with --host, or give a folder with --out.")
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
            session.terminal.tell(f"Wrote {path}. Plan from it with: rarms plan --snapshot {name}={path}")
    return ExitCode.DONE


def _script(session: Session, out: str | None) -> ExitCode:
    text = observe_script()
    if out is None:
        session.terminal.exactly(text)
        return ExitCode.DONE
    path = (Path(out) / OBSERVE_NAME).as_posix() if Path(out).is_dir() else out
    write_file(path, text.encode("ascii"))
    session.terminal.tell(f"Wrote {path}. Run it on the host as administrator, and copy its output:")
    session.terminal.talk(f"  powershell -NoProfile -ExecutionPolicy RemoteSigned -File {Path(path).name} > host.json")
    session.terminal.tell("Plan from it with: rarms plan --snapshot HOST=host.json")
    return ExitCode.DONE


@rarms_command("simulate", json=False)
def simulate_command(
    session: Session, change: IntruderChange, source: ManifestSource, host_selection: HostSelection
) -> ExitCode:
    """Change PARTITION on its simulated host as another tool would, so that `rarms drift` finds it."""
    hosts = select_hosts(load_manifest(source), host_selection)
    host = change_behind_rarms(hosts, change)
    session.terminal.tell(f"{host}: changed {change.partition} as another tool would.")
    return ExitCode.DONE


@rarms_command("install")
def install_command(
    session: Session, source: ManifestSource, host_selection: HostSelection, request: InstallRequest
) -> ExitCode:
    """Install this version of rarms on Linux hosts, or remove rarms with --remove.

    rarms and its dependencies go to /opt/rarms, over the connection in the manifest. The host needs Python 3.11 or
    newer, but no internet access. If another version left a run unfinished, that version finishes the run first. The
    previous version stays; older versions are removed.
    """
    hosts = select_hosts(load_manifest(source), host_selection)
    with TerminalReporter(session) as reporter:
        result = install(hosts, request, Control(reporter=reporter))
    tell(session.terminal, result.findings)
    session.answer(lambda: json_of(result), lambda: installation_text(result))
    return ExitCode.DONE
