"""`rarms validate`: everything wrong with a manifest at once, without a host."""

from dataclasses import replace

import click

from rarms_iac.app.files import write_file
from rarms_iac.app.manifests import CheckedManifest, check_manifest
from rarms_iac.app.requests import ManifestSource
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import manifest_options, output_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.cli.terminal import DEFAULT_WIDTH
from rarms_iac.model.diagnostics import in_order
from rarms_iac.views.diagnostics import Output, OutputFormat, Sources, render


@rarms_command("validate")
@click.argument("files", nargs=-1, metavar="[FILE]...")
@manifest_options
@output_option
def command(
    session: Session, *, files: tuple[str, ...], source: ManifestSource, outputs: tuple[Output, ...]
) -> ExitCode:
    """Check manifests and say everything that is wrong or odd at once.

    FILE is a manifest, the folder of one, or - for standard input; without, it is the one that --manifest names.
    No host is asked. Errors end with exit code 2; warnings and notes do not.
    """
    manifests = [check_manifest(replace(source, manifest=file), planning=False) for file in files or (source.manifest,)]
    for output in outputs:
        text = told(output.format, manifests, DEFAULT_WIDTH if output.path is not None else session.terminal.text_width)
        if output.path is not None:
            write_file(output.path, text.encode("utf-8", errors="backslashreplace"))
        elif output.format is OutputFormat.TEXT and session.terminal.colour:
            from rarms_iac.views.diagnostics.colour import coloured

            session.terminal.data(coloured(text))
        else:
            session.terminal.data(text)
    return ExitCode.FOUND if any(manifest.has_errors for manifest in manifests) else ExitCode.DONE


def told(form: OutputFormat, manifests: list[CheckedManifest], width: int) -> str:
    """The findings of all manifests in that form; a file that several share is told of once."""
    findings = in_order(tuple(dict.fromkeys(finding for manifest in manifests for finding in manifest.findings)))
    accepted = tuple(dict.fromkeys(finding for manifest in manifests for finding in manifest.accepted))
    sources: Sources = {file: lines for manifest in manifests for file, lines in manifest.loaded.sources.items()}
    return render(form, findings, sources, accepted=accepted, width=width)
