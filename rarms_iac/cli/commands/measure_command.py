"""`rarms measure`: the reservations that components need, by running them."""

from dataclasses import replace

import click

from rarms_iac.app.experiments import MeasureRequest, reserves_between
from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.measure import MeasureOutcome, measure_components
from rarms_iac.app.narrowing import measure_narrowed, narrow
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.app.resting import StopConsent, always_consents, never_consents
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.messages import TerminalReporter, stopped, tell
from rarms_iac.cli.options import host_options, json_option, lock_timeout_option, manifest_options
from rarms_iac.cli.prompts import TerminalLevelPrompt, TerminalStopConsent, combine_if_wanted, refuse_without_terminal
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.model.quantities import NotAQuantity, Unit, parse_quantity
from rarms_iac.model.wording import quoted
from rarms_iac.views.measure import measure_json, summary_text

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
@click.option(
    "--stop-partitions",
    is_flag=True,
    help="Stop the application's own partitions meanwhile, and start them again. [default: ask at a terminal]",
)
@click.option(
    "--write-processors",
    is_flag=True,
    help="Write fewer `processors` for components that cannot use theirs, and measure these again.",
)
@lock_timeout_option
@json_option
def command(
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
    hosts = select_hosts(load_manifest(source), host_selection)

    def measured(asked: MeasureRequest) -> MeasureOutcome:
        return measure_components(
            select_hosts(load_manifest(source), host_selection),
            asked,
            reporter=TerminalReporter(session),
            stop=session.interrupts,
            prompt=TerminalLevelPrompt(session) if interactive else None,
            consents=_consents(session, stop_partitions=stop_partitions, as_json=as_json),
        )

    outcome = measured(request)
    if write_processors and not outcome.stopped and (narrowed := narrow(hosts, outcome)):
        for narrowing in narrowed:
            session.terminal.talk(
                f"Written to {narrowing.file}: `processors: {narrowing.after}` for {narrowing.component}, which uses "
                f"no more of its {narrowing.before}. It is measured again."
            )
        outcome = measure_narrowed(narrowed, request, outcome, measured)
    tell(session.terminal, outcome.findings, hosts.manifest.sources)
    if as_json:
        session.terminal.data(measure_json(outcome.results, outcome.findings, outcome.not_begun))
    else:
        session.terminal.show(summary_text(outcome.results, outcome.not_begun))
    if outcome.stopped:
        return stopped(session)
    if outcome.ended:
        session.terminal.talk("Ended. What is measured and written stays: the same command goes on.")
        return session.interrupts.exit_code or ExitCode.DONE
    if interactive and not has_errors(outcome.findings):
        return combine_if_wanted(session, select_hosts(load_manifest(source), host_selection))
    return ExitCode.NO if has_errors(outcome.findings) else ExitCode.DONE


def _consents(session: Session, *, stop_partitions: bool, as_json: bool) -> StopConsent:
    if stop_partitions:
        return always_consents
    return TerminalStopConsent(session) if session.terminal.answers and not as_json else never_consents


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
