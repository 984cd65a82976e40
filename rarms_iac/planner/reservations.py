"""Where a reservation comes from: what the manifest fixes, or the curves of a data log."""

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Protocol

from rarms_iac.model.claims import WHOLE
from rarms_iac.model.commands import MEASURE, RecommendedCommand, Wording, command, prose
from rarms_iac.model.diagnostics import Facts
from rarms_iac.model.host import Host
from rarms_iac.model.layout import Cause
from rarms_iac.model.processor_number import ProcessorSource
from rarms_iac.model.quantities import CpuAmount, LogicalProcessors, ProcessorTime, guaranteed, in_processors
from rarms_iac.model.system import Component, Measured, Threshold
from rarms_iac.model.wording import counted
from rarms_iac.planner import planning_findings
from rarms_iac.planner.groups import Group
from rarms_iac.statistics.curves import Curve, highest_missed, holds, least_reserve

Names = tuple[str, ...]
"""Components together in one partition, in the order of their names."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NotMeasured:
    """There is no answer for these components, and why."""

    components: Names
    code: str = planning_findings.UNMEASURED.code
    message: str = ""  # empty: that no data log has it
    advice: Wording = "Fix it with `cpu: { reserve: ... }`, or measure it first."
    values: Facts = field(default_factory=dict, hash=False)  # more names and numbers behind the message


class ReservationSource(Protocol):
    """Answers what components need, together in one partition, on a host."""

    def reservation(self, members: tuple[Component, ...], host: Host) -> CpuAmount | NotMeasured:
        """Return the reservation with which every APT of the members holds.

        Args:
            members: all components of the partition, in any order.
            host: where the partition would be.

        Returns:
            The reservation, or why there is none. Quick; the same question has the same answer.
        """

    def processors(self, members: tuple[Component, ...], host: Host) -> int | None:
        """Return the virtual processors with which these were measured together.

        Args:
            members: as of `reservation`.
            host: as of `reservation`.

        Returns:
            Their number; None: nothing was measured, or needs to be. The same question has the same answer.
        """

    def depends_on(self, host: Host) -> Hashable:
        """Return what of a host the answers depend on: hosts for which this is equal have the same answers.

        Args:
            host: a host of the manifest.

        Returns:
            Anything that can be compared and hashed.
        """

    def remarks(self, members: tuple[Component, ...], host: Host) -> tuple[Cause, ...]:
        """Return what a reader should know of an answer: that its log could not be verified, or is of a busy host.

        Args:
            members: as of `reservation`.
            host: as of `reservation`.

        Returns:
            Notes and warnings with their codes; empty: nothing. Asked once for each partition of the chosen layout.
        """


@dataclass(frozen=True, slots=True)
class FixedReservations:
    """Only what the manifest fixes: the sum of the members' reserves.

    A component without APT and without reserve needs none. One with an APT and without a reserve is to be measured.
    """

    def reservation(self, members: tuple[Component, ...], host: Host) -> CpuAmount | NotMeasured:
        """Add up the members' fixed reserves.

        Args:
            members: all components of the partition.
            host: shares of a host are of its logical processors.

        Returns:
            The sum in logical processors; `NotMeasured` where a member's reserve is to be measured.
        """
        unknown = to_be_measured(members)
        return NotMeasured(components=unknown) if unknown else ProcessorTime(fixed(members, host))

    def processors(self, members: tuple[Component, ...], host: Host) -> None:  # noqa: ARG002 - the protocol's
        """None: nothing was measured."""
        return

    def depends_on(self, host: Host) -> Hashable:
        """Logical processors: a share is of these, and nothing else matters."""
        return host.logical_processors

    def remarks(self, members: tuple[Component, ...], host: Host) -> tuple[Cause, ...]:  # noqa: ARG002 - the protocol's
        """None: what the manifest fixes needs no remark."""
        return ()


def to_be_measured(members: Iterable[Component]) -> Names:
    """Name the components whose reserve comes from a measurement.

    Args:
        members: in any order. A component counts that says `measured`, or that has an APT and no reserve.

    Returns:
        Their names, sorted.
    """

    def is_open(component: Component) -> bool:
        return component.cpu.reserve is Measured.MEASURED or (component.cpu.reserve is None and bool(component.apt))

    return tuple(sorted(member.name for member in members if is_open(member)))


def depends_on_a_log(group: Group) -> bool:
    """Tell whether the partition's reservation comes from a data log.

    Args:
        group: the partition with its members.

    Returns:
        True where a member's reserve is to be measured and the partition fixes none of its own.
    """
    return group.request.cpu.reserve in (None, Measured.MEASURED) and bool(to_be_measured(group.members))


def fixed(members: Iterable[Component], host: Host) -> LogicalProcessors:
    """Add up what the manifest fixes of the members' reserves.

    Args:
        members: those without a fixed reserve count as 0.
        host: shares of a host are of its logical processors.

    Returns:
        The sum in logical processors, exact.
    """
    total = Fraction(0)
    for member in members:
        if member.cpu.reserve is not None and not isinstance(member.cpu.reserve, Measured):
            total += in_processors(member.cpu.reserve, host.logical_processors)
    return LogicalProcessors(total)


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredTogether:
    """The data log of components in one partition beside one load, for the hosts that it holds for."""

    path: str  # as messages name it
    interference: str  # the load
    processors: int  # of P1: a CR is per cent of these
    measured: tuple[int, ...]  # the CRs that were measured, ascending
    curves: Callable[[str, str], Curve]  # by component and index
    remarks: tuple[Cause, ...] = ()
    again: RecommendedCommand = MEASURE  # what measures it
    weak: bool = False  # its load cannot take all that P2 reserves, or left some of it idle
    cpu_ms: Callable[[str], float | None] = lambda _component: None  # processor time of a component's job, on average
    processors_from: ProcessorSource = ProcessorSource.HOST
    used: int | None = None  # the most processors that they were seen to use at once; None: that was not seen

    def measured_below(self, reserve: int) -> int:
        """Return the next lower CR that was measured; 0: none was.

        Args:
            reserve: the CR in per cent of P1's own processors.
        """
        return max((each for each in self.measured if each < reserve), default=0)


Logs = Mapping[tuple[Hashable, Names], tuple[MeasuredTogether, ...] | NotMeasured]
"""By kind of host and names: a log for each load that their reservation must stand up to, or why one is missing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredReservations:
    """Reservations from data logs, and from the manifest for components that need no log.

    In a partition of several the logs are those of all of them together, and what the manifest fixes of some is the
    least that they get. What stands up to every load is the greatest of what each load asks for.
    """

    kinds: Mapping[str, Hashable]  # host -> what it shares with others for which the same logs hold
    logs: Logs
    missed_together: Callable[[Names, Host], Fraction] = lambda _members, _host: Fraction(0)
    """The most LPs with which components that have a partition each were shown to miss in one; 0: never measured so."""
    _known: dict[Hashable, "_Decision"] = field(default_factory=dict, compare=False, repr=False)

    def reservation(self, members: tuple[Component, ...], host: Host) -> CpuAmount | NotMeasured:
        """Return the least reservation with which every APT of the members holds, by the curves of their log.

        Args:
            members: all components of the partition.
            host: the host that the log must hold for.

        Returns:
            The reservation in logical processors, at least what the manifest fixes; or why there is none: no log, or no
                measured setting that meets every APT.
        """
        if not to_be_measured(members):
            return FixedReservations().reservation(members, host)
        log = self.log(members, host)
        if isinstance(log, NotMeasured):
            return log
        least = self.least(members, host)
        if least is None:
            return not_met(members, log, self.log_of_each_load(members, host))
        looked_up = guaranteed(least, log.processors)
        return ProcessorTime(max(looked_up, fixed(members, host)))

    def processors(self, members: tuple[Component, ...], host: Host) -> int | None:
        """Those of the logs, which all have the same number."""
        log = self.log(members, host) if to_be_measured(members) else None
        return log.processors if isinstance(log, MeasuredTogether) else None

    def depends_on(self, host: Host) -> Hashable:
        """Processors, for what is fixed, and what data logs are compared with."""
        return host.logical_processors, self.kinds.get(host.name)

    def remarks(self, members: tuple[Component, ...], host: Host) -> tuple[Cause, ...]:
        """The remarks of the log of each load."""
        log = self.log(members, host)
        if not to_be_measured(members) or isinstance(log, NotMeasured):
            return ()
        return tuple(remark for each in self.log_of_each_load(members, host) for remark in each.remarks)

    def log(self, members: tuple[Component, ...], host: Host) -> MeasuredTogether | NotMeasured:
        """Find the data log that decides what these components reserve together on this host.

        Args:
            members: all components of the partition, in any order.
            host: logs are found by what it shares with others of its kind.

        Returns:
            The log of the load that asks for most, of several the one measured next below; or why there is none.
        """
        answer = self._answer(members, host)
        return answer if isinstance(answer, NotMeasured) else self._decision(members, host, answer).log

    def _answer(self, members: tuple[Component, ...], host: Host) -> tuple[MeasuredTogether, ...] | NotMeasured:
        missing = NotMeasured(components=to_be_measured(members))
        return self.logs.get((self.kinds.get(host.name), names_of(members)), missing)

    def log_of_each_load(self, members: tuple[Component, ...], host: Host) -> tuple[MeasuredTogether, ...]:
        """Find the data logs that these components' reservation must stand up to on this host.

        Args:
            members: all components of the partition, in any order.
            host: as of `log`.

        Returns:
            One log for each load, in the order of the loads; empty: one is missing.
        """
        answer = self._answer(members, host)
        return () if isinstance(answer, NotMeasured) else answer

    def least(self, members: tuple[Component, ...], host: Host) -> int | None:
        """Find the least CR at which every APT holds; each answer is worked out once.

        Args:
            members: all components of the partition.
            host: the host that the log must hold for.

        Returns:
            The CR in whole per cent of each of the log's processors; None: no measured setting meets every APT, or
                there is no log.
        """
        answer = self._answer(members, host)
        return None if isinstance(answer, NotMeasured) else self._decision(members, host, answer).least

    def _decision(self, members: tuple[Component, ...], host: Host, logs: tuple[MeasuredTogether, ...]) -> "_Decision":
        apts = tuple((member.name, index, threshold) for member in members for index, threshold in member.apt.items())
        key = (self.kinds.get(host.name), names_of(members), apts)
        if key not in self._known:
            self._known[key] = _decide(logs, apts)
        return self._known[key]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Decision:
    """What a partition reserves, and the log that asks for it."""

    log: MeasuredTogether
    least: int | None


def _decide(logs: Sequence[MeasuredTogether], apts: Sequence[tuple[str, str, Threshold]]) -> _Decision:
    answers = [least_of(log, apts) for log in logs]
    least = answers[hardest(answers)]
    asking_for_most = [log for log, answer in zip(logs, answers, strict=True) if answer == least]
    # NOTE: a load may be measured only where another one asked for: that log does not show why less is not enough.
    decisive = max(asking_for_most, key=lambda log: 0 if least is None else log.measured_below(least))
    return _Decision(log=decisive, least=least)


def hardest(reserves: Sequence[int | None]) -> int:
    """Find the load that decides what components reserve: the greatest of the loads' answers is the least for all.

    Args:
        reserves: what each load asks for, in whole per cent; None: nothing is enough beside it.

    Returns:
        The position of the load that asks for most, the first of them; nothing that is enough is most of all.
    """
    amounts = [WHOLE + 1 if reserve is None else reserve for reserve in reserves]
    return amounts.index(max(amounts))


def least_of(log: MeasuredTogether, apts: Iterable[tuple[str, str, Threshold]]) -> int | None:
    """Find the least CR at which all these thresholds hold, by the log's curves.

    Args:
        log: the data log of the components together.
        apts: component, performance index and threshold of each APT.

    Returns:
        The CR in whole per cent of each of the log's processors; None: no measured setting meets all thresholds.
    """
    return least_reserve((log.curves(component, index), threshold) for component, index, threshold in apts)


def names_of(members: Iterable[Component]) -> Names:
    """List the members' names as data logs are found by.

    Args:
        members: in any order.

    Returns:
        The names, sorted.
    """
    return tuple(sorted(member.name for member in members))


def not_met(
    members: tuple[Component, ...], log: MeasuredTogether, log_of_each_load: Sequence[MeasuredTogether]
) -> NotMeasured:
    """Explain that no setting of the log is shown to meet every APT of the members, by those that the highest is not.

    Args:
        members: the partition's components; at least one is to be measured.
        log: the data log of all of them together.
        log_of_each_load: that log, and those beside other loads.

    Returns:
        The reason with the log's path, and advice with the command that measures on.
    """
    names = to_be_measured(members)
    highest = max(log.measured, default=0)
    apts = {
        (member.name, index): (log.curves(member.name, index), threshold)
        for member in members
        for index, threshold in member.apt.items()
    }
    missing = [name for name, apt in apts.items() if not holds(*apt, highest)]
    missed = [name for name in missing if highest_missed([apts[name]]) >= highest]
    named = missed or missing
    indexes = " and ".join(f"{index} of {component}" for component, index in named)
    component, index = named[0] if named else (names[0], "")
    several = sum(name == component for name, _ in apts) > 1
    select = command("select", component, at="LEVEL", index=several and index)
    relax = prose("Relax the APT (", select, " says which level holds), ")
    if not log.measured:
        with_these = f" with {counted(log.processors, 'virtual processor')}"
        message, advice = f"{log.path} holds no setting{with_these} yet.", prose("Measure it: ", log.again, ".")
    elif not missed:
        message = f"{log.path}: at {highest} % of its VPs it is not shown yet whether {indexes} meets its threshold."
        advice = prose(
            "Nothing was shown to miss: more samples may tell. ",
            log.again,
            " says how many are needed, and what to give `policy.measuring.setting`, the time for a setting.",
        )
    elif highest < 100:
        settings = _highest_settings(log, log_of_each_load)
        message = f"No setting of {log.path} meets {indexes}: the highest is {settings}."
        advice = prose(relax, "or measure higher settings, as far as the host can give them: ", log.again, ".")
    else:
        message = f"No setting of {log.path} meets {indexes}, not even with all of its VPs."
        advice = prose(relax, "make the component cheaper, or use a faster platform: it had all of its VPs.")
    return NotMeasured(
        components=names,
        code=planning_findings.NOT_MET.code,
        message=message,
        advice=advice,
        values={
            "log": log.path,
            "highest_percent": highest,
            "indexes": tuple(f"{component}/{index}" for component, index in named),
        },
    )


def _highest_settings(log: MeasuredTogether, log_of_each_load: Sequence[MeasuredTogether]) -> str:
    """The highest CR of a log, and those beside other loads where they differ."""
    highest = {each.interference: max(each.measured, default=0) for each in (log, *log_of_each_load)}
    own = highest.pop(log.interference)
    others = [f"{reserve} % beside {load}" for load, reserve in highest.items() if reserve != own]
    share = f"{own} % of its VPs"
    return f"{share} beside {log.interference}, and {', '.join(others)}" if others else share
