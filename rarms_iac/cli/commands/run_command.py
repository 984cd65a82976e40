"""`rarms run`: run components on this machine, to see whether the manifest's `run` is right."""

import click

from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import ManifestSource
from rarms_iac.app.run_component import RunRequest, run_components
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.messages import tell
from rarms_iac.cli.options import json_option, manifest_options, time_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.views.component_run import FailureReporter, LiveSampleReporter, ran_json


@rarms_command("run")
@click.argument("components", metavar="[COMPONENT]...", nargs=-1)
@manifest_options
@time_option("--for", "for_ms", default=None, text="For so long: 5s. [default: as `until` says]")
@click.option("--samples", type=click.IntRange(min=1), help="Until there are so many. [default: as `until` says]")
@click.option("--interference", metavar="NAME", help="Against this load of the manifest. [default: none]")
@click.option("--together", is_flag=True, help="All at once. [default: one after the other]")
@json_option
def command(
    session: Session,
    *,
    components: tuple[str, ...],
    source: ManifestSource,
    for_ms: int | None,
    samples: int | None,
    interference: str | None,
    together: bool,
    as_json: bool,
) -> ExitCode:
    """Run components on this machine as the manifest says, and show each sample.

    Where the manifest has this machine as a Linux host, and a component's partition is applied and runs, the component
    starts in it and in its task class; otherwise it has no reservation, and that is said. So one sees whether a
    component's `run` is right, before anything is measured. Failed samples are shown
    with their reason; at the end stands what the samples come to beside the APT. Exit code 4 where a component has
    more failed samples than its `run.failures` allows, 1 where it cannot be started. Without names: every component
    that says how it is run.
    """
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
