"""`rarms status`: how the application stands, and the next command."""

from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.app.status import overview_of
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import host_or_snapshot_options, json_option, manifest_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.views.status import status_json, status_text


@rarms_command("status")
@manifest_options
@host_or_snapshot_options
@json_option
def command(session: Session, *, source: ManifestSource, host_selection: HostSelection, as_json: bool) -> ExitCode:
    """Show hosts, partitions and their components, what was applied and proven, what no longer holds. Only reads.

    `rarms` alone, in a folder with a manifest, does the same.
    """
    overview = overview_of(select_hosts(load_manifest(source), host_selection))
    if as_json:
        session.terminal.data(status_json(overview))
    else:
        session.terminal.show(status_text(overview))
    return ExitCode.DONE
