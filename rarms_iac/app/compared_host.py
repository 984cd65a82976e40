"""A host compared with its last apply and with the manifest: what drift, status, proofs and reports are about."""

from collections.abc import Mapping
from dataclasses import dataclass

from rarms_iac.diff.drift import DriftKind, ResourceDrift
from rarms_iac.model.journal import PastRun, RunKind
from rarms_iac.model.output import Internal, output
from rarms_iac.model.seen_host import SeenHost


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedHost:
    """A host as it was seen, the runs there, and its resources that are not as applied or as wanted."""

    seen: Internal[SeenHost]
    drifted: tuple[ResourceDrift, ...]
    runs: Internal[tuple[PastRun, ...]] = ()  # that are remembered, of any application, the oldest first

    @output
    def name(self) -> str:
        """The host's name in the manifest."""
        return self.seen.name

    @output
    def host_lp(self) -> int:
        """LPs that the host has."""
        return self.seen.facts.logical_processors

    @output
    def host_changed(self) -> int:
        """How many resources were changed on the host."""
        return sum(resource.drift.is_of_the_host for resource in self.drifted)

    @output
    def not_applied(self) -> int:
        """How many are only not applied yet."""
        return len(self.to_apply) - self.host_changed

    @output
    def unused(self) -> int:
        """How many the manifest no longer wants."""
        return len(self.drifted) - len(self.to_apply)

    @property
    def to_apply(self) -> tuple[ResourceDrift, ...]:
        """The drift that an apply ends."""
        return tuple(resource for resource in self.drifted if resource.drift is not DriftKind.UNUSED)

    @property
    def is_written(self) -> bool:
        """Whether anything there carries the application's mark."""
        own = self.seen.state.of(self.seen.application)
        return bool(own.partitions or own.tasks or own.responsiveness)

    @property
    def serial(self) -> int:
        """How many runs of the application there were."""
        return self.seen.state.serials.get(self.seen.application, 0)

    @property
    def own_runs(self) -> tuple[PastRun, ...]:
        """The application's runs that are remembered, the oldest first."""
        return tuple(run for run in self.runs if run.application == self.seen.application)

    @property
    def last_run_at(self) -> str:
        """When the last run of the application began; empty: none is remembered."""
        return self.own_runs[-1].started_at if self.own_runs else ""

    @property
    def reserves(self) -> Mapping[str, int]:
        """By partition, in whole per cent of its virtual processors; without test partitions."""
        return {name: each.settings.reserve for name, each in self.seen.present.items() if not each.is_test}

    @property
    def changed_partitions(self) -> frozenset[str]:
        """The partitions that another tool changed."""
        changed = (each.address for each in self.drifted if each.drift.is_of_the_host)
        return frozenset(address.partition for address in changed if address.partition and not address.task)

    def undone_at(self, serial: int) -> str:
        """Return the time at which the last run undid a state of the host; empty: it did not.

        An undo ends all states since its apply. If the host does not have a record of that apply, it ends all states.

        Args:
            serial: The number of the application's runs until that state.
        """
        runs = self.own_runs
        if not runs or runs[-1].run is not RunKind.UNDO:
            return ""
        runs_back = (
            ago for ago, run in enumerate(reversed(runs)) if run.run is RunKind.APPLY and run.plan == runs[-1].plan
        )
        first = self.serial - next(runs_back, self.serial)
        return self.last_run_at if first <= serial < self.serial else ""
