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
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.views.json_output import json_of
from rarms_iac.views.progress import FailureReporter, LiveSampleReporter
from rarms_iac.views.questions import selection_text
from rarms_iac.views.verdicts import proof_text, stopped_proof


@rarms_command("select")
def select_command(session: Session, request: SelectRequest, source: ManifestSource) -> ExitCode:
    """Choose the performance that is good enough for COMPONENT, and write it into the manifest as its APT.

    Shows the reservation that follows from what was measured, and what is left on the host. Comments of the manifest
    stay; what an overlay says is changed there. Exit code 4, and nothing is written, where no measured reservation
    meets the level; a reserve that the manifest fixes is not looked up.
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
    session.terminal.tell(f"Written to {selection.file}." if selection.file else "Nothing was written.")
    return ExitCode.DONE


@rarms_command("prove")
def prove_command(
    session: Session, source: ManifestSource, host_selection: HostSelection, request: ProveRequest
) -> ExitCode:
    """Run all components together in the layout that is applied, and show every index with its threshold.

    They run under the loads of the policy, one after the other, which use all idle time of the hosts: without a
    terminal that needs --load-host. They begin again at least eight times, until each threshold was shown to be met or
    missed, for `policy.measuring.proof` at most; sooner where that time will hardly be enough. What they show is
    written into the configuration logs. Exit code 4 where a threshold is missed or not shown to be met yet; 3 where the
    manifest asks for something that is not applied.
    """
    refuse_load_unasked(session, loads=not request.without_load, load_host=request.load_host)
    return prove_and_show(session, select_hosts(load_manifest(source), host_selection), request)


def prove_and_show(session: Session, hosts: Hosts, request: ProveRequest) -> ExitCode:
    """Prove what is applied, and show it; also at the end of `rarms apply --prove`."""
    control = Control(reporter=TerminalReporter(session), stop=session.interrupts)
    outcome = prove_layout(hosts, request, control)
    if outcome.stopped:
        if outcome.proofs:
            session.answer(lambda: json_of(outcome), lambda: proof_text(outcome.proofs))
        session.terminal.tell(stopped_proof(outcome, request, hosts.selection.hosts))
        return session.interrupts.exit_code or ExitCode.INTERRUPTED
    tell(session.terminal, outcome.findings, hosts.manifest.sources)
    session.answer(lambda: json_of(outcome), lambda: proof_text(outcome.proofs))
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
    """Run components as the manifest says, on this machine or on the robot behind ssh, and show each sample.

    Where the manifest has this machine as a Linux host, and a component's partition is applied and runs, the component
    starts in it and in its task class; otherwise it has no reservation, and that is said. So one sees whether a
    component's `run` is right, before anything is measured. Failed samples are shown
    with their reason; at the end stands what the samples come to, with the APT. Exit code 4 where a component has
    more failed samples than its `run.failures` allows, 1 where it cannot be started. Without names: every component
    that says how it is run.

    With --exec, rarms becomes the component, in its partition and task class: input, output, signals and exit code are
    the component's own. So a service of the machine starts it.
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
