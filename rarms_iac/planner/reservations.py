"""Where a reservation comes from: what the manifest fixes, or the curves of a data log."""

from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Protocol

from rarms_iac.model.achievement import ReservationVerdict
from rarms_iac.model.host import Host
from rarms_iac.model.layout import Cause, LookedUp
from rarms_iac.model.quantities import CpuAmount, LogicalProcessors, ProcessorTime, guaranteed, in_processors
from rarms_iac.model.system import Component, Measured, System
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.measured_together import LogOfLoad, MeasuredTogether, Names, NotMeasured
from rarms_iac.planner.verdicts import Decision, decide, why_unknown


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

    def job_ms(self, component: str, members: tuple[Component, ...], host: Host) -> float | None:
        """Return the processor time of a job of a member, on each of the processors that it uses, in ms.

        Returns:
            None: it was not measured.
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

    def job_ms(self, component: str, members: tuple[Component, ...], host: Host) -> None:  # noqa: ARG002 - the protocol's
        """None: nothing was measured."""
        return

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


Logs = Mapping[tuple[Hashable, Names], tuple[LogOfLoad, ...]]
"""By kind of host and names: what is known with each load that their reservation must be enough with, in order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredReservations:
    """Reservations from data logs, and from the manifest for components that need no log.

    In a partition of several the logs are those of all of them together, and what the manifest fixes of some is the
    least that they get. What is enough with every load is the greatest of what each load asks for.
    """

    kinds: Mapping[str, Hashable]  # host -> what it shares with others for which the same logs hold
    logs: Logs
    missed_together: Callable[[Names, Host], Fraction] = lambda _members, _host: Fraction(0)
    """The most LPs with which components that have a partition each were shown to miss in one; 0: never measured so."""
    _known: dict[Hashable, Decision] = field(default_factory=dict, compare=False, repr=False)

    def reservation(self, members: tuple[Component, ...], host: Host) -> CpuAmount | NotMeasured:
        """Return the least reservation with which every APT of the members holds, by the verdict on their logs.

        Args:
            members: all components of the partition.
            host: the host that the log must hold for.

        Returns:
            The reservation in logical processors, at least what the manifest fixes; or why the verdict gives none.
        """
        if not (names := to_be_measured(members)):
            return FixedReservations().reservation(members, host)
        decision = self._decision(members, host)
        log = decision.log
        if log is None or log.least is None:
            return why_unknown(names, decision, self._logs(members, host))
        return ProcessorTime(max(guaranteed(log.least, log.processors), fixed(members, host)))

    def processors(self, members: tuple[Component, ...], host: Host) -> int | None:
        """Those of the logs, which all have the same number."""
        log = self._decision(members, host).log if to_be_measured(members) else None
        return None if log is None else log.processors

    def depends_on(self, host: Host) -> Hashable:
        """Processors, for what is fixed, and what data logs are compared with."""
        return host.logical_processors, self.kinds.get(host.name)

    def job_ms(self, component: str, members: tuple[Component, ...], host: Host) -> float | None:
        """As the log has it that decides."""
        log = self._decision(members, host).log if to_be_measured(members) else None
        cpu_ms = None if log is None else log.cpu_ms(component)
        return None if log is None or cpu_ms is None else cpu_ms / min(log.used or log.processors, log.processors)

    def remarks(self, members: tuple[Component, ...], host: Host) -> tuple[Cause, ...]:
        """The remarks of the log of each load."""
        logs = self.log_of_each_load(members, host) if to_be_measured(members) else ()
        return tuple(remark for each in logs for remark in each.remarks)

    def verdict(self, members: tuple[Component, ...], host: Host) -> ReservationVerdict:
        """Return the verdict on the thresholds of these components together; each is worked out once.

        Args:
            members: all components of the partition.
            host: the host that the logs must hold for.
        """
        return self._decision(members, host).verdict

    def log(self, members: tuple[Component, ...], host: Host) -> MeasuredTogether | NotMeasured:
        """Find the data log that decides what these components reserve together on this host.

        Args:
            members: all components of the partition, in any order.
            host: logs are found by what it shares with others of its kind.

        Returns:
            The log of the load that asks for most, of several the one measured next below, with the least CR that is
                enough; or why there is none.
        """
        decision = self._decision(members, host)
        return decision.log or why_unknown(to_be_measured(members), decision, self._logs(members, host))

    def _logs(self, members: tuple[Component, ...], host: Host) -> tuple[LogOfLoad, ...]:
        return self.logs.get((self.kinds.get(host.name), names_of(members)), ())

    def log_of_each_load(self, members: tuple[Component, ...], host: Host) -> tuple[MeasuredTogether, ...]:
        """Find the data logs that these components' reservation must be enough with on this host.

        Args:
            members: all components of the partition, in any order.
            host: as of `log`.

        Returns:
            One log for each load, in the order of the loads; empty: one is missing.
        """
        logs = self._logs(members, host)
        known = tuple(log for log in logs if isinstance(log, MeasuredTogether))
        return known if len(known) == len(logs) else ()

    def _decision(self, members: tuple[Component, ...], host: Host) -> Decision:
        apts = tuple((member.name, index, threshold) for member in members for index, threshold in member.apt.items())
        key = (self.kinds.get(host.name), names_of(members), apts)
        if key not in self._known:
            self._known[key] = decide(members, self._logs(members, host))
        return self._known[key]


@dataclass(frozen=True, slots=True)
class RecordedReservations:
    """Reservations that `look_up` recorded, and what the manifest fixes."""

    recorded: tuple[LookedUp, ...]

    def reservation(self, members: tuple[Component, ...], host: Host) -> CpuAmount | NotMeasured:
        """Return the recorded reservation."""
        if not (names := to_be_measured(members)):
            return FixedReservations().reservation(members, host)
        found = self._of(members, host)
        return NotMeasured(components=names) if found is None else ProcessorTime(found.reservation)

    def processors(self, members: tuple[Component, ...], host: Host) -> int | None:
        """Those that were recorded."""
        found = self._of(members, host)
        return None if found is None else found.processors

    def depends_on(self, host: Host) -> Hashable:
        """Logical processors, and what was recorded for the host."""
        own = (number for number, each in enumerate(self.recorded) if host.name in each.hosts)
        return host.logical_processors, tuple(own)

    def job_ms(self, component: str, members: tuple[Component, ...], host: Host) -> float | None:
        """The recorded time."""
        found = self._of(members, host)
        return None if found is None else found.job_ms.get(component)

    def remarks(self, members: tuple[Component, ...], host: Host) -> tuple[Cause, ...]:
        """The recorded remarks."""
        found = self._of(members, host)
        return () if found is None else found.remarks

    def _of(self, members: tuple[Component, ...], host: Host) -> LookedUp | None:
        names = names_of(members)
        return next((each for each in self.recorded if each.members == names and host.name in each.hosts), None)


def look_up(system: System, reservations: ReservationSource) -> tuple[LookedUp, ...]:
    """Look up the measured reservation of each partition on each host that it may be on.

    Returns:
        By partition, one for the hosts that have the same answers; none where there is no answer.
    """
    found = []
    for group in filter(depends_on_a_log, groups_of(system)):
        alike: dict[Hashable, list[Host]] = {}
        for host in (host for host in system.hosts.values() if group.may_run_on(host.name)):
            alike.setdefault(reservations.depends_on(host), []).append(host)
        for hosts in alike.values():
            answer = reservations.reservation(group.members, hosts[0])
            if isinstance(answer, ProcessorTime):
                job_ms = {each.name: reservations.job_ms(each.name, group.members, hosts[0]) for each in group.members}
                looked_up = LookedUp(
                    members=names_of(group.members),
                    hosts=tuple(sorted(host.name for host in hosts)),
                    reservation=answer.processors,
                    processors=reservations.processors(group.members, hosts[0]),
                    remarks=reservations.remarks(group.members, hosts[0]),
                    job_ms={name: ms for name, ms in job_ms.items() if ms is not None},
                )
                found.append(looked_up)
    return tuple(found)


def names_of(members: Iterable[Component]) -> Names:
    """List the members' names as data logs are found by.

    Args:
        members: in any order.

    Returns:
        The names, sorted.
    """
    return tuple(sorted(member.name for member in members))
