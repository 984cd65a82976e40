"""`rarms show`: a plan file, as `rarms plan` showed it."""

import click

from rarms_iac.cli.applying import shown_plan
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import json_option
from rarms_iac.cli.plans import read_plan_file
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.views.plan_json import plan_json


@rarms_command("show")
@click.argument("plan_file", metavar="PLAN")
@click.option("--steps", is_flag=True, help="Show every step, in order.")
@json_option
def command(session: Session, *, plan_file: str, steps: bool, as_json: bool) -> ExitCode:
    """Show a plan that `rarms plan --out` wrote; needs neither manifest nor host.

    A file that was edited is refused, as `rarms apply` refuses it.
    """
    plan = read_plan_file(plan_file)
    session.terminal.data(plan_json(plan) if as_json else shown_plan(session, plan, steps=steps))
    return ExitCode.DONE
