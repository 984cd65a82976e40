"""What `make_plan` is asked for: a manifest, a purpose, and the limits of the plan."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import date

from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.plan import Purpose
from rarms_iac.model.state import StoppedBy
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner.reservations import FixedReservations, ReservationSource


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanRequest:
    """The manifest, the purpose and the limits that a plan is made for."""

    system: System
    places: Places
    manifest: str  # path as given
    manifest_digest: str
    today: date
    overlays: tuple[str, ...] = ()  # paths as given
    purpose: Purpose = Purpose.APPLY
    max_disruption: Disruption | None = None  # None: as the manifest's policy says
    hosts: tuple[str, ...] = ()  # names; empty: all
    targets: tuple[str, ...] = ()  # addresses; empty: everything
    gone: frozenset[str] = frozenset()  # addresses that a target may name although nothing is there any more
    partitions: tuple[str, ...] = ()  # to import or release (one), to stop or start; empty: all that it applies to
    machine: str = ""  # id of the machine to import
    stopped_by: StoppedBy = StoppedBy.USER  # what a stop is marked with; a measurement starts only its own
    remove_disks: bool = False  # of a destroy: also the disks that rarms made
    state_paths: Mapping[str, str] = field(default_factory=dict)  # by host: the file of a simulated one
    # By host's name, its partitions when its last run ended, where that is known; asked only of hosts with changes,
    # since it reads a whole journal.
    after_last_run: Callable[[str], frozenset[str] | None] = lambda _: None
    findings: tuple[Diagnostic, ...] = ()  # of the manifest and of snapshots, told with those of the plan
    reservations: ReservationSource = FixedReservations()
    explain: bool = True  # as of `plan_layout`

    @property
    def application(self) -> str:
        """The name of the application that is planned."""
        return self.system.application.name

    @property
    def limit(self) -> Disruption:
        """The largest disruption that a change may cause: for destroy, stop and start the one that they consist of."""
        if self.purpose is Purpose.DESTROY:
            return Disruption.REMOVAL
        if self.purpose in {Purpose.STOP, Purpose.START}:
            return Disruption.PARTITION_STOP
        return self.max_disruption or self.system.policy.max_disruption

    @property
    def is_whole(self) -> bool:
        """Whether the whole manifest is applied, on every host and without targets."""
        narrowed = self.targets or (self.hosts and set(self.hosts) != set(self.system.hosts))
        return self.purpose is Purpose.APPLY and not narrowed
