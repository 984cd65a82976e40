"""Components that share a partition: `rarms tune` and `rarms graph --candidates`."""

from dataclasses import dataclass
from typing import Literal

from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.views.output.common import Output


@dataclass(frozen=True, slots=True, kw_only=True)
class TunedPartitionOutput:
    """A partition after tuning. Amounts are per cent of one logical processor.

    `parts_reserved`: what its parts reserved apart; null: tuning did not combine it, it was there before.
    """

    name: str
    components: tuple[str, ...]  # the most critical first
    processors: int
    reserve: int
    reserved: int
    parts_reserved: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class TrailSettingOutput:
    """A setting that was asked for, in order; `worse`: the components that missed a threshold there.

    `predicted`: the CR that was expected to be enough when it was asked for; nothing rests on it.
    """

    components: tuple[str, ...]
    reserve: int
    met: bool
    worse: tuple[str, ...]
    predicted: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class TuneOutput(Output):
    """`rarms tune`. Amounts are per cent of one logical processor (140: 1.4 LP); `written`: the manifest's file."""

    kind: Literal["tune"] = "tune"
    platform: str
    hosts: tuple[str, ...]  # of the platform, that share the capacity
    strategy: Literal["default", "paper"]
    ending: Literal["nothing_to_do", "successful", "unable", "stopped"]
    message: str
    capacity: int
    fixed: int  # what partitions reserve that are not tuned: a part of `before` and of `after`
    before: int
    after: int
    proved: bool  # that no other layout is better, under the assumption of docs/combining.md
    claim: Literal["proved", "not proved"]
    contradictions: tuple[str, ...]
    partitions: tuple[TunedPartitionOutput, ...]
    trail: tuple[TrailSettingOutput, ...]
    written: str
    findings: tuple[Diagnostic, ...]
