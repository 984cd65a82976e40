"""What was measured and planned, in forms to keep: `rarms graph`, `report` and `export`."""

from dataclasses import dataclass
from pathlib import Path

from rarms_iac.app.files import write_file
from rarms_iac.app.graph import candidate_graph, graph_of_manifest
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.report import report_of_manifest
from rarms_iac.app.requests import ManifestSource, argument, flag, option
from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError
from rarms_iac.cli.command import rarms_command
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.session import Session
from rarms_iac.model.wording import quoted
from rarms_iac.views.graph import candidates_table, candidates_text, graph_text
from rarms_iac.views.json_output import json_of


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphOptions:
    """What is drawn."""

    candidates: bool = flag("--candidates", help="Draw which components could be combined, and what is known of it.")


@rarms_command("graph")
def graph_command(session: Session, source: ManifestSource, options: GraphOptions) -> ExitCode:
    """Draw which component runs in which partition on which host, as the manifest alone places them.

    With --candidates: the components whose reservations are measured, and every compound of them that could reserve
    less than its parts; what a compound will probably need is marked "predicted" until it is measured. Needs no host.
    The picture is in Mermaid, which GitHub and GitLab draw in a page or a pull request. On a terminal, --candidates is
    a table.
    """
    manifest = load_manifest(source)
    if options.candidates:
        compounds = candidate_graph(manifest, predict=True)
        if session.as_json or session.terminal.piped:
            session.terminal.data(json_of(compounds) if session.as_json else candidates_text(compounds))
        else:
            session.terminal.show(candidates_table(compounds.candidates))
    else:
        graph = graph_of_manifest(manifest)
        session.terminal.data(json_of(graph) if session.as_json else graph_text(graph))
    return ExitCode.DONE


DEFAULT_FILE = "report.html"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportOptions:
    """Which components, and in which form."""

    components: tuple[str, ...] = argument("[COMPONENT]...", default=())
    out: str | None = option(
        "-o", "--out", metavar="FILE", help=f"Where the page goes; - is standard output. [default: {DEFAULT_FILE}]"
    )
    as_text: bool = flag("--text", help="Plot in the terminal instead of writing a page.")


@rarms_command("report")
def report_command(session: Session, options: ReportOptions, source: ManifestSource) -> ExitCode:
    """Show what was measured of the COMPONENTs (default: all) and what each level of performance reserves.

    Writes one HTML file that needs no network: each curve has a line to drag to the level that is good enough, and
    shows the reservation, what the host has left, and the lines for the manifest.
    """
    if options.as_text and (options.out is not None or session.as_json):
        raise RequestError("--text goes without --out and --json.")
    writes_page = not options.as_text and (not session.as_json or options.out is not None)
    report = report_of_manifest(load_manifest(source), options.components, with_candidates=writes_page)
    if options.as_text:
        from rarms_iac.views.reports.terminal import report_text

        session.terminal.show(report_text(report, ascii_only=session.terminal.ascii_only))
    if session.as_json:
        session.terminal.data(json_of(report))
    if not writes_page:
        return ExitCode.DONE
    from rarms_iac.views.reports.html import as_html

    page, file = as_html(report, session.terminal.manifest_options), options.out or DEFAULT_FILE
    if file == "-":
        session.terminal.data(page.decode("utf-8"))
        return ExitCode.DONE
    write_file(file, page)
    session.terminal.tell(f"Wrote {file}. Open it in a browser.")
    return ExitCode.DONE


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportOptions:
    """What of which components goes where."""

    file: str = argument("FILE")
    components: tuple[str, ...] = argument("[COMPONENT]...", default=())
    samples: bool = flag("--samples", help="Every sample too: a row each.")


@rarms_command("export", json=False)
def export_command(session: Session, options: ExportOptions, source: ManifestSource) -> ExitCode:
    """Write what was measured of the COMPONENTs (default: all) to FILE: name.csv or name.xlsx.

    CSV has a row a setting and performance index, or with --samples a row a sample. XLSX has a summary and, for each
    data log, a sheet with settings, curve and a chart; after `rarms tune` also what that asked for. Numbers are
    numbers; their units stand in the headers.
    """
    from rarms_iac.views.reports.spreadsheet import csv_text
    from rarms_iac.views.reports.tables import samples_table, settings_table

    samples = options.samples
    ending = Path(options.file).suffix.lower()
    if ending not in {".csv", ".xlsx"}:
        raise RequestError(f"{quoted(options.file)} ends with neither .csv nor .xlsx.")
    report = report_of_manifest(load_manifest(source), options.components)
    if ending == ".csv":
        measured = samples_table(report) if samples else settings_table(report)
        data = csv_text(measured.for_files()).encode("utf-8", "replace")
    else:
        from rarms_iac.views.reports.spreadsheet import TooManyRows, workbook

        try:
            data = workbook(report, samples=samples)
        except TooManyRows as problem:
            raise UseCaseError(Outcome.NEGATIVE, [problem.finding()]) from None
    write_file(options.file, data)
    session.terminal.tell(f"Wrote {options.file}.")
    return ExitCode.DONE
