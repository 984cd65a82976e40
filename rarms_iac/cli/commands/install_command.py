"""`rarms install` brings rarms to Linux hosts."""

from rarms_iac.app.control import Control
from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.install import InstallRequest, install
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.cli.command import rarms_command
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.messages import TerminalReporter, tell
from rarms_iac.cli.session import Session
from rarms_iac.views.install import installation_text
from rarms_iac.views.json_output import json_of


@rarms_command("install")
def install_command(
    session: Session, source: ManifestSource, host_selection: HostSelection, request: InstallRequest
) -> ExitCode:
    """Install this version of rarms on Linux hosts, or remove it with --remove.

    It goes to /opt/rarms, with all that it needs, over the connection of the manifest. The host needs Python 3.11 or
    newer, and no internet. A run that another version left unfinished is finished by that version first. The version
    before stays there; older ones are removed.
    """
    hosts = select_hosts(load_manifest(source), host_selection)
    with TerminalReporter(session) as reporter:
        result = install(hosts, request, Control(reporter=reporter))
    tell(session.terminal, result.findings)
    session.answer(lambda: json_of(result), lambda: installation_text(result))
    return ExitCode.DONE
