"""What `rarms tune --json` says of partitions and of the settings it asked for."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class CombinedOutput:
    """A partition after tuning; `parts_reserved`: what its parts reserved apart, per cent of one logical processor."""

    name: str
    components: tuple[str, ...]  # the most critical first
    processors: int
    reserve: int
    reserved: int
    parts_reserved: int


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedOutput:
    """A setting that was asked for, in order; `worse`: the components that missed a threshold there."""

    components: tuple[str, ...]
    reserve: int
    met: bool
    worse: tuple[str, ...]
