"""What `make_plan` is asked for: a manifest, a purpose, and the limits of the plan."""

from collections.abc import Callable
from dataclasses import dataclass

from rarms_iac.manifest.checks.measurement import TOO_FEW_SAMPLES
from rarms_iac.manifest.load import Loaded
from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.layout import ChosenLayout
from rarms_iac.model.plan import PlanOrder, Purpose
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner.reservations import FixedReservations, ReservationSource


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanRequest(PlanOrder):
    """What a plan is asked for, with the manifest as it was read."""

    system: System
    places: Places
    # By host's name, its partitions when its last run ended, where that is known; asked only of hosts with changes,
    # since it reads a whole journal.
    after_last_run: Callable[[str], frozenset[str] | None] = lambda _: None
    findings: tuple[Diagnostic, ...] = ()  # of the manifest
    reservations: ReservationSource = FixedReservations()
    explain: bool = True  # as of `plan_layout`
    layout: ChosenLayout | None = None  # as of `plan_layout`

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


def findings_of_manifest(loaded: Loaded) -> tuple[Diagnostic, ...]:
    """Return a manifest's findings that a plan has, too.

    How many samples thresholds need is said by `rarms validate`.
    """
    return tuple(finding for finding in loaded.diagnostics if finding.code != TOO_FEW_SAMPLES.code)
