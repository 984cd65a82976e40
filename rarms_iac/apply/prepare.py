"""From a System and what its hosts look like to a Plan: the pure middle of `rarms plan` (the picture in docs/).

Observed states come from live hosts or from snapshots; nothing here knows which.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date

from rarms_iac import __version__
from rarms_iac.apply.review.findings_on import findings_on
from rarms_iac.apply.review.reviewed import Reviewed
from rarms_iac.apply.scripts import by_hand, guest_tasks, of_the_host_itself, with_scripts
from rarms_iac.apply.taking_over import adoption, releasing
from rarms_iac.apply.targets import targeted, without_change
from rarms_iac.apply.totals import totals_of
from rarms_iac.apply.wanted import FIXED, HostWish, Wanted, nothing_wanted, wanted
from rarms_iac.diff.comparing.compare import Difference, compare
from rarms_iac.diff.part_digests import part_digests
from rarms_iac.diff.stepping.holding import hold_back
from rarms_iac.diff.stepping.order import Cycle, order
from rarms_iac.diff.stepping.steps import Planned, steps_for
from rarms_iac.model.changes import Address, Adopt, Release
from rarms_iac.model.diagnostics import Diagnostic, Places, has_errors, in_order
from rarms_iac.model.layout import Layout
from rarms_iac.model.plan import HostPlan, Plan, Purpose
from rarms_iac.model.state import State
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner.reservations import ReservationSource
from rarms_iac.powershell.guests import GuestTask
from rarms_iac.storage.plan_file import identified

Judge = Callable[[Sequence[Diagnostic]], tuple[tuple[Diagnostic, ...], tuple[Diagnostic, ...]]]
"""Which findings stay, and which the manifest's policy accepts."""


def accept_nothing(found: Sequence[Diagnostic]) -> tuple[tuple[Diagnostic, ...], tuple[Diagnostic, ...]]:
    """The judge of a manifest without acceptances."""
    return tuple(found), ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What a plan is asked for."""

    system: System
    places: Places
    manifest: str  # path as given
    manifest_digest: str
    today: date
    purpose: Purpose = Purpose.APPLY
    max_disruption: Disruption | None = None  # None: as the manifest's policy says
    hosts: tuple[str, ...] = ()  # names; empty: all
    targets: tuple[str, ...] = ()  # addresses; empty: everything
    partition: str = ""  # of an import or release
    machine: str = ""  # id of the machine to import
    remove_disks: bool = False  # of a destroy: also the disks that rarms made
    state_paths: Mapping[str, str] = field(default_factory=dict)  # host -> where a simulated one's file lies
    judge: Judge = accept_nothing
    reservations: ReservationSource = FIXED

    @property
    def limit(self) -> Disruption:
        """What may be disturbed at most. Who destroys means removal."""
        if self.purpose is Purpose.DESTROY:
            return Disruption.REMOVAL
        return self.max_disruption or self.system.policy.max_disruption


@dataclass(frozen=True, slots=True, kw_only=True)
class Prepared:
    """A plan, or None where errors forbid one; the findings either way, in order, and those that were accepted."""

    plan: Plan | None
    findings: tuple[Diagnostic, ...]
    accepted: tuple[Diagnostic, ...] = ()
    certificate: str = ""  # that no layout exists, where there is one


def prepare(request: Request, observed: Mapping[str, State]) -> Prepared:
    """The plan that makes the observed hosts what the manifest wants, or why there is none.

    Same input, same plan, to the byte.
    """
    wishes = _wanted(request, observed)
    found = list(wishes.findings)
    parts: list[_Part] = []
    for name, wish in wishes.hosts.items():
        if name in (request.hosts or observed):
            parts.append(_host_plan(request, wish, wishes.layout))
            found += parts[-1].findings
    found += without_change([address for part in parts for address in part.addresses], request.targets)
    kept, accepted = request.judge(in_order(found))
    if has_errors(kept):
        return Prepared(plan=None, findings=kept, accepted=accepted, certificate=wishes.certificate)
    bare = _plan(request, tuple(part.plan for part in parts), wishes.layout, kept, accepted)
    plan, wrong = with_scripts(bare, {part.plan.host.name: part.guests for part in parts})
    return Prepared(plan=None if wrong else plan, findings=in_order((*kept, *wrong)), accepted=accepted)


def _wanted(request: Request, observed: Mapping[str, State]) -> Wanted:
    match request.purpose:
        case Purpose.APPLY:
            return wanted(request.system, observed, request.places, request.limit, request.reservations)
        case Purpose.DESTROY:
            return nothing_wanted(request.system, observed, request.places, remove_disks=request.remove_disks)
        case Purpose.IMPORT | Purpose.RELEASE:
            return nothing_wanted(request.system, observed, request.places)


def _plan(
    request: Request,
    hosts: tuple[HostPlan, ...],
    layout: Layout | None,
    kept: tuple[Diagnostic, ...],
    accepted: tuple[Diagnostic, ...],
) -> Plan:
    return identified(
        Plan(
            id="",
            rarms_version=__version__,
            application=request.system.application.name,
            purpose=request.purpose,
            manifest=request.manifest,
            manifest_digest=request.manifest_digest,
            today=request.today.isoformat(),
            max_disruption=request.limit,
            hosts=hosts,
            findings=kept,
            accepted=accepted,
            placement=None if layout is None else layout.placement,
        )
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Part:
    """One host's part of the plan, where changes were possible, and what was found on the way."""

    plan: HostPlan
    addresses: tuple[str, ...]
    findings: tuple[Diagnostic, ...]
    guests: tuple[GuestTask, ...]  # classes of guests that nobody could look into: only their scripts know


def _host_plan(request: Request, wish: HostWish, layout: Layout | None) -> _Part:
    application = request.system.application.name
    difference = _difference(request, wish)
    held = hold_back(targeted(difference.changes, request.targets), wish.room)
    planned = tuple(Planned(change=change, steps=steps_for(change, wish.around)) for change in held.kept)
    ordered = order(planned, wish.room)
    steps, cycle = ((), (ordered.finding,)) if isinstance(ordered, Cycle) else (ordered.steps, ())
    plan = HostPlan(
        host=request.system.hosts[wish.name],
        facts=wish.observed.facts,
        state_path=request.state_paths.get(wish.name, ""),
        serial=wish.observed.serials.get(application, 0),
        digests=part_digests(of_the_host_itself(wish.observed), application),
        changes=held.kept,
        steps=steps,
        held_back=held.held,
        unused=difference.unused,
        unchanged=difference.unchanged,
        scripts={},
        totals=totals_of(wish.observed, wish.desired, application, held.kept, steps),
        threads=wish.threads,
    )
    where, replaceable = wish.wishes.where, wish.wishes.replaceable
    guests = guest_tasks(wish.by_hand, application, replaceable, request.targets, where)
    reviewed = Reviewed(
        system=request.system,
        places=request.places,
        purpose=request.purpose,
        remove_disks=request.remove_disks,
        layout=layout,
        observed=wish.observed,
        plan=plan,
    )
    return _Part(
        plan=plan,
        addresses=tuple(str(change.address) for change in (*difference.changes, *(guest.step for guest in guests))),
        findings=(*difference.findings, *cycle, *findings_on(reviewed), *by_hand(plan, guests, where)),
        guests=guests,
    )


def _difference(request: Request, wish: HostWish) -> Difference:
    """What has to change on the host, for this purpose."""
    application = request.system.application.name
    match request.purpose:
        case Purpose.APPLY | Purpose.DESTROY:
            return compare(wish.desired, wish.observed, application, wish.around, wish.wishes)
        case Purpose.IMPORT:
            place = wish.wishes.where(Address(partition=request.partition))
            return _only(adoption(wish.observed, application, request.partition, request.machine, place))
        case Purpose.RELEASE:
            place = wish.wishes.where(Address(partition=request.partition))
            return _only(releasing(wish.observed, application, request.partition, place))


def _only(found: Adopt | Release | Diagnostic) -> Difference:
    if isinstance(found, Diagnostic):
        return Difference(changes=(), unchanged=0, unused=(), findings=(found,))
    return Difference(changes=(found,), unchanged=0, unused=(), findings=())
