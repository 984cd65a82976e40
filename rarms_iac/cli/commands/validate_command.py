"""`rarms validate`: report every mistake of a manifest at once, without a host."""

from dataclasses import replace

import click

from rarms_iac.app.manifests import check_manifest
from rarms_iac.app.requests import ManifestSource
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.messages import write_output
from rarms_iac.cli.options import manifest_options, output_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.diagnostics import in_order
from rarms_iac.views.finding_forms import OutputFormat, OutputTarget, render_findings
from rarms_iac.views.findings import findings_text


@rarms_command("validate")
@click.argument("files", nargs=-1, metavar="[FILE]...")
@manifest_options
@output_option
def command(
    session: Session, *, files: tuple[str, ...], source: ManifestSource, outputs: tuple[OutputTarget, ...]
) -> ExitCode:
    """Check manifests and say everything that is wrong or odd at once.

    FILE is a manifest, the folder of one, or - for standard input; without, it is the one that --manifest names.
    No host is asked. Errors end with exit code 2; warnings and notes do not.
    """
    manifests = [check_manifest(replace(source, manifest=file), planning=False) for file in files or (source.manifest,)]
    findings = in_order(tuple(dict.fromkeys(finding for manifest in manifests for finding in manifest.findings)))
    accepted = tuple(dict.fromkeys(finding for manifest in manifests for finding in manifest.accepted))
    sources = {file: lines for manifest in manifests for file, lines in manifest.loaded.sources.items()}
    for output in outputs:
        if output.path is None and output.format is OutputFormat.TEXT:
            session.terminal.show(findings_text(findings, sources, accepted=accepted))
            continue
        text = render_findings(output.format, findings, sources, accepted=accepted)
        write_output(session.terminal, output, text)
    return ExitCode.FOUND if any(manifest.has_errors for manifest in manifests) else ExitCode.DONE
