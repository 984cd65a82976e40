"""`rarms plan`: what would change, and why."""

from functools import partial

import click

from rarms_iac.app.errors import UseCaseError
from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.planning import PlanRequest
from rarms_iac.app.planning import plan as make_plan
from rarms_iac.app.pull_request import review_plan
from rarms_iac.app.requests import HostSelection, ManifestSource, PlanLimits
from rarms_iac.cli.applying import write_and_advise
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.messages import write_outputs
from rarms_iac.cli.options import change_options, host_or_snapshot_options, manifest_options, output_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.views.finding_forms import OutputTarget
from rarms_iac.views.pull_request import is_for_findings, no_plan_as, plan_as


@rarms_command("plan")
@manifest_options
@host_or_snapshot_options
@change_options
@click.option("--out", metavar="FILE", help="Write the plan, sealed, for `rarms apply FILE`.")
@click.option("--base", metavar="FOLDER", help="A checkout before the change, which --output markdown compares with.")
@click.option("--verbose", "-v", is_flag=True, help="Show every attribute, reason and step, too.")
@output_option
def plan_command(
    session: Session,
    *,
    source: ManifestSource,
    host_selection: HostSelection,
    limits: PlanLimits,
    out: str | None,
    base: str | None,
    verbose: bool,
    outputs: tuple[OutputTarget, ...],
) -> ExitCode:
    """Show what would change on the hosts, and change nothing.

    Exit code 2 where there are changes, 0 where the hosts are as the manifest wants them. --output markdown is the
    comment of a pull request; sarif, junit and github have the findings, also where there is no plan.
    """
    request = PlanRequest(limits=limits)
    try:
        hosts = select_hosts(load_manifest(source), host_selection)
        plan = make_plan(hosts, request)
    except UseCaseError as error:
        findings = [output for output in outputs if is_for_findings(output.format)]
        write_outputs(session.terminal, findings, partial(no_plan_as, manifest=source.manifest, error=error))
        raise
    write_outputs(
        session.terminal,
        outputs,
        lambda form: plan_as(
            form,
            plan,
            hosts.manifest.sources,
            verbose=verbose,
            review=lambda: review_plan(hosts, plan, request, base),
        ),
    )
    if out is not None:
        write_and_advise(session, out, plan)
    return ExitCode.FOUND if plan.has_changes else ExitCode.DONE
