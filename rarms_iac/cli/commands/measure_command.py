"""`rarms measure`: the reservations that components need, by running them."""

from dataclasses import replace

import click

from rarms_iac.app.combining import combine_if_wanted
from rarms_iac.app.experiments import MeasureRequest, reserves_between
from rarms_iac.app.hosts import Hosts, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.measure import MeasureOutcome, measure_components
from rarms_iac.app.narrowing import NarrowingConsent, always_narrows, narrow
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.app.resting import StopConsent
from rarms_iac.app.tune import TuneRequest
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.messages import TerminalReporter, stopped, tell
from rarms_iac.cli.options import host_options, json_option, lock_timeout_option, manifest_options, stop_option
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
from rarms_iac.views.tune import manifest_changes, tuned_text

STRATEGIES = ("default", "bisection", "paper")


@rarms_command("measure")
@click.argument("components", metavar="[COMPONENT]...", nargs=-1)
@manifest_options
@host_options
@click.option("--together", is_flag=True, help="Measure the COMPONENTs in one partition. [default: each alone]")
@click.option(
    "--strategy",
    type=click.Choice(STRATEGIES),
    default="default",
    help="How the least reservation is searched; paper: 10, 20, ... 100 %, to the letter. [default: default]",
)
@click.option("--from", "first", metavar="PERCENT", callback=lambda _c, _p, v: percent(v), help="Measure from here ...")
@click.option("--to", "last", metavar="PERCENT", callback=lambda _c, _p, v: percent(v), help="... to here ...")
@click.option("--step", metavar="PERCENT", callback=lambda _c, _p, v: percent(v), help="... so far apart, all of it.")
@click.option("--interference", metavar="NAME", help="The load beside it. [default: as the manifest says]")
@click.option("--samples", type=click.IntRange(min=2), help="So many a setting. [default: as `run.until` says]")
@click.option("--verify", is_flag=True, help="Measure the reservation that the curve gives between two settings.")
@click.option("--seed", type=click.IntRange(min=1), help="Draw chance from here; only its own settings count.")
@click.option(
    "--again",
    is_flag=True,
    help="Measure all of it once more, beside what is recorded.",
)
@click.option("--interactive", is_flag=True, help="Measure a coarse curve, and ask for the level that is good enough.")
@click.option("--on-busy-host", is_flag=True, help="Measure although something else runs; the data log says so.")
@stop_option
@click.option(
    "--write-processors",
    is_flag=True,
    help="Write fewer `processors` for components that cannot use theirs, and measure these again. [default: ask at a "
    "terminal]",
)
@lock_timeout_option
@json_option
def measure_command(
    session: Session,
    *,
    components: tuple[str, ...],
    source: ManifestSource,
    host_selection: HostSelection,
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
    interactive: bool,
    on_busy_host: bool,
    stop_partitions: bool,
    write_processors: bool,
    lock_timeout: int,
    as_json: bool,
) -> ExitCode:
    """Find the least reservation at which each COMPONENT meets its thresholds; without COMPONENT: of all of them.

    It runs in a test partition beside an interfering load, setting by setting; each is recorded below measurements/
    when it is complete. Interrupted or killed, the same command goes on, and runs no recorded setting again.

    Where partitions of the application run, they must rest meanwhile: it asks at a terminal, or give --stop-partitions.
    They start again afterwards; after a kill, with the next `rarms measure`, `start` or `apply`.
    """
    if stop_partitions and on_busy_host:
        raise click.UsageError("Give one of --stop-partitions and --on-busy-host.", click.get_current_context())
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
    if interactive:
        refuse_without_terminal(session, source)
        request = replace(request, coarse=not (request.reserves or verify or strategy != "default"))
    if write_processors:
        refuse_standard_input(source)
    hosts = select_hosts(load_manifest(source), host_selection)
    reporter = TerminalReporter(session)
    consents = stop_consent(session, stop_partitions=stop_partitions, as_json=as_json)
    prompt = TerminalLevelPrompt(session) if interactive else None

    def current() -> Hosts:
        return select_hosts(load_manifest(source), host_selection)

    def measured_again(asked: MeasureRequest) -> MeasureOutcome:
        return measure_components(current(), asked, reporter=reporter, stop=session.interrupts, consents=consents)

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
    if outcome.stopped:
        return stopped(session)
    if outcome.ended:
        session.terminal.talk("Ended. What is measured and written stays: the same command goes on.")
        return session.interrupts.exit_code or ExitCode.DONE
    if interactive and not has_errors(outcome.findings):
        return _combine(session, current(), TuneRequest(samples=samples, on_busy_host=on_busy_host), consents)
    return ExitCode.NO if has_errors(outcome.findings) else ExitCode.DONE


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
        return ExitCode.NO
    return ExitCode.DONE


def percent(text: str | None) -> int | None:
    """`10%` or `10 %`, whole, 1 to 100.

    Raises:
        click.BadParameter: it is something else.
    """
    if text is None:
        return None
    try:
        value = parse_quantity(text, Unit.SHARE)[1]
    except NotAQuantity:
        value = None
    if value is None or value.denominator != 1 or not 1 <= value <= 100:
        raise click.BadParameter(f"{quoted(text)} is no whole per cent from 1 to 100, as 10%.")
    return int(value)
