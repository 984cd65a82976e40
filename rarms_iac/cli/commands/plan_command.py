"""`rarms plan`: what would change, and why."""

from dataclasses import dataclass
from functools import partial

from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.planning import plan as make_plan
from rarms_iac.app.planning import plan_request
from rarms_iac.app.requests import DatedManifestSource, PlanLimits, SnapshotSelection, flag, option, verbose_option
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.cli.applying import write_and_advise
from rarms_iac.cli.command import rarms_command
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.messages import write_outputs
from rarms_iac.cli.options import OutputOptions
from rarms_iac.cli.session import Session
from rarms_iac.manifest.load import manifest_path
from rarms_iac.manifest.text.tree import first_line
from rarms_iac.model.diagnostics import Places
from rarms_iac.views.pull_request import is_for_findings, no_plan_as, plan_as


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanOptions(OutputOptions):
    """Where the plan goes, and how it is shown."""

    out: str | None = option("--out", metavar="FILE", help="Write the plan file, for `rarms apply FILE`.")
    verbose: bool = verbose_option()
    detailed_exitcode: bool = flag(
        "--detailed-exitcode", help="End with exit code 2 where there are changes; those that are held back count."
    )


@rarms_command("plan")
def plan_command(
    session: Session,
    source: DatedManifestSource,
    host_selection: SnapshotSelection,
    limits: PlanLimits,
    options: PlanOptions,
) -> ExitCode:
    """Show what would change on the hosts, and change nothing.

    --output markdown is the comment of a pull request; sarif, junit and github have the findings, also where there is
    no plan.
    """
    outputs = options.targets(session)
    places: Places = first_line(manifest_path(source.manifest))
    try:
        manifest = load_manifest(source)
        places = manifest.places
        hosts = select_hosts(manifest, host_selection)
        plan = make_plan(hosts, plan_request(hosts, limits))
    except UseCaseError as error:
        findings = [output for output in outputs if is_for_findings(output.format)]
        form_of = partial(no_plan_as, manifest=source.manifest, error=error, places=places)
        write_outputs(session.terminal, findings, form_of)
        raise
    write_outputs(
        session.terminal,
        outputs,
        lambda form: plan_as(form, plan, hosts.manifest, verbose=options.verbose),
    )
    if options.out is not None:
        write_and_advise(session, options.out, plan)
    return ExitCode.FOUND if options.detailed_exitcode and plan.has_changes else ExitCode.DONE
