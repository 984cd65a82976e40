"""`rarms doctor`: examine hosts for what makes a plan ineffective or unsafe."""

from rarms_iac.app.doctor import examine_hosts
from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.messages import write_outputs
from rarms_iac.cli.options import host_or_snapshot_options, manifest_options, output_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.views.finding_forms import OutputTarget
from rarms_iac.views.hosts import doctor_as


@rarms_command("doctor")
@manifest_options
@host_or_snapshot_options
@output_option
def command(
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
        lambda form: doctor_as(form, hosts.system.application.name, examined, hosts.manifest.sources),
    )
    return ExitCode.FOUND if has_errors(examined.findings) else ExitCode.DONE
