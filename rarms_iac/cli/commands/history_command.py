"""`rarms history`: what was applied to the hosts, by whom, when, and what was taken back."""

from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.app.status import history_of_hosts
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import host_options, json_option, manifest_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.views.status import history_json, history_text


@rarms_command("history")
@manifest_options
@host_options
@json_option
def command(session: Session, *, source: ManifestSource, host_selection: HostSelection, as_json: bool) -> ExitCode:
    """Show what was applied to the hosts by whom, when and with which plan, and what was undone. Only reads."""
    hosts = select_hosts(load_manifest(source), host_selection)
    history = history_of_hosts(hosts)
    if as_json:
        session.terminal.data(history_json(hosts.system.application.name, history))
    else:
        session.terminal.show(history_text(history))
    return ExitCode.DONE
