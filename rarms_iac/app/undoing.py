"""Taking the last apply of each host back."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce

from rarms_iac.app.applying import refuse_unsigned_runs, run_control
from rarms_iac.app.control import UNATTENDED, Control
from rarms_iac.app.hosts import Hosts, hold_hosts, host_errors, run_origin
from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError
from rarms_iac.applying import refusals
from rarms_iac.applying.preconditions import marked_resources
from rarms_iac.applying.run_report import RunReport
from rarms_iac.applying.run_steps import combined_report
from rarms_iac.applying.undo import (
    UndoneStep,
    can_be_undone,
    repaired_addresses,
    script_undone,
    steps_undone,
    undo,
    undo_findings,
    why_not_kept,
)
from rarms_iac.model.commands import APPLY, UNDO, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.journal import Journal, RunKind, RunStarted, ScriptRun, ScriptStarted
from rarms_iac.providers.interface import NO_WAITING, LiveHost, RobotHost, WaitLimits


@dataclass(frozen=True, slots=True, kw_only=True)
class LastApply:
    """A host, and the last run there; None where there was none."""

    host: LiveHost
    journal: Journal | ScriptRun | None

    @property
    def can_be_undone(self) -> bool:
        """Whether there is something to undo, or an undo to finish."""
        return self.journal is not None and can_be_undone(self.journal)


@dataclass(frozen=True, slots=True, kw_only=True)
class UndoPreview:
    """A preview of an undo on one host."""

    host: str
    started: RunStarted | ScriptStarted
    steps: tuple[UndoneStep, ...]  # in their order; none where a script of the host does it
    script: tuple[str, ...]  # what that script says of itself
    findings: tuple[Diagnostic, ...]  # what cannot be undone, and foreign values that are set again
    foreign: tuple[str, ...]  # addresses whose foreign values the apply replaced
    keeps: bool  # these stay as the apply left them


def last_applies(hosts: Hosts) -> tuple[LastApply, ...]:
    """Return the chosen hosts whose last apply can be undone; if none has such, the first host alone.

    An application undoes its own applies only.

    Args:
        hosts: the chosen ones are read, in name order.

    Returns:
        At least one where there are hosts.

    Raises:
        RequestError: their last applies are of different plans.
        UseCaseError: a host cannot be reached or read, or its journal is missing (failed); its last run is another
            application's, or an unfinished undo whose journal does not fit the key (refused).
    """
    with host_errors():
        opened = tuple(hosts.open(name) for name in hosts.chosen)
        for host in opened:
            if isinstance(host, RobotHost):
                host.look_once()  # it undoes nothing but the apply that was seen
        all_hosts = tuple(LastApply(host=host, journal=host.journal()) for host in opened)
        states = {last.host.name: last.host.observe() for last in all_hosts if last.journal is None}
    missing = {name: marked for name, state in states.items() if (marked := marked_resources(state))}
    if missing:
        raise UseCaseError(Outcome.FAILED, [refusals.journal_missing(name, marked) for name, marked in missing.items()])
    chosen = tuple(last for last in all_hosts if last.can_be_undone) or all_hosts[:1]
    own = hosts.system.application
    others = [
        refusals.run_of_another(last.host.name, last.journal, own)
        for last in chosen
        if last.can_be_undone and last.journal is not None and not refusals.is_run_of(last.journal, own)
    ]
    if others:
        raise UseCaseError(Outcome.REFUSED, others)
    undone = [last.host for last in chosen if last.journal and last.journal.started.run is RunKind.UNDO]
    refuse_unsigned_runs(undone, needs_key=hosts.system.policy.signed_plans)  # an undo that ended early is finished
    plans = {last.host.name: last.journal.started.plan for last in chosen if last.journal is not None}
    if len(set(plans.values())) > 1:
        raise _different_plans(plans)
    return chosen


def _different_plans(plans: Mapping[str, str]) -> RequestError:
    """Ask to undo one plan at a time; hosts with the same plan are undone together."""
    message = "The last applies on the hosts are from different plans: " + "; ".join(
        f"{name} {plan}" for name, plan in plans.items()
    )
    first, *others = (
        reduce(lambda undo, name: undo.also(host=name), [name for name, of in plans.items() if of == plan], UNDO)
        for plan in dict.fromkeys(plans.values())
    )
    advice = prose("Undo one plan: ", first, *(part for each in others for part in (" or ", each)), ".")
    return RequestError(f"{message}.", advice)


def preview(applies: Sequence[LastApply], *, keep: bool = False) -> Iterator[UndoPreview]:
    """Describe what `undo_applies` would do; nothing is changed.

    Args:
        applies: the last apply on each host.

    Yields:
        A preview for each host that has a journal, in order.
    """
    for last in applies:
        if last.journal is not None:
            foreign = repaired_addresses(last.journal)
            spared = foreign if keep else frozenset()
            yield UndoPreview(
                host=last.host.name,
                started=last.journal.started,
                steps=steps_undone(last.journal, spared) if isinstance(last.journal, Journal) else (),
                script=script_undone(last.journal) if isinstance(last.journal, ScriptRun) else (),
                findings=undo_findings(last.host, last.journal, spared),
                foreign=tuple(sorted(map(str, foreign))),
                keeps=keep,
            )


def can_keep(applies: Sequence[LastApply]) -> bool:
    """Return whether hosts have foreign values for which an undo can keep those of the manifest."""
    runs = [(last.host, last.journal) for last in applies if last.journal is not None]
    return any(repaired_addresses(run) for _, run in runs) and not any(why_not_kept(host, run) for host, run in runs)


def refuse_keeping(applies: Sequence[LastApply]) -> None:
    """Refuse `--keep` if an undo cannot leave the manifest's values in place of foreign ones.

    Raises:
        RequestError: a host's script undoes the whole apply, the undo has begun, or another partition needs the room.
    """
    for last in applies:
        if last.journal is not None and (why := why_not_kept(last.host, last.journal)):
            advice = prose("Run ", UNDO, ", then ", APPLY, " to restore the values of the manifest.")
            raise RequestError(f"--keep is not possible on {last.host.name}: {why}.", advice)


def undo_applies(
    applies: Sequence[LastApply],
    *,
    waits: WaitLimits = NO_WAITING,
    control: Control = UNATTENDED,
    keep: bool = False,
) -> RunReport:
    """Undo these applies, finished or not: the undo of each step, the last step first. No question is asked.

    Args:
        applies: as `last_applies` returns them; the hosts are held meanwhile.
        waits: how long to wait for a held host, and for the next word of a host's script.
        control: hears of each step, and is asked after each whether to stop; the undo can be finished later.
        keep: leave a partition or task class as it was applied if the apply replaced a value that rarms had not set.

    Returns:
        How it ended, by host; what cannot be undone is among the diagnostics.

    Raises:
        UseCaseError: a host is held (refused).
        RequestError: as of `refuse_keeping`.
    """
    if keep:
        refuse_keeping(applies)
    hosts = tuple(last.host for last in applies)
    with hold_hosts(hosts, waits.lock_ms), control.stop.gently():
        return combined_report([undo(host, run_origin(), run_control(control, waits), keep=keep) for host in hosts])
