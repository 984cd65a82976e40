"""From a System and what its hosts look like to a Plan: the pure middle of `rarms plan` (the picture in docs/).

Observed states come from live hosts or from snapshots; nothing here knows which.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date

from rarms_iac import __version__
from rarms_iac.apply.taking_over import adoption, release
from rarms_iac.apply.targets import targeted
from rarms_iac.apply.wanted import HostWish, wishes_for
from rarms_iac.diff.compare import Difference, compare
from rarms_iac.diff.disruption import Surroundings
from rarms_iac.diff.hold_back import hold_back
from rarms_iac.diff.moved import part_digests
from rarms_iac.diff.order import Cycle, Planned, order, room_of
from rarms_iac.diff.steps import steps_for
from rarms_iac.model.changes import Change
from rarms_iac.model.diagnostics import Diagnostic, Places, has_errors, in_order
from rarms_iac.model.plan import HostPlan, Plan, Purpose
from rarms_iac.model.state import State
from rarms_iac.model.system import Disruption, System
from rarms_iac.planfile.sealing import identified

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
    state_paths: Mapping[str, str] = field(default_factory=dict)  # host -> where a simulated one's file lies
    judge: Judge = accept_nothing

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


def prepare(request: Request, observed: Mapping[str, State]) -> Prepared:
    """The plan that makes the observed hosts what the manifest wants, or why there is none.

    Same input, same plan, to the byte.
    """
    wishes, found = wishes_for(request.system, observed, request.places, request.purpose, request.limit)
    hosts: list[HostPlan] = []
    for name in sorted(request.hosts or observed):
        wish = wishes.get(name)
        if wish is not None:
            host_plan, told = _host_plan(request, wish)
            hosts.append(host_plan)
            found = (*found, *told)
    kept, accepted = request.judge(in_order(found))
    if has_errors(kept):
        return Prepared(plan=None, findings=kept, accepted=accepted)
    return Prepared(plan=_plan(request, tuple(hosts), kept, accepted), findings=kept, accepted=accepted)


def _plan(
    request: Request, hosts: tuple[HostPlan, ...], kept: tuple[Diagnostic, ...], accepted: tuple[Diagnostic, ...]
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
        )
    )


def _host_plan(request: Request, wish: HostWish) -> tuple[HostPlan, tuple[Diagnostic, ...]]:
    """One host's part, and what was found on the way. Where no order of steps exists, it has none."""
    application = request.system.application.name
    difference = _difference(request, wish)
    changes, missing = targeted(difference.changes, request.targets)
    allowed, held_back = hold_back(changes, request.limit, wish.observed, application, wish.capacity, wish.around)
    planned = tuple(Planned(change=change, steps=steps_for(change, wish.around)) for change in allowed)
    ordered = order(planned, _room(request, wish))
    cycle = (ordered.finding,) if isinstance(ordered, Cycle) else ()
    host_plan = HostPlan(
        host=request.system.hosts[wish.name],
        facts=wish.observed.facts,
        state_path=request.state_paths.get(wish.name, ""),
        serial=wish.observed.serials.get(application, 0),
        digests=part_digests(wish.observed, application),
        changes=tuple(allowed),
        steps=() if isinstance(ordered, Cycle) else ordered.steps,
        held_back=tuple(held_back),
        unused=difference.unused,
        unchanged=difference.unchanged,
        scripts={},
    )
    return host_plan, (*difference.findings, *missing, *cycle)
