"""`rarms measure`: the reservations that components need, by running them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import click

from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.hosts import Hosts, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.measure import ExperimentResult
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.cli.asking import ask_levels, refuse_without_terminal
from rarms_iac.cli.books import path_for, unreadable
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.configuration import record_choices
from rarms_iac.cli.datalogs import measurements_of
from rarms_iac.cli.experiments import MeasureOptions, experiments_for
from rarms_iac.cli.measuring import held_benches, refuse_what_cannot_run, run_experiment
from rarms_iac.cli.options import host_options, json_option, manifest_options, time_option
from rarms_iac.cli.passes import end_passes, passes_for
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.cli.telling import tell
from rarms_iac.measuring.findings import findings_of
from rarms_iac.measuring.setup import Experiment
from rarms_iac.model.diagnostics import Diagnostic, has_errors
from rarms_iac.model.outcomes import SettingFailed, Stopped
from rarms_iac.model.quantities import NotAQuantity, Unit, parse_quantity
from rarms_iac.providers.measuring import MeasuringHost
from rarms_iac.storage.datalog.files import LogUnreadable
from rarms_iac.storage.datalog.log import Remeasurement
from rarms_iac.views.measure import measure_json, summary_text

STRATEGIES = ("default", "bisection", "paper")
USUAL_STEP = 10


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
@click.option("--interactive", is_flag=True, help="After each component, ask for the level that is good enough.")
@click.option("--on-busy-host", is_flag=True, help="Measure although something else runs; the data log says so.")
@time_option("--lock-timeout", "0 s", "Wait so long for a host that another run holds: 60s. [default: do not wait]")
@json_option
def command(
    session: Session,
    *,
    components: tuple[str, ...],
    source: ManifestSource,
    where: HostSelection,
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
    lock_timeout: int,
    as_json: bool,
) -> ExitCode:
    """Find the least reservation at which each COMPONENT meets its thresholds; without COMPONENT: of all of them.

    It runs in a test partition beside an interfering load, setting by setting; each is recorded below measurements/
    when it is complete. Interrupted or killed, the same command goes on, and runs no recorded setting again.
    """
    options = MeasureOptions(
        components=components,
        together=together,
        strategy=strategy,
        reserves=reserves_of(first, last, step),
        interference=interference,
        samples=samples,
        verify=verify,
        seed=seed,
        again=again,
        on_busy_host=on_busy_host,
        lock_timeout_ms=lock_timeout,
    )
    _refuse_contradictions(options)
    if interactive:
        refuse_without_terminal(session, source)
    manifest = load_manifest(source)
    hosts = select_hosts(manifest, where)
    done = measured(session, hosts, options, interactive=interactive)
    record_what_follows(hosts)
    if not done.stopped:
        end_passes(hosts, done.complete, options)  # last of all: until then the same command goes on
    tell(session.terminal, done.findings, manifest.sources)
    if as_json:
        session.terminal.data(measure_json(done.results, done.findings, done.waiting))
    else:
        session.terminal.show(summary_text(done.results, done.waiting))
    return _ended(session, done)


def _refuse_contradictions(options: MeasureOptions) -> None:
    context = click.get_current_context()
    if options.together and len(set(options.components)) < 2:
        raise click.UsageError("--together wants two COMPONENTs or more.", context)
    if sum(map(bool, (options.reserves, options.verify, options.strategy != "default"))) > 1:
        raise click.UsageError("Give one of --strategy, --verify, and --from/--to/--step.", context)
    if options.again and options.seed is not None:
        raise click.UsageError("--again takes a seed of its own: leave --seed out.", context)


def record_what_follows(hosts: Hosts) -> None:
    """Write the reservations that follow from the data logs now into the configuration logs.

    Raises:
        UseCaseError: one of them is damaged (4).
    """
    system = load_manifest(hosts.manifest.source).system  # a level may have been chosen meanwhile
    try:
        record_choices(measurements_of(system, hosts.folder, hosts.manifest.source))
    except LogUnreadable as problem:
        raise UseCaseError(Outcome.NEGATIVE, [unreadable(problem)]) from None


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """All experiments: those that were begun, and after an early end the others."""

    results: tuple[ExperimentResult, ...]
    findings: tuple[Diagnostic, ...]
    waiting: tuple[Experiment, ...] = ()
    complete: Mapping[Path, Remeasurement] = field(default_factory=dict)  # finished, by data log

    @property
    def stopped(self) -> bool:
        """Whether somebody asked for an end."""
        return any(isinstance(result.conclusion, Stopped) for result in self.results)


def _ended(session: Session, done: Done) -> ExitCode:
    if done.stopped:
        session.terminal.talk("Stopped. What is recorded stays: the same command goes on.")
        return session.interrupts.asked or ExitCode.INTERRUPTED
    return ExitCode.NO if has_errors(done.findings) else ExitCode.DONE


def measured(session: Session, hosts: Hosts, options: MeasureOptions, *, interactive: bool = False) -> Done:
    """Run all experiments, one after the other, until one is stopped; a component's failure does not end the others'.

    Raises:
        UseCaseError: see `run_experiment`.
    """
    experiments = experiments_for(hosts, options)
    results: list[ExperimentResult] = []
    found: list[Diagnostic] = []
    complete: dict[Path, Remeasurement] = {}
    names = [experiment.host.name for experiment in experiments]
    with held_benches(session, hosts, names, options.lock_timeout_ms) as benches:
        passes = _passes(hosts, experiments, benches, options)
        for experiment in experiments:
            mine = passes.get(path_for(hosts, experiment))
            asked = replace(options, seed=mine.seed) if mine else options
            with session.interrupts.gently():
                result = run_experiment(session, hosts, experiment, benches[experiment.host.name], asked)
            if mine and not isinstance(result.conclusion, Stopped | SettingFailed):
                complete[path_for(hosts, experiment)] = mine
            if interactive and not isinstance(result.conclusion, Stopped):
                result = ask_levels(session, hosts, result)
            found += findings_of(experiment, result.conclusion, result.settings, hosts.manifest.places)
            results.append(result)
            if isinstance(result.conclusion, Stopped):
                break
    return Done(results=tuple(results), findings=tuple(found), waiting=experiments[len(results) :], complete=complete)


def _passes(
    hosts: Hosts, experiments: Sequence[Experiment], benches: Mapping[str, MeasuringHost], options: MeasureOptions
) -> Mapping[Path, Remeasurement]:
    """The passes of `--again`, by data log; none where it is not asked for."""
    if not options.again:
        return {}

    def refuse(experiment: Experiment) -> None:
        refuse_what_cannot_run(hosts, experiment, benches[experiment.host.name], options)

    return passes_for(hosts, experiments, benches, options, refuse)


def reserves_of(first: int | None, last: int | None, step: int | None) -> tuple[int, ...]:
    """The settings of the performance measurement mode; none where nothing asks for it.

    Raises:
        click.UsageError: the last lies below the first.
    """
    if first is None and last is None and step is None:
        return ()
    begin, end = first or USUAL_STEP, last or 100
    if end < begin:
        raise click.UsageError(f"--to {end}% lies below --from {begin}%.", click.get_current_context())
    return tuple(dict.fromkeys((*range(begin, end + 1, step or USUAL_STEP), end)))


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
        raise click.BadParameter(f"{text!r} is no whole per cent from 1 to 100, as 10%.")
    return int(value)
