"""What was measured and planned, to keep or as a page: `rarms graph`, `report`, `export` and `studio`."""

import tempfile
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from importlib.util import find_spec
from pathlib import Path
from threading import Thread

from rarms_iac.app.files import write_file
from rarms_iac.app.graph import candidate_graph, graph_of_manifest
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.report import report_of_manifest
from rarms_iac.app.requests import ManifestSource, argument, flag, option
from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError
from rarms_iac.cli.command import rarms_command
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.prompts import refuse_standard_input
from rarms_iac.cli.session import Session
from rarms_iac.storage.writing import replace as replace_file
from rarms_iac.texts.messages import quoted
from rarms_iac.views.graph import candidates_table, candidates_text, graph_text
from rarms_iac.views.json_output import json_of


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphOptions:
    """Options of `rarms graph` alone."""

    candidates: bool = flag("--candidates", help="Draw which components could be combined, with the results so far.")


@rarms_command("graph")
def graph_command(session: Session, source: ManifestSource, options: GraphOptions) -> ExitCode:
    """Draw the hosts, their partitions and components, as the manifest alone places them.

    --candidates draws the measured components, and each compound of them that could reserve less than its members. An
    estimated reservation of a compound is marked "predicted" until it is measured. rarms does not contact a host. The
    drawing is in Mermaid, which GitHub and GitLab show on a page or in a pull request. On a terminal, --candidates
    shows a table.
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
    """Options of `rarms report` alone."""

    components: tuple[str, ...] = argument("[COMPONENT]...", default=())
    out: str | None = option(
        "-o", "--out", metavar="FILE", help=f"The file of the page; - is standard output. [default: {DEFAULT_FILE}]"
    )
    as_text: bool = flag("--text", help="Plot in the terminal instead of writing a page.")


@rarms_command("report")
def report_command(session: Session, options: ReportOptions, source: ManifestSource) -> ExitCode:
    """Show the measurements of the COMPONENTs (default: all), and the reservation for each level of performance.

    rarms writes one HTML file that needs no network. Each curve has a line: drag it to the sufficient level, and the
    page shows the reservation, the free capacity of the host, and the lines for the manifest.
    """
    if options.as_text and (options.out is not None or session.as_json):
        raise RequestError("--text cannot be combined with --out or --json.")
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
    """Options of `rarms export` alone."""

    file: str = argument("FILE")
    components: tuple[str, ...] = argument("[COMPONENT]...", default=())
    samples: bool = flag("--samples", help="Also write a row for every sample.")


@rarms_command("export", json=False)
def export_command(session: Session, options: ExportOptions, source: ManifestSource) -> ExitCode:
    """Write the measurements of the COMPONENTs (default: all) to FILE: name.csv or name.xlsx.

    CSV has one row for each setting and performance index, or with --samples for each sample. XLSX has a summary, and
    for each data log a sheet with settings, curve and chart. After `rarms tune`, it also has the settings of tuning.
    Units are in the headers.
    """
    from rarms_iac.views.reports.spreadsheet import csv_text
    from rarms_iac.views.reports.tables import samples_table, settings_table

    samples = options.samples
    ending = Path(options.file).suffix.lower()
    if ending not in {".csv", ".xlsx"}:
        raise RequestError(f"{quoted(options.file)} must end with .csv or .xlsx.")
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


NEEDED = ("starlette", "uvicorn")


@dataclass(frozen=True, slots=True, kw_only=True)
class StudioOptions:
    """Options of `rarms studio` alone."""

    port: int | None = option(
        "--port", metavar="N", least=1, most=65535, help="The port on the loopback interface. [default: any free port]"
    )
    no_open: bool = flag(
        "--no-open", help="Print the address instead of opening a browser. The address works in one browser only."
    )
    read_only: bool = flag("--read-only", help="Do not change anything.")


@rarms_command("studio", json=False)
def studio_command(session: Session, source: ManifestSource, options: StudioOptions) -> ExitCode:
    """Serve the manifest's folder as a page to one browser on this machine, until Ctrl-C.

    It is the page of `rarms report` with actions: write a threshold into the manifest, measure, tune and prove
    components, make, apply and undo plans. Each part shows the equivalent command. The address works once; a second
    browser needs another `rarms studio`.
    """
    refuse_standard_input(source)
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise RequestError(
            f"rarms studio needs a package that is not installed: {', '.join(missing)}.",
            "Change to the clone of rarms, and run `pipx install --force '.[studio]'`. If rarms runs from its .venv, "
            "run `.venv/bin/pip install -e '.[studio]'`.",
        )
    from rarms_iac.studio.page import StudioSettings
    from rarms_iac.studio.server import serve

    settings = StudioSettings(
        source=source,
        manifest_options=session.terminal.manifest_options,
        port=options.port or 0,
        read_only=options.read_only,
    )
    with _announcing(session, no_open=options.no_open) as announce:
        serve(settings, session.interrupts, announce)
    session.terminal.tell("The studio is closed.")
    return ExitCode.DONE


@contextmanager
def _announcing(session: Session, *, no_open: bool) -> Iterator[Callable[[str], None]]:
    """Print the address, or write it to a file that only the user can read and open that in a browser."""
    if no_open:
        yield lambda address: session.terminal.data_now(f"{address}\n")
        return
    with tempfile.TemporaryDirectory(prefix="rarms-studio-") as folder:  # only its user may enter it
        page = Path(folder) / "studio.html"

        def announce(address: str) -> None:
            replace_file(page, _leading_to(address))
            page.chmod(0o600)
            session.terminal.tell(f"The studio is open until Ctrl-C. If no browser shows it, open {page}.")
            # NOTE: in a thread. Some browsers are waited for, and this one would wait for the page meanwhile.
            Thread(target=webbrowser.open, args=(page.as_uri(),), daemon=True).start()

        yield announce


def _leading_to(address: str) -> bytes:
    """Return a page that leads on: the address itself, with its token, would stand in the list of processes."""
    target = escape(address)
    return (
        f'<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url={target}">'
        f'<title>rarms studio</title><p><a href="{target}">rarms studio</a></p>\n'
    ).encode()
