"""`rarms doctor`: what makes a plan void or unsafe on the hosts."""

from rarms_iac.app.files import write_file
from rarms_iac.app.hosts import Hosts, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.apply.doctor.examine import examine
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.examining import examinations
from rarms_iac.cli.options import host_or_snapshot_options, manifest_options, output_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.manifest.acceptance import apply_acceptances
from rarms_iac.model.diagnostics import Diagnostic, has_errors, in_order
from rarms_iac.views.console import render
from rarms_iac.views.finding_forms import OutputFormat, OutputTarget, render_findings
from rarms_iac.views.hosts import Examined, doctor_json, doctor_text


@rarms_command("doctor")
@manifest_options
@host_or_snapshot_options
@output_option
def command(
    session: Session, *, source: ManifestSource, where: HostSelection, outputs: tuple[OutputTarget, ...]
) -> ExitCode:
    """Look at the hosts and tell what makes a plan void or unsafe there, with what to do. Only reads.

    A host is looked at live, or as `rarms snapshot` or the observe script wrote it down (--snapshot). Errors end with
    exit code 2; warnings and notes do not.
    """
    manifest = load_manifest(source)
    system = manifest.system
    hosts = select_hosts(manifest, where)
    examined, accepted = examined_hosts(hosts)
    sources = manifest.sources
    found = in_order([finding for one in examined for finding in one.findings])
    for output in outputs:
        match output.format:
            case OutputFormat.TEXT:
                content = doctor_text(system.application.name, examined, sources, accepted)
                if output.path is None:
                    session.terminal.show(content)
                    continue
                text = render(content)
            case OutputFormat.JSON:
                text = doctor_json(system.application.name, examined, accepted)
            case other:
                text = render_findings(other, found, sources, accepted=accepted)
        if output.path is not None:
            write_file(output.path, text.encode("utf-8", errors="backslashreplace"))
        else:
            session.terminal.data(text)
    return ExitCode.FOUND if has_errors(found) else ExitCode.DONE


def examined_hosts(hosts: Hosts) -> tuple[tuple[Examined, ...], tuple[Diagnostic, ...]]:
    """Every chosen host with what was found there, and what the policy accepts of it.

    Raises:
        UseCaseError: a host cannot be read.
    """
    examined: list[Examined] = []
    accepted: list[Diagnostic] = []
    for host in examinations(hosts):
        kept, silenced = apply_acceptances(
            examine(host),
            hosts.system.policy,
            hosts.manifest.places,
            hosts.manifest.source.today,
            codes=(),  # an acceptance that silences nothing here may be needed by a plan
        )
        examined.append(Examined(state=host.state, condition=host.condition, findings=kept))
        accepted += silenced
    return tuple(examined), tuple(accepted)
