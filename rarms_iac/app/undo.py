"""Taking the last apply back."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rarms_iac.app.applying import combine_reports
from rarms_iac.app.control import NEVER_STOP, SILENT, Reporter, StopSignal
from rarms_iac.app.errors import RequestError
from rarms_iac.app.hosts import Hosts, hold_hosts, host_errors, run_origin
from rarms_iac.applying.run_report import RunReport
from rarms_iac.applying.run_script import UndoneStep
from rarms_iac.applying.undo import can_be_undone, not_undone_findings, steps_undone, undo
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.journal import Journal, RunStarted, ScriptRun, ScriptStarted
from rarms_iac.providers.interface import NO_WAITING, LiveHost, WaitLimits


@dataclass(frozen=True, slots=True, kw_only=True)
class LastApply:
    """A host, and the last run there; None where there was none."""

    host: LiveHost
    journal: Journal | ScriptRun | None

    @property
    def can_be_undone(self) -> bool:
        """Whether there is something to take back, or an undo to finish."""
        return self.journal is not None and can_be_undone(self.journal)


@dataclass(frozen=True, slots=True, kw_only=True)
class UndoPreview:
    """What an undo would do on one host."""

    host: str
    started: RunStarted | ScriptStarted
    steps: tuple[UndoneStep, ...]  # in their order
    remaining: tuple[Diagnostic, ...]  # what cannot be taken back


def last_applies(hosts: Hosts) -> tuple[LastApply, ...]:
    """The chosen hosts whose last apply can be taken back; where none has such, the first host alone.

    Args:
        hosts: the chosen ones are read, in name order.

    Returns:
        At least one where there are hosts.

    Raises:
        RequestError: their last applies are of different plans.
        UseCaseError: a host cannot be reached or read (failed).
    """
    with host_errors():
        opened = (hosts.open(name) for name in hosts.chosen)
        all_hosts = tuple(LastApply(host=host, journal=host.journal()) for host in opened)
    chosen = tuple(last for last in all_hosts if last.can_be_undone) or all_hosts[:1]
    if len({last.journal.started.plan for last in chosen if last.journal is not None}) > 1:
        names = ", ".join(last.host.name for last in chosen)
        raise RequestError(f"The hosts have different last applies. Choose with --host: {names}.")
    return chosen


def preview(applies: Sequence[LastApply]) -> Iterator[UndoPreview]:
    """Describe what `undo_applies` would do; nothing is changed.

    Args:
        applies: the last apply on each host.

    Yields:
        A preview for each host that has a journal, in order.
    """
    for last in applies:
        if last.journal is not None:
            yield UndoPreview(
                host=last.host.name,
                started=last.journal.started,
                steps=steps_undone(last.journal),
                remaining=not_undone_findings(last.host.name, last.journal),
            )


def undo_applies(
    applies: Sequence[LastApply],
    *,
    waits: WaitLimits = NO_WAITING,
    reporter: Reporter = SILENT,
    stop: StopSignal = NEVER_STOP,
) -> RunReport:
    """Take these applies back, finished or not: the undo of each step, the last step first. Nobody is asked.

    Args:
        applies: as `last_applies` returns them; the hosts are held meanwhile.
        waits: how long to wait for a held host, and for the next word of a host's script.
        reporter: hears of each step.
        stop: asked after each step; the undo can be finished later.

    Returns:
        How it ended, by host; what cannot be taken back is among the diagnostics.

    Raises:
        UseCaseError: a host is held (refused).
    """
    hosts = tuple(last.host for last in applies)
    with hold_hosts(hosts, waits.lock_ms), stop.gently():
        return combine_reports([undo(host, run_origin(), reporter.steps, stop.should_stop, waits) for host in hosts])
