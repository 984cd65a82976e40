"""How the fields of requests appear at the command line: their options, help, and readers of values. No click here.

`option`, `flag` and `argument` make the fields of a request that the command line asks for; their names and types are
the dataclass's own. Readers of values raise ValueError with a sentence for people.
"""

from collections.abc import Callable
from dataclasses import MISSING, dataclass, field
from datetime import date
from functools import partial
from typing import Any

from rarms_iac.model.names import is_name
from rarms_iac.model.quantities import NotAQuantity, Unit, parse_quantity
from rarms_iac.model.wording import quoted

Reader = Callable[[str], object]


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """An option, or without `flags` an argument, of every command that takes the request."""

    flags: tuple[str, ...] = ()
    help: str = ""
    metavar: str | None = None
    read: Reader | None = None  # None: as the field's type says
    least: int | None = None  # of a whole number
    most: int | None = None
    environment: str | None = None  # a variable that gives it, too


def option(
    *flags: str,
    help: str,  # noqa: A002 - the word of every command line
    default: object = None,
    required: bool = False,
    metavar: str | None = None,
    read: Reader | None = None,
    least: int | None = None,
    most: int | None = None,
    environment: str | None = None,
) -> Any:
    """Make a dataclass's field that is an option.

    Args:
        help: what it is for, in the `--help` of each command that takes the request.
        required: the command line has to give it; there is no default then.
        metavar: what stands for the value in the help; None: click's own word.
        read: makes the value of a word; None: as the field's type says.
        least: of a whole number.
        most: of a whole number.
        environment: a variable that gives it, too.

    Returns:
        The field, as `dataclasses.field` makes it.
    """
    described = Option(
        flags=flags, help=help, metavar=metavar, read=read, least=least, most=most, environment=environment
    )
    return field(default=MISSING if required else default, metadata={"option": described})


def flag(name: str, *, help: str) -> Any:  # noqa: A002 - as above
    """Make a dataclass's field that is False unless the option is given.

    Returns:
        The field, as `dataclasses.field` makes it.
    """
    return option(name, help=help, default=False)


def argument(metavar: str | None = None, *, default: object = MISSING) -> Any:
    """Make a dataclass's field that is an argument; a tuple takes any number.

    Args:
        metavar: what stands for it in the help; None: its name.
        default: of the field; without one the command line has to give it.

    Returns:
        The field, as `dataclasses.field` makes it.
    """
    return field(default=default, metadata={"option": Option(metavar=metavar)})


def read_time(text: str) -> int:
    """Read a time.

    Args:
        text: as `60s`, with its unit.

    Returns:
        Whole milliseconds.

    Raises:
        ValueError: it is none.
    """
    try:
        return int(parse_quantity(text, Unit.TIME)[1])
    except NotAQuantity as error:
        comma = " The decimal sign is a point." if "," in text else ""
        raise ValueError(f"{quoted(text)} is not a time as 60s; units: {', '.join(error.units)}.{comma}") from error


def read_percent(text: str) -> int:
    """Read a whole per cent from 1 to 100.

    Args:
        text: as `10%` or `10 %`.

    Returns:
        The number.

    Raises:
        ValueError: it is none.
    """
    try:
        value = parse_quantity(text, Unit.SHARE)[1]
    except NotAQuantity:
        value = None
    if value is None or value.denominator != 1 or not 1 <= value <= 100:
        raise ValueError(f"{quoted(text)} is not a whole per cent from 1% to 100%, with its sign, as 10%.")
    return int(value)


def read_day(text: str) -> date:
    """Read a day.

    Args:
        text: as `2026-01-31`.

    Returns:
        The day.

    Raises:
        ValueError: it is none.
    """
    try:
        return date.fromisoformat(text)
    except ValueError as error:
        raise ValueError(f"{quoted(text)} is not a day as 2026-01-31.") from error


def read_host_name(text: str) -> str:
    """Read the name of a host.

    Returns:
        The same.

    Raises:
        ValueError: it is none.
    """
    if not is_name(text):
        raise ValueError(f"{quoted(text)} cannot be the name of a host.")
    return text


lock_timeout_option = partial(
    option,
    "--lock-timeout",
    default=0,
    metavar="TIME",
    read=read_time,
    help="Wait so long for a host that another run holds: 60s, 5min. [default: do not wait]",
)
auto_approve_option = partial(flag, "--auto-approve", help="Do not ask.")
samples_option = partial(
    option,
    "--samples",
    least=2,
    help="A search judges a setting from so many of each component on; with --from or --strategy paper it ends there. "
    "[default: as `run.until` says]",
)
busy_host_option = partial(flag, "--on-busy-host", help="Measure although something else runs; the data logs say so.")
STOP_PARTITIONS = Option(
    flags=("--stop-partitions",), help="Stop the application's own partitions meanwhile, and start them again."
)
"""Whether partitions may be stopped to measure: no field of a request, as a terminal and a page ask each their way."""

verbose_option = partial(option, "--verbose", "-v", default=False, help="Show every attribute, reason and step, too.")
load_host_option = partial(
    flag, "--load-host", help="Use all idle time of the hosts; needed where there is no terminal to say so at."
)
