"""`rarms report`; a side of a band that has no bound is null."""

from dataclasses import dataclass
from typing import Literal

from rarms_iac.views.output.combining import AskedOutput
from rarms_iac.views.output.common import FORMAT_VERSION, Format


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportPointOutput:
    """An index at a setting. `error`: how probably the verdict is wrong."""

    reserve: int
    value: float | None
    low: float | None
    high: float | None
    samples: int
    failed: int
    verdict: str
    error: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportRowOutput:
    """The curve at one whole per cent; a reservation rests on `safe`."""

    reserve: int
    value: float | None
    safe: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportIndexOutput:
    """An index of a component against the reserve; `reserve` is what its threshold alone asks for."""

    component: str
    index: str
    direction: str
    threshold: float | None
    reserve: int | None
    points: tuple[ReportPointOutput, ...]
    curve: tuple[ReportRowOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportMeasurementOutput:
    """A data log. `rests`: a plan looks its reservation up here."""

    components: tuple[str, ...]
    platform: str
    interference: str
    log: str
    processors: int
    rests: bool
    stale: tuple[str, ...]
    reserve: int | None
    interpolated: bool
    indexes: tuple[ReportIndexOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportCapacityOutput:
    """What the hosts of a platform can promise and what they would, in LPs."""

    platform: str
    hosts: tuple[str, ...]
    capacity: float
    reserved: float
    fits: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportDifferenceOutput:
    """Something that is not on the host as the manifest wants it."""

    address: str
    says: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportStandingOutput:
    """A host that could be looked at without waiting; `is_planned`: there is a layout that could be applied."""

    host: str
    is_planned: bool
    differs: tuple[ReportDifferenceOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportTuningOutput:
    """The last run of `rarms tune` on a platform; amounts are per cent of one logical processor (140: 1.4 LP)."""

    platform: str
    when: str
    strategy: Literal["default", "paper"]
    ending: Literal["successful", "unable", "nothing_to_do"]
    proved: bool
    claim: str  # proved; not proved; not proved, at least 95 %
    before: int
    after: int
    trail: tuple[AskedOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportOutput:
    """`rarms report`: what was measured, and what each threshold reserves."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["report"] = "report"
    application: str
    measurements: tuple[ReportMeasurementOutput, ...]
    capacities: tuple[ReportCapacityOutput, ...]
    standings: tuple[ReportStandingOutput, ...]
    tunings: tuple[ReportTuningOutput, ...]
