"""`rarms drift`: what differs since the last apply, and whether the host or the manifest changed."""

from rarms_iac.app.drift import look_for_drift
from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import host_or_snapshot_options, json_option, manifest_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.views.hosts import drift_json, drift_text


@rarms_command("drift")
@manifest_options
@host_or_snapshot_options
@json_option
def command(session: Session, *, source: ManifestSource, host_selection: HostSelection, as_json: bool) -> ExitCode:
    """Tell what somebody changed on the hosts, and what is not applied yet. Only reads.

    Exit code 2 where a host was changed, 5 where something is only not applied yet, 0 where there is neither.
    """
    hosts = select_hosts(load_manifest(source), host_selection)
    report = look_for_drift(hosts)
    if as_json:
        session.terminal.data(drift_json(hosts.system.application.name, report.hosts, compared=not report.problems))
    else:
        session.terminal.show(drift_text(report.hosts, report.unfinished, report.problems))
    for host, plan in report.unfinished.items():
        session.terminal.tell(
            f"{host}: a run of plan {plan} is unfinished; what it has yet to do is listed as changed."
        )
    if report.host_changed:
        return ExitCode.FOUND
    return ExitCode.NOT_APPLIED if report.not_applied else ExitCode.DONE
