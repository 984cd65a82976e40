"""`rarms measure`: the reservations that components need; `rarms tune`: components that share one."""

from dataclasses import dataclass, replace

from rarms_iac.app.control import Control
from rarms_iac.app.hosts import Hosts, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource, flag, option, read_percent, verbose_option
from rarms_iac.app.scripts import write_scripts
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.cli.command import rarms_command
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.messages import StopOptions, measured, stopped, tell
from rarms_iac.cli.prompts import (
    TerminalCombiningPrompt,
    TerminalLevelPrompt,
    TerminalTuningPrompt,
    measuring_control,
    refuse_standard_input,
    refuse_without_terminal,
    with_attach_consent,
)
from rarms_iac.cli.session import Session
from rarms_iac.measuring.level_prompt import SessionEnded, combine_if_wanted
from rarms_iac.measuring.measure import MeasureOutcome, measure_components, measuring_scripts
from rarms_iac.measuring.measure_request import MeasureRequest, reserves_between
from rarms_iac.measuring.tune import TuneRequest, tune_components
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.views.json_output import json_of
from rarms_iac.views.measure import summary_text
from rarms_iac.views.scripts import script_text
from rarms_iac.views.tune import manifest_changes, tuned_text


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasureOptions(StopOptions):
    """Options of `rarms measure` alone: settings (none: a search), and questions, files and output meanwhile."""

    first: int | None = option(
        "--from",
        metavar="PERCENT",
        read=read_percent,
        help="Measure a series of settings: the first reservation, such as 10%.",
    )
    last: int | None = option("--to", metavar="PERCENT", read=read_percent, help="The last reservation of the series.")
    step: int | None = option(
        "--step", metavar="PERCENT", read=read_percent, help="The difference between two settings of the series."
    )
    verbose: bool = verbose_option()
    interactive: bool = flag("--interactive", help="Measure a coarse curve, then ask for the threshold.")
    script: bool = flag("--script", help="Show the PowerShell for Hyper-V hosts without running it.")
    out: str | None = option("--out", metavar="FOLDER", help="With --script: write the script to this file.")


@rarms_command("measure")
def measure_command(
    session: Session,
    source: ManifestSource,
    host_selection: HostSelection,
    request: MeasureRequest,
    options: MeasureOptions,
) -> ExitCode:
    """Find the smallest reservation at which each COMPONENT meets its thresholds. Without COMPONENT: all components.

    The component runs in a test partition under an interfering load, one setting after another. Each complete setting
    is saved below measurements/. After Ctrl-C or a kill, run the same command to continue. Saved settings are
    not repeated.

    Running partitions of the application must stop. rarms asks at a terminal; without one, add --stop-partitions. The
    partitions start again afterwards. After a kill, the next `rarms measure`, `start` or `apply` starts them. Exit code
    4: a component misses a threshold, or a threshold is inconclusive. Exit code 1: a stopped partition cannot be
    started.
    """
    stops = options.stops(on_busy_host=request.on_busy_host)
    request = replace(request, reserves=reserves_between(options.first, options.last, options.step))
    if options.script:
        return _show_scripts(session, select_hosts(load_manifest(source), host_selection), request, options.out)
    if options.out is not None:
        raise RequestError("--out is for scripts: add --script.")
    if options.interactive:
        choose = prose(
            "Omit --interactive. Afterwards choose a level: ", command("select", "COMPONENT", at="LEVEL"), "."
        )
        refuse_without_terminal(session, source, choose)
        request = replace(request, coarse=not (request.reserves or request.strategy != "default"))
    control = measuring_control(session, stop_partitions=stops)
    prompt = TerminalLevelPrompt(session) if options.interactive else None
    hosts = select_hosts(load_manifest(source), host_selection)
    request = with_attach_consent(session, hosts, request)
    outcome = measure_components(hosts, request, control, prompt)
    tell(session.terminal, outcome.findings, hosts.manifest.sources)
    session.answer(lambda: json_of(outcome), lambda: summary_text(outcome, verbose=options.verbose))
    if options.interactive and not (outcome.stopped or outcome.ended or has_errors(outcome.findings)):
        further = TuneRequest(samples=request.samples, on_busy_host=request.on_busy_host)
        return _combine(session, hosts.reloaded(), further, control)
    return _exit_code(session, outcome)


def _exit_code(session: Session, outcome: MeasureOutcome) -> ExitCode:
    """Return the exit code, after telling how to continue."""
    if outcome.stopped:
        return stopped(session)
    if outcome.ended:
        session.terminal.tell("Ended. Results are saved; run the same command to continue.")
        return session.interrupts.exit_code or measured(outcome.findings)
    return measured(outcome.findings)


def _show_scripts(session: Session, hosts: Hosts, request: MeasureRequest, out: str | None) -> ExitCode:
    scripts = measuring_scripts(hosts, request)
    if out is not None:
        for path in write_scripts(scripts, out):
            session.terminal.tell(f"Wrote {path}.")
        return ExitCode.DONE
    for script in scripts:
        session.terminal.data(f"# {script.name}\n")
        coloured = session.terminal.colour
        session.terminal.data(script_text(script.text, colour=coloured), is_coloured=coloured)
    return ExitCode.DONE


def _combine(session: Session, hosts: Hosts, request: TuneRequest, control: Control) -> ExitCode:
    """Do what the user wants if the chosen levels need more than the hosts have."""
    prompt = TerminalCombiningPrompt(session)
    try:
        result = combine_if_wanted(hosts, request, prompt, control)
    except SessionEnded:
        session.terminal.tell(prose("Ended. Results are saved; ", command("tune"), " continues combining."))
        return session.interrupts.exit_code or ExitCode.DONE
    if result is None:
        return ExitCode.DONE
    for sentence in manifest_changes(result):
        session.terminal.tell(sentence)
    tell(session.terminal, result.findings, hosts.manifest.sources)
    if result.run.ending == "stopped":
        return stopped(session)
    if result.run.ending != "successful":
        session.terminal.talk(tuned_text(result))
        return measured(result.findings) or ExitCode.NO
    return measured(result.findings)


@dataclass(frozen=True, slots=True, kw_only=True)
class TuneOptions(StopOptions):
    """Options of `rarms tune` alone."""

    interactive: bool = flag("--interactive", help="Ask before each combination is measured.")


@rarms_command("tune")
def tune_command(
    session: Session, source: ManifestSource, host_selection: HostSelection, request: TuneRequest, options: TuneOptions
) -> ExitCode:
    """Find components that need less CPU together in one partition, and write the partitions into the manifest.

    rarms measures the combinations on the host, like `rarms measure --together`. After Ctrl-C or a kill, run the same
    command to continue. The new `partitions` are in the manifest for review; comments stay. Running partitions of the
    application must stop, as for `rarms measure`. Exit code 4: the components do not fit in any combination. Exit code
    1: a stopped partition cannot be started again.
    """
    if not request.dry_run:
        refuse_standard_input(source)
    stops = options.stops(on_busy_host=request.on_busy_host)
    if options.interactive:
        refuse_without_terminal(session, source, "Omit --interactive to measure each combination without asking.")
    hosts = select_hosts(load_manifest(source), host_selection)
    prompt = TerminalTuningPrompt(session, asks=options.interactive)
    try:
        result = tune_components(hosts, request, measuring_control(session, stop_partitions=stops), prompt)
    except SessionEnded:
        return stopped(session)
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
