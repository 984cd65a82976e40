"""`rarms tune`: combine components, so that less is reserved."""

from dataclasses import dataclass

from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource, flag
from rarms_iac.cli.command import rarms_command
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.messages import measured, stopped, tell
from rarms_iac.cli.options import StopOptions
from rarms_iac.cli.prompts import (
    TerminalTuningPrompt,
    measuring_control,
    refuse_standard_input,
    refuse_without_terminal,
)
from rarms_iac.cli.session import Session
from rarms_iac.measuring.level_prompt import SessionEnded
from rarms_iac.measuring.tune import TuneRequest, tune_components
from rarms_iac.views.json_output import json_of
from rarms_iac.views.tune import manifest_changes, tuned_text


@dataclass(frozen=True, slots=True, kw_only=True)
class TuneOptions(StopOptions):
    """What is asked meanwhile."""

    interactive: bool = flag("--interactive", help="Ask before each combination is measured.")


@rarms_command("tune")
def tune_command(
    session: Session, source: ManifestSource, host_selection: HostSelection, request: TuneRequest, options: TuneOptions
) -> ExitCode:
    """Find components that can share a partition and reserve less together, and write that into the manifest.

    Measures compounds on the host, setting by setting, as `rarms measure --together` does; interrupted or killed, the
    same command goes on. What is found becomes `partitions` of the manifest, comments kept, for review. Exit code 4
    where nothing fits, however components are combined. Where partitions of the application run, they must be
    stopped meanwhile, as for `rarms measure`; exit code 1 where they cannot be started again.
    """
    if not request.dry_run:
        refuse_standard_input(source)
    stops = options.stops(on_busy_host=request.on_busy_host)
    if options.interactive:
        refuse_without_terminal(session, source, "Leave --interactive out: then each combination is measured unasked.")
    hosts = select_hosts(load_manifest(source), host_selection)
    prompt = TerminalTuningPrompt(session, asks=options.interactive)
    try:
        result = tune_components(hosts, request, measuring_control(session, stop_partitions=stops), prompt)
    except SessionEnded:
        prompt.ended()
        return stopped(session)
    prompt.ended()
    for sentence in manifest_changes(result):
        session.terminal.tell(sentence)
    tell(session.terminal, result.findings, hosts.manifest.sources)
    if session.as_json:
        session.terminal.data(json_of(result))
    elif result.run.partitions or result.run.ending != "unable":  # else a finding has said all
        session.terminal.show(tuned_text(result))
    if result.run.ending == "stopped":
        return stopped(session)
    return measured(result.findings)
