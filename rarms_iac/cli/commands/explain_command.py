"""`rarms explain`: what a finding means and how to mend it."""

import click

from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import json_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.storage.finding_pages import finding_page
from rarms_iac.views.as_json import as_json as to_json
from rarms_iac.views.explain import explain_finding, unknown_code
from rarms_iac.views.output import ExplanationOutput


@rarms_command("explain")
@click.argument("finding", metavar="FINDING")
@json_option
def command(session: Session, *, finding: str, as_json: bool) -> ExitCode:
    """Say what a finding means, show an example of it, and say how to mend it.

    FINDING is the id that stands before it, such as RARMS014; its number alone is enough.
    """
    code = code_of(finding)
    page = finding_page(code)
    text = explain_finding(code)
    if page is None or text is None:
        raise click.UsageError(unknown_code(finding), click.get_current_context())
    session.terminal.data(to_json(ExplanationOutput(subject=code, page=page)) if as_json else text)
    return ExitCode.DONE


def code_of(finding: str) -> str:
    """The code that is meant: `14`, `rarms14` and `RARMS014` are one."""
    number = finding.upper().removeprefix("RARMS")
    return f"RARMS{number:0>3}" if number.isascii() and number.isdecimal() else finding.upper()
