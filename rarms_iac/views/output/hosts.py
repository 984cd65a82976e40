"""What a host is like: `rarms drift` and `rarms doctor`."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.views.output.common import FORMAT_VERSION, Format
from rarms_iac.views.output.plan import AttributeOutput


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftedOutput:
    """One address that is not as it should be; `before` of an attribute is what is there."""

    host: str
    address: str
    drift: Literal["host_changed", "not_applied", "both", "missing", "removed", "unused"]
    says: str
    attributes: tuple[AttributeOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftOutput:
    """`rarms drift`."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["drift"] = "drift"
    application: str
    drifted: tuple[DriftedOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExaminedOutput:
    """What `rarms doctor` looked at; null where it could not be read. `os_build` is 0 where there is no Windows."""

    name: str
    provider: str
    computer: str
    os_build: int
    client: bool
    scheduler: Literal["classic", "core", "root", "unknown", "none"]
    logical_processors: int
    seen_processors: int | None
    smt: bool
    memory: int
    rights: Literal["proven", "missing", "unknown"]
    powershell: str | None
    module: tuple[str, ...] | None
    machines: int
    managed: int
    running: int
    findings: tuple[Diagnostic, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class DoctorOutput:
    """`rarms doctor`: what makes a plan void or unsafe on each host."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["doctor"] = "doctor"
    application: str
    hosts: tuple[ExaminedOutput, ...]
    accepted: tuple[Diagnostic, ...]
    counts: Mapping[str, int]
