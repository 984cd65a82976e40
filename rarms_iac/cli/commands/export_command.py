"""`rarms export`: what was measured as a table or a spreadsheet."""

from pathlib import Path

import click

from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.files import write_file
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.report import report_of_manifest
from rarms_iac.app.requests import ManifestSource
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import manifest_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.wording import quoted


@rarms_command("export")
@click.argument("file", metavar="FILE")
@click.argument("components", metavar="[COMPONENT]...", nargs=-1)
@manifest_options
@click.option("--samples", is_flag=True, help="Every sample too: a row each.")
@click.option("--trail", is_flag=True, help="Only what the last `rarms tune` asked for, in order, as CSV.")
def command(
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
