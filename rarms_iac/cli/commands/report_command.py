"""`rarms report`: performance against reservation, as a page, as text, as JSON."""

import click

from rarms_iac.app.files import write_file
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.report import report_of_manifest
from rarms_iac.app.requests import ManifestSource
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.messages import tell
from rarms_iac.cli.options import json_option, manifest_options
from rarms_iac.cli.session import Session, rarms_command

DEFAULT_FILE = "report.html"


@rarms_command("report")
@click.argument("components", metavar="[COMPONENT]...", nargs=-1)
@manifest_options
@click.option(
    "-o",
    "--out",
    metavar="FILE",
    help=f"Where the page goes; - is standard output. [default: {DEFAULT_FILE}]",
)
@click.option("--text", "as_text", is_flag=True, help="Plot in the terminal instead of writing a page.")
@json_option
def command(
    session: Session,
    *,
    components: tuple[str, ...],
    source: ManifestSource,
    out: str | None,
    as_text: bool,
    as_json: bool,
) -> ExitCode:
    """Show what was measured of the COMPONENTs (default: all) and what each level of performance reserves.

    Writes one HTML file that needs no network: each curve has a line to drag to the level that is good enough, and
    shows the reservation, what the host has left, and the lines for the manifest.
    """
    if as_text and (out is not None or as_json):
        raise click.UsageError("--text goes without --out and --json.", click.get_current_context())
    writes_page = not as_text and (not as_json or out is not None)
    report = report_of_manifest(load_manifest(source), components, with_candidates=writes_page)
    if as_text:
        from rarms_iac.views.reports.terminal import report_text

        session.terminal.show(report_text(report, ascii_only=session.terminal.ascii_only))
    if as_json:
        from rarms_iac.views.reports.document import report_json

        session.terminal.data(report_json(report))
    if not writes_page:
        return ExitCode.DONE
    from rarms_iac.views.reports.html import MEGABYTE, as_html, size_warning

    page, file = as_html(report), out or DEFAULT_FILE
    if file == "-":
        session.terminal.data(page.decode("utf-8"))
        return ExitCode.DONE
    write_file(file, page)
    if len(page) > MEGABYTE:
        tell(session.terminal, [size_warning(file, len(page), len(report.measurements))])
    session.terminal.talk(f"Wrote {file}. Open it in a browser.")
    return ExitCode.DONE
