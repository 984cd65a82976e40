"""`rarms measure`: the reservations that components need, by running them."""

from dataclasses import replace

import click

from rarms_iac.app.experiments.combining import combine_if_wanted
from rarms_iac.app.experiments.measure import MeasureOutcome, measure_components, measuring_scripts
from rarms_iac.app.experiments.measure_request import MeasureRequest, reserves_between
from rarms_iac.app.experiments.narrowing import NarrowingConsent, always_narrows, narrow
from rarms_iac.app.experiments.stopping import StopConsent
from rarms_iac.app.experiments.tune import TuneRequest
from rarms_iac.app.hosts import Hosts, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.app.scripts import write_scripts
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
from rarms_iac.cli.prompts import (
    TerminalCombiningPrompt,
    TerminalLevelPrompt,
    ask_yes_or_no,
    refuse_standard_input,
    refuse_without_terminal,
    stop_consent,
)
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.model.quantities import NotAQuantity, Unit, parse_quantity
from rarms_iac.model.wording import quoted
from rarms_iac.storage.reading import STANDARD_INPUT
from rarms_iac.views.measure import measure_json, summary_text
from rarms_iac.views.questions import narrow_question
from rarms_iac.views.scripts import script_text
from rarms_iac.views.tune import manifest_changes, tuned_text

STRATEGIES = ("default", "bisection", "paper")


def _percent(_context: click.Context, _parameter: click.Parameter, text: str | None) -> int | None:
    """`10%` or `10 %`, whole, 1 to 100."""
    if text is None:
        return None
    try:
        value = parse_quantity(text, Unit.SHARE)[1]
    except NotAQuantity:
        value = None
    if value is None or value.denominator != 1 or not 1 <= value <= 100:
        raise click.BadParameter(f"{quoted(text)} is no whole per cent from 1 to 100, as 10%.")
    return int(value)


EXPERIMENT_OPTIONS = (
    click.argument("components", metavar="[COMPONENT]...", nargs=-1),
    click.option("--together", is_flag=True, help="Measure the COMPONENTs in one partition. [default: each alone]"),
    click.option(
        "--strategy",
        type=click.Choice(STRATEGIES),
        default="default",
        help="How the least reservation is searched; paper: 10, 20, ... 100 %, to the letter. [default: default]",
    ),
    click.option("--from", "first", metavar="PERCENT", callback=_percent, help="Measure from here ..."),
    click.option("--to", "last", metavar="PERCENT", callback=_percent, help="... to here ..."),
    click.option("--step", metavar="PERCENT", callback=_percent, help="... so far apart, all of it."),
    click.option("--interference", metavar="NAME", help="The load beside it. [default: as the manifest says]"),
    samples_option,
    click.option("--verify", is_flag=True, help="Measure the reservation that the curve gives between two settings."),
    click.option("--seed", type=click.IntRange(min=1), help="Draw chance from here; only its own settings count."),
    click.option("--again", is_flag=True, help="Measure all of it once more, beside what is recorded."),
    busy_option,
    lock_timeout_option,
)
"""What `experiment_options` takes, in the order of the help."""


def experiment_options(function: F) -> F:
    """What is measured and how, as one `request: MeasureRequest`."""

    def collect(
        *args: object,
        components: tuple[str, ...],
        together: bool,
        strategy: str,
        first: int | None,
        last: int | None,
        step: int | None,
        interference: str | None,
        samples: int | None,
        verify: bool,
        seed: int | None,
        again: bool,
        on_busy_host: bool,
        lock_timeout: int,
        **others: object,
    ) -> object:
        request = MeasureRequest(
            components=components,
            together=together,
            strategy=strategy,
            reserves=reserves_between(first, last, step),
            interference=interference,
            samples=samples,
            verify=verify,
            seed=seed,
            again=again,
            on_busy_host=on_busy_host,
            lock_timeout_ms=lock_timeout,
        )
        return function(*args, request=request, **others)

    return with_options(function, collect, *EXPERIMENT_OPTIONS)


@rarms_command("measure")
@manifest_options
@host_options
@click.option("--interactive", is_flag=True, help="Measure a coarse curve, and ask for the level that is good enough.")
@click.option("--script", is_flag=True, help="Show the PowerShell that would run on Hyper-V hosts; nothing is run.")
@click.option("--out", metavar="FOLDER", help="With --script: write the exact bytes there.")
@stop_option
@click.option(
    "--write-processors",
    is_flag=True,
    help="Write fewer `processors` for components that cannot use theirs, and measure these again. [default: ask at a "
    "terminal]",
)
@experiment_options
@json_option
def measure_command(
    session: Session,
    *,
    source: ManifestSource,
    host_selection: HostSelection,
    request: MeasureRequest,
    interactive: bool,
    script: bool,
    out: str | None,
    stop_partitions: bool,
    write_processors: bool,
    as_json: bool,
) -> ExitCode:
    """Find the least reservation at which each COMPONENT meets its thresholds; without COMPONENT: of all of them.

    It runs in a test partition beside an interfering load, setting by setting; each is recorded below measurements/
    when it is complete. Interrupted or killed, the same command goes on, and runs no recorded setting again.

    Where partitions of the application run, they must be stopped: it asks at a terminal, or give --stop-partitions.
    They start again afterwards; after a kill, with the next `rarms measure`, `start` or `apply`. Exit code 4 where a
    component does not meet its thresholds or that cannot be told, 1 where what was stopped cannot be started.
    """
    if script:
        return _show_scripts(session, select_hosts(load_manifest(source), host_selection), request, out)
    if out is not None:
        raise click.UsageError("--out is for scripts: add --script.", click.get_current_context())
    if interactive:
        refuse_without_terminal(session, source)
        request = replace(request, coarse=not (request.reserves or request.verify or request.strategy != "default"))
    if write_processors:
        refuse_standard_input(source)
    reporter = TerminalReporter(session)
    consents = stop_consent(session, stop_partitions=stop_partitions, as_json=as_json)
    prompt = TerminalLevelPrompt(session) if interactive else None

    def current() -> Hosts:
        return select_hosts(load_manifest(source), host_selection)

    def measured_again(asked: MeasureRequest) -> MeasureOutcome:
        return measure_components(current(), asked, reporter=reporter, stop=session.interrupts, consents=consents)

    hosts = current()
    outcome = measure_components(
        hosts, request, reporter=reporter, stop=session.interrupts, prompt=prompt, consents=consents
    )
    if write_processors or (session.terminal.answers and not as_json and source.manifest != STANDARD_INPUT):
        consents_to_fewer = always_narrows if write_processors else _asking(session)
        outcome = narrow(hosts, request, outcome, measured_again, consents_to_fewer, reporter)
    tell(session.terminal, outcome.findings, hosts.manifest.sources)
    if as_json:
        session.terminal.data(measure_json(outcome.results, outcome.findings, outcome.not_begun))
    else:
        session.terminal.show(summary_text(outcome.results, outcome.not_begun, outcome.fixed))
    if interactive and not (outcome.stopped or outcome.ended or has_errors(outcome.findings)):
        further = TuneRequest(samples=request.samples, on_busy_host=request.on_busy_host)
        return _combine(session, current(), further, consents)
    return _exit_code(session, outcome)


def _exit_code(session: Session, outcome: MeasureOutcome) -> ExitCode:
    """How the command ends, after it said how to go on."""
    if outcome.stopped:
        return stopped(session)
    if outcome.ended:
        session.terminal.talk("Ended. What is measured and written stays: the same command goes on.")
        return session.interrupts.exit_code or measured(outcome.findings)
    return measured(outcome.findings)


def _show_scripts(session: Session, hosts: Hosts, request: MeasureRequest, out: str | None) -> ExitCode:
    scripts = measuring_scripts(hosts, request)
    if out is not None:
        for path in write_scripts(scripts, out):
            session.terminal.talk(f"Wrote {path}.")
        return ExitCode.DONE
    for script in scripts:
        session.terminal.data(f"# {script.name}\n")
        session.terminal.data(script_text(script.text, colour=session.terminal.colour))
    return ExitCode.DONE


def _asking(session: Session) -> NarrowingConsent:
    return lambda narrowing: ask_yes_or_no(session, narrow_question(narrowing))


def _combine(session: Session, hosts: Hosts, request: TuneRequest, consents: StopConsent) -> ExitCode:
    """After levels were chosen: what somebody wants to be done where they need more than there is."""
    prompt, reporter = TerminalCombiningPrompt(session), TerminalReporter(session)
    outcome = combine_if_wanted(
        hosts, request, prompt, reporter=reporter, stop=session.interrupts, stop_consents=consents
    )
    prompt.ended()
    if outcome.ended:
        session.terminal.talk("Ended. What is measured and written stays: `rarms tune` goes on with combining.")
        return session.interrupts.exit_code or ExitCode.DONE
    if outcome.result is None:
        return ExitCode.DONE
    for sentence in manifest_changes(outcome.result):
        session.terminal.tell(sentence)
    tell(session.terminal, outcome.result.findings, hosts.manifest.sources)
    if outcome.result.run.ending == "stopped":
        return stopped(session)
    if outcome.result.run.ending != "successful":
        session.terminal.talk(tuned_text(outcome.result))
        return measured(outcome.result.findings) or ExitCode.NO
    return measured(outcome.result.findings)
