"""`rarms run`: components run on this machine without any reservation, one after the other or together."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.run_component import ComponentRunResult
from rarms_iac.cli.experiments import refuse_unknown
from rarms_iac.cli.session import Session
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.system import Component, Elapsed, Run, SampleCount, System
from rarms_iac.running.component import ComponentRun, run_in_parallel
from rarms_iac.running.loads import InterferingLoad, LoadEnded
from rarms_iac.running.samples import RunEnding
from rarms_iac.running.start import CannotStart, RunningError, StartContext
from rarms_iac.views.component_run import sample_text, summary_text
from rarms_iac.views.console import counted, visible

CANNOT_START = Finding(code="RARMS285", severity=Severity.ERROR, summary="A component cannot be run")
TOO_MANY_FAILURES = Finding(code="RARMS286", severity=Severity.ERROR, summary="More failed samples than allowed")
LOAD_NOT_RUNNING = Finding(code="RARMS287", severity=Severity.ERROR, summary="An interfering load does not run")
MISSED_UNRESERVED = Finding(
    code="RARMS288", severity=Severity.WARNING, summary="An APT is missed without any reservation"
)
NOTHING_TO_RUN = Finding(code="RARMS289", severity=Severity.ERROR, summary="Nothing says how a component is run")

FAILURES_SHOWN = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class RunWish:
    """Which components to run, for how long, against what."""

    components: tuple[str, ...] = ()  # none: every one that says how
    for_ms: int | None = None  # None: as its `until` says
    samples: int | None = None
    interference: str | None = None
    together: bool = False
    live: bool = True  # show each sample as it happens


def run_components(
    session: Session, system: System, manifest: Manifest, wish: RunWish
) -> tuple[list[ComponentRunResult], list[Diagnostic]]:
    """Run them, and tell what each showed and what is wrong with it.

    Raises:
        UseCaseError: one cannot be started (exit 1), or does not say how (exit 4).
        click.UsageError: nothing has a name that was given.
    """
    chosen = _chosen(system, manifest, wish)
    base = Path(manifest.folder).resolve()
    ran: list[ComponentRunResult] = []
    try:
        with _load(system, wish, base) as load:
            for group in [chosen] if wish.together else [[one] for one in chosen]:
                ran += _run_group(session, group, StartContext(base=base), load, live=wish.live)
    except (LoadEnded, CannotStart) as problem:
        name = problem.load if isinstance(problem, LoadEnded) else problem.component
        of_load = isinstance(problem, LoadEnded) or name not in system.components
        told = _load_problem(name, problem.message) if of_load else _cannot_start(manifest, name, problem.message)
        raise UseCaseError(Outcome.FAILED, [told], manifest.sources) from problem
    except RunningError as problem:
        told = CANNOT_START.at(None, f"{problem}.", "Somebody ended it from outside: run it again.")
        raise UseCaseError(Outcome.FAILED, [told], manifest.sources) from problem
    return ran, [finding for one in ran for finding in findings_of(one, manifest)]


def findings_of(ran: ComponentRunResult, manifest: Manifest) -> Iterator[Diagnostic]:
    """What is wrong with a run."""
    name, places = ran.component.name, manifest.places
    address = f"component/{name}"
    if ran.ending is RunEnding.FAILURES:
        reasons = list(dict.fromkeys(sample.failure for sample in ran.series.samples if sample.failure))
        yield TOO_MANY_FAILURES.at(
            places.key("components", name, "run"),
            f'"{name}" had {counted(ran.failed, "failed sample")} and may have {ran.run.failures}: '
            f"{'; '.join(reasons[:FAILURES_SHOWN])}. Such a setting gets no verdict.",
            "Look at what it says on standard error (shown above), and whether `run.samples` fits its output; each "
            "line must be written at once (flushed). `run.failures` allows some.",
            address=address,
        )
        return
    for index in ran.missed:
        yield MISSED_UNRESERVED.at(
            places.key("components", name, "apt", index),
            f'"{name}" misses its {index} on this machine although nothing takes processor time from it but what '
            "runs here anyway: no reservation would help it.",
            "Relax the APT, make the component faster, or run it on the machine that it is meant for.",
            address=address,
        )


def _chosen(system: System, manifest: Manifest, wish: RunWish) -> list[tuple[Component, Run]]:
    refuse_unknown(wish.components, system.components, "component")
    names = tuple(dict.fromkeys(wish.components)) or tuple(
        component.name for component in system.components.values() if component.run
    )
    found = [(system.components[name], system.components[name].run) for name in names]
    lacking = [component.name for component, run in found if run is None] or ([] if found else list(system.components))
    if lacking or not found:
        raise UseCaseError(Outcome.NEGATIVE, [_nothing_to_run(manifest, name) for name in lacking], manifest.sources)
    return [(component, _until(run, wish)) for component, run in found if run is not None]


def _until(run: Run, wish: RunWish) -> Run:
    if wish.for_ms is not None:
        return replace(run, until=Elapsed(time=Milliseconds(Fraction(wish.for_ms))))
    return run if wish.samples is None else replace(run, until=SampleCount(samples=wish.samples))


@contextmanager
def _load(system: System, wish: RunWish, base: Path) -> Iterator[InterferingLoad | None]:
    if wish.interference is None:
        with nullcontext():
            yield None
        return
    refuse_unknown((wish.interference,), system.interference, "interference")
    load = system.interference[wish.interference]
    with InterferingLoad(wish.interference, load, StartContext(base=base)) as running:
        yield running


def _run_group(
    session: Session,
    group: Sequence[tuple[Component, Run]],
    around: StartContext,
    load: InterferingLoad | None,
    *,
    live: bool,
) -> list[ComponentRunResult]:
    runs = [ComponentRun(component.name, run, around) for component, run in group]
    numbers = {run.component: 0 for run in runs}
    with run_in_parallel(runs) as samples:
        for name, sample in samples:
            numbers[name] += 1
            if load is not None:
                load.check()
            if live:
                session.terminal.data(sample_text(name, numbers[name], sample))
                session.terminal.flush()
    ran = [
        ComponentRunResult(component=component, run=run, series=one.series(), ending=one.ending)
        for (component, run), one in zip(group, runs, strict=True)
    ]
    for one, process in zip(ran, runs, strict=True):
        if live:
            session.terminal.show(summary_text(one))
        if one.failed and process.tail.strip():
            session.terminal.talk(f"{one.component.name} wrote last on standard error:\n{_tail(process)}")
    return ran


def _tail(process: ComponentRun) -> str:
    return "\n".join(f"  {visible(line, keep='')}" for line in process.tail.strip().splitlines()[-10:])


def _cannot_start(manifest: Manifest, name: str, says: str) -> Diagnostic:
    return CANNOT_START.at(
        manifest.places.key("components", name, "run"),
        f'"{name}" cannot be started: {says}.',
        "Words of `run.command` that name files, and `run.folder`, are relative to the manifest; a program is looked "
        "for on the PATH. A module of `run.call` is found from the manifest's folder.",
        address=f"component/{name}",
    )


def _load_problem(name: str, says: str) -> Diagnostic:
    return LOAD_NOT_RUNNING.at(
        None,
        f'The interference "{name}" does not run: {says}.',
        "Try its program by hand. Browsers need chromium or a relative of it on the PATH.",
        address=f"interference/{name}",
    )


def _nothing_to_run(manifest: Manifest, name: str) -> Diagnostic:
    return NOTHING_TO_RUN.at(
        manifest.places.key("components", name),
        f'"{name}" has no `run`.',
        "Add `run` with a `command` or a `call`.",
        address=f"component/{name}",
    )
