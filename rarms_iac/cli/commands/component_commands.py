"""Commands about components: `rarms select` sets their thresholds, `prove` and `run` run them."""

from dataclasses import dataclass

from rarms_iac.app.control import Control
from rarms_iac.app.hosts import Hosts, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource, flag
from rarms_iac.app.select import SelectRequest, select_level
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.cli.command import rarms_command
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.messages import TerminalReporter, tell
from rarms_iac.cli.prompts import refuse_load_unasked, refuse_standard_input
from rarms_iac.cli.session import Session
from rarms_iac.measuring.prove import ProveRequest, prove_layout
from rarms_iac.measuring.run_component import RunRequest, become_component, run_components_of
from rarms_iac.model.commands import PLAN, prose
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.views.json_output import json_of
from rarms_iac.views.progress import FailureReporter, LiveSampleReporter
from rarms_iac.views.questions import selection_text
from rarms_iac.views.verdicts import proof_text, stopped_proof


@rarms_command("select")
def select_command(session: Session, request: SelectRequest, source: ManifestSource) -> ExitCode:
    """Choose a sufficient performance level for COMPONENT, and write it into the manifest as its threshold.

    rarms shows the measured reservation for this level and the free capacity of the host. Comments of the manifest
    stay. If an overlay sets the threshold, rarms changes the overlay. If no measured reservation meets the level, rarms
    writes nothing and ends with exit code 4. A component with a fixed reserve does not need a measurement.
    """
    if not request.dry_run:
        refuse_standard_input(source)
    manifest = load_manifest(source)
    selection = select_level(manifest, request)
    if session.as_json:
        session.terminal.data(json_of(selection))
        return ExitCode.DONE
    session.terminal.show(selection_text(selection))
    tell(session.terminal, selection.findings, manifest.sources)
    written = prose(f"Written to {selection.file}. Next: ", PLAN) if selection.file else "Nothing was written."
    session.terminal.tell(written)
    return ExitCode.DONE


@rarms_command("prove")
def prove_command(
    session: Session, source: ManifestSource, host_selection: HostSelection, request: ProveRequest
) -> ExitCode:
    """Run all components together in the applied layout, and compare each measured value with its threshold.

    The components run with each load of the policy in turn. The loads use all idle time of the hosts. Without a
    terminal, add --load-host. rarms starts the components at least eight times, until each threshold is met or missed
    with 99 % confidence. `policy.measuring.proof` limits the time. rarms stops earlier if that time is probably not
    enough. The configuration logs keep the results. Exit code 4: a threshold is missed or inconclusive. Exit code 3:
    the manifest has changes that are not applied.
    """
    refuse_load_unasked(session, loads=not request.without_load, load_host=request.load_host)
    return prove_and_show(session, select_hosts(load_manifest(source), host_selection), request)


def prove_and_show(session: Session, hosts: Hosts, request: ProveRequest) -> ExitCode:
    """Prove what is applied, and show it; also at the end of `rarms apply --prove`."""
    control = Control(reporter=TerminalReporter(session), stop=session.interrupts)
    outcome = prove_layout(hosts, request, control)
    if outcome.stopped:
        if outcome.proofs:
            session.answer(lambda: json_of(outcome), lambda: proof_text(outcome))
        session.terminal.tell(stopped_proof(outcome, request, hosts.selection.hosts))
        return session.interrupts.exit_code or ExitCode.INTERRUPTED
    tell(session.terminal, outcome.findings, hosts.manifest.sources)
    session.answer(lambda: json_of(outcome), lambda: proof_text(outcome))
    if outcome.not_proven:
        session.terminal.tell(f"Not proven, because they run on other hosts: {', '.join(outcome.not_proven)}.")
    return ExitCode.NO if has_errors(outcome.findings) else ExitCode.DONE


@dataclass(frozen=True, slots=True, kw_only=True)
class ExecOptions:
    """Whether rarms becomes the component."""

    as_itself: bool = flag("--exec", help="Replace this process with the COMPONENT, without reading samples.")


@rarms_command("run")
def run_command(
    session: Session, request: RunRequest, source: ManifestSource, host_selection: HostSelection, become: ExecOptions
) -> ExitCode:
    """Run components as the manifest describes, on this machine or on the robot over ssh, and show each sample.

    Use it to check `run` of a component before you measure. If this machine is a Linux host of the manifest and the
    partition of a component is running, the component starts there, with its task class. Otherwise it runs without a
    reservation, and rarms reports this. Each failed sample has a reason. At the end, a table compares the results with
    the thresholds. Without COMPONENT: all components that have `run`. Exit code 4: more samples failed than
    `run.failures` allows. Exit code 1: a component cannot be started.

    With --exec, the component replaces rarms, in its partition and with its task class: input, output, signals and
    exit code are the component's own. Use this in a service.
    """
    if become.as_itself:
        if request != RunRequest(components=request.components[:1]) or not request.components or session.as_json:
            raise RequestError(
                "--exec takes one COMPONENT, and can be combined only with --manifest, --overlay and --debug."
            )
        become_component(load_manifest(source), request.components[0], FailureReporter(session.terminal))
    manifest = load_manifest(source)
    reporter = FailureReporter(session.terminal) if session.as_json else LiveSampleReporter(session.terminal)
    control = Control(reporter=TerminalReporter(session), stop=session.interrupts)
    outcome = run_components_of(select_hosts(manifest, host_selection), request, reporter, control)
    if session.as_json:
        session.terminal.data(json_of(outcome))
    tell(session.terminal, outcome.findings, manifest.sources)
    return ExitCode.NO if has_errors(outcome.findings) else ExitCode.DONE
