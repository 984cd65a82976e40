"""How the manifest writes fields of this model: plain marks in their types, which `manifest/document` gives a meaning.

A field with a `Key` is read from the manifest under its own name. The other marks say which values it takes: a unit, a
form of text, a range. A field without a default must be written.
"""

from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Annotated, TypeVar

from rarms_iac.model.names import NAME_PATTERN, TASK_PATTERN
from rarms_iac.model.quantities import Bytes, CpuAmount, Milliseconds, Percent, Unit


@dataclass(frozen=True, slots=True)
class Key:
    """Users write this field; the description is what editors and the manifest's reference show."""

    description: str
    name: str = ""  # the key in the manifest; empty: the name of the field


@dataclass(frozen=True, slots=True)
class Within:
    """The smallest and the largest whole number that fits."""

    least: int
    most: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """A text with a unit of one of these kinds."""

    kinds: tuple[Unit, ...]
    positive: bool = False
    most: str = ""  # as users write it; empty: no bound


class Shape(Enum):
    """A restriction of a value beyond its type."""

    FILLED = "filled"  # at least one character or entry
    ONE_OR_SEVERAL = "one_or_several"  # one item, or a list with at least one
    THRESHOLDS = "thresholds"  # a map from performance index to `at_most` or `at_least`
    OWN_NAME = "own_name"  # the key of the entry


_PYTHON = "[A-Za-z_][A-Za-z0-9_]*"


class Form(StrEnum):
    """The form of a text, as its pattern."""

    NAME = NAME_PATTERN
    TASK = TASK_PATTERN
    THREAD = r"^[^,\x00-\x1f\x7f]{1,64}$"
    VARIABLE = "^[A-Za-z_][A-Za-z0-9_]{0,254}$"
    CALL = rf"^{_PYTHON}(\.{_PYTHON})*:{_PYTHON}$"
    SSH = r"^([A-Za-z0-9_][A-Za-z0-9_.\\-]{0,127}@)?[A-Za-z0-9\[][A-Za-z0-9_.:%\[\]-]{0,254}$"
    HOST = r"^[A-Za-z0-9\[][A-Za-z0-9_.:%\[\]-]{0,254}$"
    SSH_FILE = "^[A-Za-z0-9_~/.%][A-Za-z0-9_~/.%+:@ -]{0,254}$"
    ABSOLUTE_FOLDER = "^/[^\\x00-\\x1f\\x7f]{0,254}$"
    SLICE = "^[a-z0-9][a-z0-9_-]{0,62}$"
    TOPIC = "^/[A-Za-z0-9_]+(/[A-Za-z0-9_]+){0,30}$"
    STRESSOR = "^[a-z][a-z0-9-]{0,39}$"
    OPERATION = "^[a-z][a-z_]{0,62}$"
    CODE = "^RARMS[0-9]{3}$"
    LEAST_VERSION = "^>= ?[0-9]{1,6}([.][0-9]{1,6}){0,2}$"
    DAY = "^[0-9]{4}-(0[1-9]|1[0-2])-(0[1-9]|[12][0-9]|3[01])$"


T = TypeVar("T")

OwnName = Annotated[str, Shape.OWN_NAME]
"""The name of a thing, which is the key of its entry."""

Filled = Annotated[T, Shape.FILLED]
OneOrSeveral = Annotated[tuple[T, ...], Shape.ONE_OR_SEVERAL]

Name = Annotated[str, Form.NAME]
TaskName = Annotated[str, Form.TASK]
ThreadPattern = Annotated[str, Form.THREAD]
Variable = Annotated[str, Form.VARIABLE]

Processors = Annotated[int, Within(1, 2048)]

Time = Annotated[Milliseconds, Quantity(kinds=(Unit.TIME,))]
PositiveTime = Annotated[Milliseconds, Quantity(kinds=(Unit.TIME,), positive=True)]
Memory = Annotated[Bytes, Quantity(kinds=(Unit.MEMORY,))]
PositiveMemory = Annotated[Bytes, Quantity(kinds=(Unit.MEMORY,), positive=True)]
Share = Annotated[Percent, Quantity(kinds=(Unit.SHARE,))]
PositiveAmount = Annotated[CpuAmount, Quantity(kinds=(Unit.SHARE, Unit.PROCESSORS), positive=True)]
