"""`rarms apply`: do what a plan says, finish what was begun, or plan, ask and do it."""

import click

from rarms_iac.apply.reports import Ending, RunReport
from rarms_iac.apply.undo import abandon
from rarms_iac.cli.applying import ended, plan_ask_apply, run
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.hosts import holding, hosts_of
from rarms_iac.cli.manifests import system_of
from rarms_iac.cli.options import (
    ChangeOptions,
    HostOptions,
    ManifestOptions,
    RunOptions,
    change_options,
    host_options,
    json_option,
    manifest_options,
    run_options,
)
from rarms_iac.cli.planning import Wish
from rarms_iac.cli.plans import folder_of, read_plan_file
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.cli.wiring import open_host


@rarms_command("apply")
@click.argument("plan_file", metavar="[PLAN]", required=False)
@manifest_options
@host_options
@change_options
@run_options
@click.option("--abandon", "abandoning", is_flag=True, help="Close an unfinished run and leave the host as it is.")
@json_option
def command(
    session: Session,
    *,
    plan_file: str | None,
    source: ManifestOptions,
    where: HostOptions,
    limits: ChangeOptions,
    how: RunOptions,
    abandoning: bool,
    as_json: bool,
) -> ExitCode:
    """Do exactly what PLAN says; without PLAN: plan, show, ask, and do it.

    A run that was interrupted is finished first, and nothing else is done then. PLAN is refused where it was edited
    or used, or where a host has moved since it was made. Ctrl-C stops after the running step.
    """
    if plan_file is not None and abandoning:
        raise click.UsageError(
            "--abandon closes whatever is unfinished: it takes no PLAN.", click.get_current_context()
        )
    if plan_file is not None:
        return _apply_file(session, plan_file, how, as_json=as_json)
    system, opened = system_of(source)
    hosts = hosts_of(system, opened, source, where)
    if not abandoning:
        return plan_ask_apply(session, hosts, Wish(limits=limits), how, as_json=as_json)
    live = tuple(hosts.open(name) for name in hosts.chosen)
    with holding(live, how.lock_timeout_ms):
        reports = [abandon(host) for host in live]
    return ended(session, worst(reports), as_json=as_json)


def _apply_file(session: Session, plan_file: str, how: RunOptions, *, as_json: bool) -> ExitCode:
    plan = read_plan_file(plan_file)
    folder = folder_of(plan)
    live = {part.host.name: open_host(part.host, folder, part.state_path) for part in plan.hosts}
    return ended(session, run(session, plan, live, how), as_json=as_json)


def worst(reports: list[RunReport]) -> RunReport:
    """What several hosts' reports come to: a failure counts, else something done, else nothing."""
    endings = [one.ending for one in reports]
    order = (Ending.FAILED, Ending.REFUSED, Ending.INTERRUPTED, Ending.DONE)
    return RunReport(
        ending=next((one for one in order if one in endings), Ending.NOTHING),
        hosts=tuple(host for one in reports for host in one.hosts),
        diagnostics=tuple(problem for one in reports for problem in one.diagnostics),
    )
