"""How the measuring of an experiment ended: the strategies say it, the command line tells it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """Not ended: run the setting with this CR."""

    reserve: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Sufficient:
    """Every APT is met at this CR, and at no lower one that was looked at."""

    reserve: int
    error: float  # probability that an APT is not met there
    says: str = ""  # what else is worth knowing of it


@dataclass(frozen=True, slots=True, kw_only=True)
class NotAchievable:
    """Not every APT is met at the highest CR that the host can give."""

    reserve: int  # that CR
    error: float  # probability that they are met there
    says: str


@dataclass(frozen=True, slots=True, kw_only=True)
class NotResolved:
    """The samples allowed cannot tell; `safe` is a CR that is enough, if there is one."""

    safe: int | None
    says: str


@dataclass(frozen=True, slots=True, kw_only=True)
class NoVerdict:
    """A setting was run and can say nothing: too many failed samples, or no steady state. It was not recorded."""

    reserve: int
    component: str
    code: str  # of the finding that tells it
    says: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Swept:
    """All the settings that were asked for are there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stopped:
    """Somebody asked for an end; what is recorded stays, and the same command goes on."""


Conclusion = Sufficient | NotAchievable | NotResolved | NoVerdict | Swept | Stopped
Step = Measure | Conclusion
