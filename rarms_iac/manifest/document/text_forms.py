"""Texts of the manifest that have a form: names, addresses, days; what each is called, and how it is written."""

import re
from datetime import date
from typing import Annotated, Any

from pydantic import PlainValidator, StringConstraints, WithJsonSchema
from pydantic_core import PydanticCustomError

from rarms_iac.model.names import NAME_PATTERN
from rarms_iac.model.task_names import TASK_PATTERN

_PYTHON = "[A-Za-z_][A-Za-z0-9_]*"
VARIABLE_PATTERN = "^[A-Za-z_][A-Za-z0-9_]{0,254}$"
CALL_PATTERN = rf"^{_PYTHON}(\.{_PYTHON})*:{_PYTHON}$"
SSH_PATTERN = r"^([A-Za-z0-9_][A-Za-z0-9_.\\-]{0,127}@)?[A-Za-z0-9\[][A-Za-z0-9_.:%\[\]-]{0,254}$"
HOST_PATTERN = r"^[A-Za-z0-9\[][A-Za-z0-9_.:%\[\]-]{0,254}$"
SSH_FILE_PATTERN = "^[A-Za-z0-9_~/.%][A-Za-z0-9_~/.%+:@ -]{0,254}$"
ABSOLUTE_FOLDER_PATTERN = "^/[^\\x00-\\x1f\\x7f]{0,254}$"
SLICE_PATTERN = "^[a-z0-9][a-z0-9_-]{0,62}$"
STRESSOR_PATTERN = "^[a-z][a-z0-9-]{0,39}$"
OPERATION_PATTERN = "^[a-z][a-z_]{0,62}$"
CODE_PATTERN = "^RARMS[0-9]{3}$"
VERSION_PATTERN = "^>= ?[0-9]{1,6}([.][0-9]{1,6}){0,2}$"
DAY_PATTERN = "^[0-9]{4}-(0[1-9]|1[0-2])-(0[1-9]|[12][0-9]|3[01])$"

FORMS: dict[str, tuple[str, str]] = {
    NAME_PATTERN: (
        "a name",
        "Names have 1 to 63 small letters a-z, digits and hyphens, and start and end with a letter or digit.",
    ),
    TASK_PATTERN: (
        "the name of a task class",
        "Task classes have 1 to 63 letters, digits and spaces, and start with a letter.",
    ),
    VARIABLE_PATTERN: (
        "the name of an environment variable",
        "Such names have letters, digits and underscores, and do not start with a digit.",
    ),
    CALL_PATTERN: ("a function", "Write module:function, as in components.path_planning:plan."),
    SSH_PATTERN: ("an address for ssh", "Write user@host, or a name of your ssh configuration."),
    HOST_PATTERN: ("the name of a host", "Write its name or address, as in cell.plant.example."),
    SSH_FILE_PATTERN: ("a file of ssh", "Write its path, without quotes; letters, digits, blanks and ~/._%+:@- fit."),
    ABSOLUTE_FOLDER_PATTERN: ("an absolute path", "Write the whole path on the robot, as in /opt/robot."),
    SLICE_PATTERN: (
        "the name of a control group",
        "Such names have small letters, digits, hyphens and underscores, and start with a letter or digit.",
    ),
    STRESSOR_PATTERN: ("a stressor", "Write a name that stress-ng --stressors shows, as in timer."),
    OPERATION_PATTERN: ("an operation", "Write its kind in small letters and underscores, as in start_partition."),
    VERSION_PATTERN: ("a least version", "Write >= and the version, as in '>=0.2'."),
    CODE_PATTERN: ("a finding's id", "Write RARMS and three digits, as in RARMS041."),
    DAY_PATTERN: ("a day", "Write year-month-day, as in 2027-01-31."),
}
"""What a text of each pattern is called, and how it is written."""

Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
TaskName = Annotated[str, StringConstraints(pattern=TASK_PATTERN)]
Variable = Annotated[str, StringConstraints(pattern=VARIABLE_PATTERN)]
CallTarget = Annotated[str, StringConstraints(pattern=CALL_PATTERN)]
SshTarget = Annotated[str, StringConstraints(pattern=SSH_PATTERN)]
HostName = Annotated[str, StringConstraints(pattern=HOST_PATTERN)]
SshFile = Annotated[str, StringConstraints(pattern=SSH_FILE_PATTERN)]
AbsoluteFolder = Annotated[str, StringConstraints(pattern=ABSOLUTE_FOLDER_PATTERN)]
SliceName = Annotated[str, StringConstraints(pattern=SLICE_PATTERN)]
Stressor = Annotated[str, StringConstraints(pattern=STRESSOR_PATTERN)]
Operation = Annotated[str, StringConstraints(pattern=OPERATION_PATTERN)]
Code = Annotated[str, StringConstraints(pattern=CODE_PATTERN)]
LeastVersion = Annotated[str, StringConstraints(pattern=VERSION_PATTERN)]
Filled = Annotated[str, StringConstraints(min_length=1)]


_DAY = re.compile(DAY_PATTERN.removesuffix("$") + r"\Z")


def _day(text: Any) -> date:
    if not isinstance(text, str):
        raise PydanticCustomError("string_type", "not a text")
    if _DAY.match(text) is None:
        raise PydanticCustomError("string_pattern_mismatch", "not a day", {"pattern": DAY_PATTERN})
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise PydanticCustomError("rarms_no_day", "no such day") from None


Day = Annotated[date, PlainValidator(_day), WithJsonSchema({"type": "string", "pattern": DAY_PATTERN})]
"""A day of the calendar."""
