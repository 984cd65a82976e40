"""`rarms doctor`: examine hosts for what makes a plan ineffective or unsafe."""

from rarms_iac.app.doctor import examine_hosts
from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.messages import write_output
from rarms_iac.cli.options import host_or_snapshot_options, manifest_options, output_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.views.console import render
from rarms_iac.views.finding_forms import OutputFormat, OutputTarget, render_findings
from rarms_iac.views.hosts import doctor_json, doctor_text


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
    name, sources = hosts.system.application.name, hosts.manifest.sources
    examined = examine_hosts(hosts)
    for output in outputs:
        match output.format:
            case OutputFormat.TEXT:
                content = doctor_text(name, examined.hosts, sources, examined.accepted)
                if output.path is None:
                    session.terminal.show(content)
                    continue
                text = render(content)
            case OutputFormat.JSON:
                text = doctor_json(name, examined.hosts, examined.accepted)
            case other:
                text = render_findings(other, examined.findings, sources, accepted=examined.accepted)
        write_output(session.terminal, output, text)
    return ExitCode.FOUND if has_errors(examined.findings) else ExitCode.DONE
