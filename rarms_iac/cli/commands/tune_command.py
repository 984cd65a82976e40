"""`rarms tune`: combine components, so that less is reserved."""

from typing import get_args

import click

from rarms_iac.app.experiments.level_prompt import SessionEnded
from rarms_iac.app.experiments.tune import TuneRequest, tune_components
from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.messages import TerminalReporter, measured, stopped, tell
from rarms_iac.cli.options import (
    F,
    busy_option,
    host_options,
    json_option,
    lock_timeout_option,
    manifest_options,
    samples_option,
    stop_option,
    with_options,
)
from rarms_iac.cli.prompts import TerminalCombiningPrompt, refuse_standard_input, refuse_without_terminal, stop_consent
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.storage.datalog.decisions import TuningStrategy
from rarms_iac.views.tune import manifest_changes, tuned_json, tuned_text


def tuning_options(function: F) -> F:
    """How components are combined, as one `request: TuneRequest`."""

    def collect(
        *args: object,
        strategy: TuningStrategy,
        repeat: bool,
        dry_run: bool,
        samples: int | None,
        on_busy_host: bool,
        lock_timeout: int,
        **others: object,
    ) -> object:
        if repeat and strategy != "paper":
            message = "--repeat belongs to --strategy paper: the default looks at compounds of any size."
            raise click.UsageError(message, click.get_current_context())
        request = TuneRequest(
            strategy=strategy,
            repeat=repeat,
            dry_run=dry_run,
            samples=samples,
            on_busy_host=on_busy_host,
            lock_timeout_ms=lock_timeout,
        )
        return function(*args, request=request, **others)

    return with_options(
        function,
        collect,
        click.option(
            "--strategy",
            type=click.Choice(get_args(TuningStrategy)),
            default="default",
            help="default: the best layout, with a proof; paper: combine the two least critical that can be, to the "
            "letter. [default: default]",
        ),
        click.option(
            "--repeat", is_flag=True, help="With --strategy paper: go on with the compound until the total fits."
        ),
        click.option("--dry-run", is_flag=True, help="Measure, but leave the manifest as it is."),
        samples_option,
        busy_option,
        lock_timeout_option,
    )


@rarms_command("tune")
@manifest_options
@host_options
@click.option("--interactive", is_flag=True, help="Ask before each combination is measured.")
@stop_option
@tuning_options
@json_option
def tune_command(
    session: Session,
    *,
    source: ManifestSource,
    host_selection: HostSelection,
    request: TuneRequest,
    interactive: bool,
    stop_partitions: bool,
    as_json: bool,
) -> ExitCode:
    """Find components that can share a partition and reserve less together, and write that into the manifest.

    Measures compounds on the host, setting by setting, as `rarms measure --together` does; interrupted or killed, the
    same command goes on. What is found becomes `partitions` of the manifest, comments kept, for review. Exit code 4
    where nothing fits, however components are combined. Where partitions of the application run, they must be
    stopped meanwhile, as for `rarms measure`; exit code 1 where they cannot be started again.
    """
    if not request.dry_run:
        refuse_standard_input(source)
    if interactive:
        refuse_without_terminal(session, source)
    hosts = select_hosts(load_manifest(source), host_selection)
    progress = TerminalCombiningPrompt(session)
    try:
        result = tune_components(
            hosts,
            request,
            reporter=TerminalReporter(session),
            stop=session.interrupts,
            planner_reporter=progress,
            consent=progress if interactive else None,
            stop_consents=stop_consent(session, stop_partitions=stop_partitions, as_json=as_json),
        )
    except SessionEnded:
        progress.ended()
        return stopped(session)
    progress.ended()
    for sentence in manifest_changes(result):
        session.terminal.tell(sentence)
    tell(session.terminal, result.findings, hosts.manifest.sources)
    if as_json:
        session.terminal.data(tuned_json(result))
    elif result.run.partitions or result.run.ending != "unable":  # else a finding has said all
        session.terminal.show(tuned_text(result))
    if result.run.ending == "stopped":
        return stopped(session)
    return measured(result.findings)
