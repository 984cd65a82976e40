"""What `make_plan` is asked for: a manifest, a purpose, the limits of the plan, and what `--target` chooses."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rarms_iac.manifest.checks.measurement import TOO_FEW_SAMPLES
from rarms_iac.manifest.load import Loaded
from rarms_iac.model.changes import Change
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.layout import ChosenLayout
from rarms_iac.model.plan import PlanOrder, Purpose
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner.reservations import FixedReservations, ReservationSource
from rarms_iac.texts.findings import NO_TARGET
from rarms_iac.texts.messages import suggestion


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanRequest(PlanOrder):
    """The request for a plan, with the manifest as it was read."""

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


def is_below(address: str, targets: Sequence[str]) -> bool:
    """Return whether the address is one of the targets or lies below one; True without targets."""
    return not targets or any(address == target or address.startswith(f"{target}/") for target in targets)


def targeted(changes: Sequence[Change], targets: Sequence[str]) -> tuple[Change, ...]:
    """Return the changes at and below the targets; all of them without targets."""
    return tuple(change for change in changes if is_below(str(change.address), targets))


def unknown_targets(addresses: Sequence[str], targets: Sequence[str]) -> tuple[Diagnostic, ...]:
    """Return a finding for each target at and below which none of the addresses lies."""
    return tuple(
        NO_TARGET.at(
            None,
            "`--target {target}`: this address does not exist.{_suggestion}",
            prose(
                "Give an address such as partition/vision, or omit the option. ",
                command("plan", verbose=True),
                " lists the changes with their addresses.",
            ),
            address=target,
            target=target,
            _suggestion=_suggestion(target, addresses),
        )
        for target in targets
        if not any(is_below(address, [target]) for address in addresses)
    )


def _suggestion(target: str, addresses: Sequence[str]) -> str:
    """Suggest a similar address; a name alone is looked for among partitions and task classes, too."""
    words = [target, f"partition/{target}", f"task/{target}"]
    for word in words:
        if word in addresses:
            return f' Did you mean "{word}"?'
    return next((message for word in words if (message := suggestion(word, addresses))), "")
