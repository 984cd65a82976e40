"""What was measured and planned, in forms to keep: `rarms graph`, `report` and `export`."""

from pathlib import Path

import click

from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.files import write_file
from rarms_iac.app.graph import candidate_nodes, layout_of_manifest
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.report import report_of_manifest
from rarms_iac.app.requests import ManifestSource
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.messages import tell
from rarms_iac.cli.options import json_option, manifest_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.wording import quoted
from rarms_iac.views.graph import candidates_json, candidates_text, graph_json, graph_nodes, graph_text


@rarms_command("graph")
@manifest_options
@click.option("--candidates", is_flag=True, help="Draw which components could be combined, and what is known of it.")
@json_option
def graph_command(session: Session, *, source: ManifestSource, candidates: bool, as_json: bool) -> ExitCode:
    """Draw which component runs in which partition on which host, as the manifest alone places them.

    With --candidates: the components whose reservations are measured, and every compound of them that could reserve
    less than its parts; what a compound will probably need is marked "predicted" until it is measured. Needs no host.
    The picture is in Mermaid, which GitHub and GitLab draw in a page or a pull request.
    """
    manifest = load_manifest(source)
    name = manifest.system.application.name
    if candidates:
        nodes = candidate_nodes(manifest, predict=True)
        text = candidates_json(name, nodes) if as_json else candidates_text(name, nodes)
    else:
        placed = graph_nodes(manifest.system, layout_of_manifest(manifest))
        text = graph_json(name, placed) if as_json else graph_text(name, placed)
    session.terminal.data(text)
    return ExitCode.DONE


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
def report_command(
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


@rarms_command("export")
@click.argument("file", metavar="FILE")
@click.argument("components", metavar="[COMPONENT]...", nargs=-1)
@manifest_options
@click.option("--samples", is_flag=True, help="Every sample too: a row each.")
@click.option("--trail", is_flag=True, help="Only what the last `rarms tune` asked for, in order, as CSV.")
def export_command(
    session: Session, *, file: str, components: tuple[str, ...], source: ManifestSource, samples: bool, trail: bool
) -> ExitCode:
    """Write what was measured of the COMPONENTs (default: all) to FILE: name.csv or name.xlsx.

    CSV has a row a setting and performance index, or with --samples a row a sample. XLSX has a summary and, for each
    data log, a sheet with settings, curve and a chart; after `rarms tune` also what that asked for. Numbers are
    numbers; their units stand in the headers.
    """
    from rarms_iac.views.reports.spreadsheet import csv_text, sample_rows, setting_rows, trail_rows

    ending = Path(file).suffix.lower()
    if ending not in {".csv", ".xlsx"}:
        raise click.UsageError(f"{quoted(file)} ends with neither .csv nor .xlsx.", click.get_current_context())
    if trail and (samples or ending != ".csv"):
        raise click.UsageError("--trail goes into a .csv file, without --samples.", click.get_current_context())
    report = report_of_manifest(load_manifest(source), components)
    if ending == ".csv":
        rows = trail_rows(report.tunings) if trail else sample_rows(report) if samples else setting_rows(report)
        data = csv_text(rows).encode("utf-8", "replace")
    else:
        from rarms_iac.views.reports.spreadsheet import TooManyRows, workbook

        try:
            data = workbook(report, samples=samples)
        except TooManyRows as problem:
            raise UseCaseError(Outcome.NEGATIVE, [problem.finding()]) from None
    write_file(file, data)
    session.terminal.talk(f"Wrote {file}.")
    return ExitCode.DONE
