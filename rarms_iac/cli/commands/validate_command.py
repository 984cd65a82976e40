"""`rarms validate`: everything wrong with a manifest at once, without a host."""

import click

from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.files import write_file
from rarms_iac.cli.manifests import Opened, open_manifest
from rarms_iac.cli.options import ManifestOptions, manifest_options, output_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.cli.terminal import DEFAULT_WIDTH
from rarms_iac.model.diagnostics import in_order
from rarms_iac.views.diagnostics import Output, OutputFormat, Sources, render


@rarms_command("validate")
@click.argument("files", nargs=-1, metavar="[FILE]...")
@manifest_options
@output_option
def command(
    session: Session, *, files: tuple[str, ...], source: ManifestOptions, outputs: tuple[Output, ...]
) -> ExitCode:
    """Check manifests and say everything that is wrong or odd at once.

    FILE is a manifest, the folder of one, or - for standard input; without, it is the one that --manifest names.
    No host is asked. Errors end with exit code 2; warnings and notes do not.
    """
    opened = [
        open_manifest(file, source.overlays, source.today, planning=False) for file in files or (source.manifest,)
    ]
    for output in outputs:
        text = told(output.format, opened, DEFAULT_WIDTH if output.path is not None else session.terminal.text_width)
        if output.path is not None:
            write_file(output.path, text.encode("utf-8", errors="backslashreplace"))
        elif output.format is OutputFormat.TEXT and session.terminal.colour:
            from rarms_iac.views.diagnostics.colour import coloured

            session.terminal.data(coloured(text))
        else:
            session.terminal.data(text)
    return ExitCode.FOUND if any(one.has_errors for one in opened) else ExitCode.DONE


def told(form: OutputFormat, opened: list[Opened], width: int) -> str:
    """The findings of all manifests in that form; a file that several share is told of once."""
    findings = in_order(tuple(dict.fromkeys(finding for one in opened for finding in one.findings)))
    accepted = tuple(dict.fromkeys(finding for one in opened for finding in one.accepted))
    sources: Sources = {file: lines for one in opened for file, lines in one.loaded.sources.items()}
    return render(form, findings, sources, accepted=accepted, width=width)
