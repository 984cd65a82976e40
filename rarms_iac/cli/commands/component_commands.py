"""Commands about components: `rarms select` sets their thresholds, `prove` and `run` run them."""

import click

from rarms_iac.app.experiments.measure_request import USUAL_SEED
from rarms_iac.app.experiments.prove import ProveRequest, prove_layout
from rarms_iac.app.hosts import Hosts, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.app.run_component import RunRequest, become_component, run_components
from rarms_iac.app.select import SelectRequest, select_level
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.messages import TerminalReporter, tell
from rarms_iac.cli.options import host_options, json_option, lock_timeout_option, manifest_options, time_option
from rarms_iac.cli.prompts import refuse_standard_input
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.views.component_run import FailureReporter, LiveSampleReporter, ran_json
from rarms_iac.views.prove import ProofProgress, proof_text, prove_json
from rarms_iac.views.select import selection_json, selection_text


@rarms_command("select")
@click.argument("component")
@click.option("--at", required=True, metavar="LEVEL", help='What is good enough: "100 ms", "95 %", "24 /s".')
@click.option("--index", metavar="INDEX", help="Of which performance index, where the level fits several.")
@click.option("--dry-run", is_flag=True, help="Write nothing; show what would follow.")
@manifest_options
@json_option
def select_command(
    session: Session,
    *,
    component: str,
    at: str,
    index: str | None,
    dry_run: bool,
    source: ManifestSource,
    as_json: bool,
) -> ExitCode:
    """Choose the performance that is good enough for COMPONENT, and write it into the manifest as its APT.

    Shows the reservation that follows from what was measured, and what is left on the host. Comments of the manifest
    stay; what an overlay says is changed there. Exit code 4, and nothing is written, where no measured reservation
    meets the level; a reserve that the manifest fixes is not looked up.
    """
    if not dry_run:
        refuse_standard_input(source)
    manifest = load_manifest(source)
    request = SelectRequest(component=component, level=at, index=index, dry_run=dry_run)
    outcome = select_level(manifest, request)
    if as_json:
        session.terminal.data(selection_json(outcome.selection, outcome.file, written=not dry_run))
        return ExitCode.DONE
    session.terminal.show(selection_text(outcome.selection))
    tell(session.terminal, outcome.findings, manifest.sources)
    session.terminal.talk("Nothing was written." if dry_run else f"Written to {outcome.file}.")
    return ExitCode.DONE


@rarms_command("prove")
@manifest_options
@host_options
@click.option("--interference", metavar="NAME", help="Run this load beside them. [default: none]")
@click.option("--samples", type=click.IntRange(min=2), help="So many a component. [default: as `run.until` says]")
@click.option("--seed", type=click.IntRange(min=1), default=USUAL_SEED, help="Draw chance from here. [default: 1]")
@lock_timeout_option
@json_option
def prove_command(
    session: Session,
    *,
    source: ManifestSource,
    host_selection: HostSelection,
    interference: str | None,
    samples: int | None,
    seed: int,
    lock_timeout: int,
    as_json: bool,
) -> ExitCode:
    """Run all components together in the layout that is applied, and show every index beside its threshold.

    What they show is written into the configuration logs. Exit code 4 where a threshold is missed or the samples cannot
    tell; 3 where the manifest asks for something that is not applied yet.
    """
    request = ProveRequest(interference=interference, samples=samples, seed=seed, lock_timeout_ms=lock_timeout)
    return prove_and_show(session, select_hosts(load_manifest(source), host_selection), request, as_json=as_json)


def prove_and_show(session: Session, hosts: Hosts, request: ProveRequest, *, as_json: bool) -> ExitCode:
    """Prove what is applied, and show it; also at the end of `rarms apply --prove`."""
    with ProofProgress(session.terminal.live_table()) as progress:
        outcome = prove_layout(
            hosts, request, reporter=TerminalReporter(session), stop=session.interrupts, listener=progress
        )
    if outcome.stopped:
        session.terminal.tell("Stopped: nothing is proven, and nothing was changed.")
        return session.interrupts.exit_code or ExitCode.INTERRUPTED
    tell(session.terminal, outcome.findings, hosts.manifest.sources)
    if as_json:
        session.terminal.data(prove_json(outcome.proofs, request.interference, outcome.findings))
    else:
        session.terminal.show(proof_text(outcome.proofs, request.interference))
    if outcome.not_proven:
        session.terminal.tell(f"Not proven, since they are on other hosts: {', '.join(outcome.not_proven)}.")
    return ExitCode.NO if outcome.findings else ExitCode.DONE


@rarms_command("run")
@click.argument("components", metavar="[COMPONENT]...", nargs=-1)
@manifest_options
@time_option("--for", "for_ms", default=None, text="For so long: 5s. [default: as `until` says]")
@click.option("--samples", type=click.IntRange(min=1), help="Until there are so many. [default: as `until` says]")
@click.option("--interference", metavar="NAME", help="Against this load of the manifest. [default: none]")
@click.option("--together", is_flag=True, help="All at once. [default: one after the other]")
@click.option(
    "--exec", "as_itself", is_flag=True, help="Become the one COMPONENT: no samples, until it ends by itself."
)
@json_option
def run_command(
    session: Session,
    *,
    components: tuple[str, ...],
    source: ManifestSource,
    for_ms: int | None,
    samples: int | None,
    interference: str | None,
    together: bool,
    as_itself: bool,
    as_json: bool,
) -> ExitCode:
    """Run components on this machine as the manifest says, and show each sample.

    Where the manifest has this machine as a Linux host, and a component's partition is applied and runs, the component
    starts in it and in its task class; otherwise it has no reservation, and that is said. So one sees whether a
    component's `run` is right, before anything is measured. Failed samples are shown
    with their reason; at the end stands what the samples come to beside the APT. Exit code 4 where a component has
    more failed samples than its `run.failures` allows, 1 where it cannot be started. Without names: every component
    that says how it is run.

    With --exec, rarms becomes the component, in its partition and task class: input, output, signals and exit code are
    the component's own. So a service of the machine starts it.
    """
    if as_itself:
        if len(components) != 1 or for_ms or samples or interference or together or as_json:
            message = "--exec takes one COMPONENT, and of the other options only --file, --overlay and --debug."
            raise click.UsageError(message, click.get_current_context())
        become_component(load_manifest(source), components[0], FailureReporter(session.terminal))
    if for_ms is not None and for_ms < 1:
        raise click.BadParameter("it has to be at least 1 ms.", param_hint="--for")
    if for_ms is not None and samples is not None:
        raise click.UsageError("Give --for or --samples, not both.", click.get_current_context())
    manifest = load_manifest(source)
    request = RunRequest(
        components=components, for_ms=for_ms, samples=samples, interference=interference, together=together
    )
    reporter = FailureReporter(session.terminal) if as_json else LiveSampleReporter(session.terminal)
    outcome = run_components(manifest, request, reporter)
    if as_json:
        session.terminal.data(ran_json(outcome.results, outcome.findings))
    tell(session.terminal, outcome.findings, manifest.sources)
    return ExitCode.NO if has_errors(outcome.findings) else ExitCode.DONE
