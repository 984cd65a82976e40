"""`rarms tune`: combine components, so that less is reserved."""

from typing import Literal, cast

import click

from rarms_iac.app.files import STANDARD_INPUT, write_file
from rarms_iac.app.hosts import Hosts, observe_hosts, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.report_model import PlatformTuning
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.app.tune import TuningResult
from rarms_iac.cli.asking import refuse_without_terminal
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.commands.measure_command import record_what_follows
from rarms_iac.cli.experiments import MeasureOptions
from rarms_iac.cli.measuring import held_benches
from rarms_iac.cli.options import host_options, json_option, manifest_options, time_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.cli.telling import tell
from rarms_iac.cli.tuned_manifest import write_partitions
from rarms_iac.cli.tuning import Experiments, bench_of, subject_of_tuning
from rarms_iac.cli.tuning_end import End, findings_of, still_too_much, tuned_of
from rarms_iac.cli.tuning_log import record_tuning, run_of
from rarms_iac.cli.tuning_talk import AskingConsent
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.planner.combining.oracle import Always
from rarms_iac.planner.combining.paper import Asking
from rarms_iac.views.reports.spreadsheet import csv_text, trail_rows
from rarms_iac.views.tune import TuningProgress, tuned_json, tuned_text

STRATEGIES = ("default", "paper")


@rarms_command("tune")
@manifest_options
@host_options
@click.option(
    "--strategy",
    type=click.Choice(STRATEGIES),
    default="default",
    help="default: the best layout, with a proof; paper: combine the two least critical that can be, to the letter. "
    "[default: default]",
)
@click.option("--repeat", is_flag=True, help="With --strategy paper: go on with the compound until the total fits.")
@click.option(
    "--probability",
    type=click.FloatRange(min=0.5, max=0.999),
    help="Be content when no other layout is better with this probability, as predictions err: 0.95. "
    "[default: go on to the proof]",
)
@click.option("--interactive/--yes", default=False, help="Ask before each combination is measured. [default: --yes]")
@click.option("--dry-run", is_flag=True, help="Measure, but leave the manifest as it is.")
@click.option("--trail", metavar="FILE", help="Write the settings that were asked for, in order, as CSV.")
@click.option("--samples", type=click.IntRange(min=2), help="So many a setting. [default: as `run.until` says]")
@click.option("--on-busy-host", is_flag=True, help="Measure although something else runs; the data logs say so.")
@time_option("--lock-timeout", "0 s", "Wait so long for a host that another run holds: 60s. [default: do not wait]")
@json_option
def command(
    session: Session,
    *,
    source: ManifestSource,
    where: HostSelection,
    strategy: str,
    repeat: bool,
    probability: float | None,
    interactive: bool,
    dry_run: bool,
    trail: str | None,
    samples: int | None,
    on_busy_host: bool,
    lock_timeout: int,
    as_json: bool,
) -> ExitCode:
    """Find components that can share a partition and reserve less together, and write that into the manifest.

    Measures compounds on the host, setting by setting, as `rarms measure --together` does; interrupted or killed, the
    same command goes on. What is found becomes `partitions` of the manifest, comments kept, for review. Exit code 4
    where nothing fits, however components are combined.
    """
    if repeat and strategy != "paper":
        raise click.UsageError("--repeat belongs to --strategy paper: the default looks at compounds of any size.")
    if probability is not None and strategy == "paper":
        raise click.UsageError("--probability belongs to the default strategy: the paper's procedure claims nothing.")
    if source.manifest == STANDARD_INPUT and not dry_run:
        raise click.UsageError("Standard input cannot be changed: name a file.", click.get_current_context())
    if interactive:
        refuse_without_terminal(session, source)
    hosts = select_hosts(load_manifest(source), where)
    options = MeasureOptions(
        together=True, strategy=strategy, samples=samples, on_busy_host=on_busy_host, lock_timeout_ms=lock_timeout
    )
    end = _tuned(session, hosts, options, repeat=repeat, probability=probability, interactive=interactive)
    written = () if dry_run else _written(session, hosts, end)
    told = (*findings_of(end, hosts), *(still_too_much(hosts, end) if written else ()))
    tuned = tuned_of(end, cast(Literal["default", "paper"], strategy), hosts.system, ", ".join(written))
    _keep_trail(session, hosts, end, tuned, trail)
    tell(session.terminal, told, hosts.manifest.sources)
    if as_json:
        session.terminal.data(tuned_json(tuned, told))
    else:
        session.terminal.show(tuned_text(tuned))
    if end.ending == "stopped":
        session.terminal.talk("Stopped. What is recorded stays: the same command goes on.")
        return session.interrupts.asked or ExitCode.INTERRUPTED
    return ExitCode.NO if has_errors(told) else ExitCode.DONE


def _tuned(
    session: Session,
    hosts: Hosts,
    options: MeasureOptions,
    *,
    repeat: bool,
    probability: float | None,
    interactive: bool,
) -> End:
    """Ask until there is an answer, with the bench held.

    Raises:
        UseCaseError: as `subject_of_tuning` and `run_experiment` say.
    """
    bench = bench_of(hosts)
    with held_benches(session, hosts, [bench.name], options.lock_timeout_ms) as benches:
        subject = subject_of_tuning(hosts, bench, observe_hosts(hosts))
        progress = TuningProgress(session.terminal.talk, session.terminal.live_table())
        asking = Asking(
            oracle=Experiments(session=session, subject=subject, bench=benches[bench.name], options=options),
            reporter=progress,
            consent=AskingConsent(session) if interactive else Always(),
            may_share=subject.may_share,
        )
        end = End.of(subject, asking, options.strategy, repeat=repeat, probability=probability)
        progress.ended()
        return end


def _keep_trail(session: Session, hosts: Hosts, end: End, tuned: TuningResult, file: str | None) -> None:
    """Into the log of tuning, for reports, and into the file that was asked for."""
    platform, run = end.subject.bench.platform, run_of(tuned)
    if run is not None:
        record_tuning(hosts, platform, run)
    if file is not None:
        rows = trail_rows([] if run is None else [PlatformTuning(platform=platform, run=run)])
        write_file(file, csv_text(rows).encode("utf-8"))
        session.terminal.talk(f"Wrote {file}.")


def _written(session: Session, hosts: Hosts, end: End) -> tuple[str, ...]:
    if not end.compounds:
        return ()
    done = write_partitions(hosts.manifest, end.compounds)
    for name in done.removed:
        session.terminal.talk(f"The entry of partition {name} is gone: its components are elsewhere now.")
    for file in done.files:
        session.terminal.talk(f"Written to {file}.")
    record_what_follows(hosts)
    return done.files
