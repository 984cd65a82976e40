"""The differences between the stand-in and the real PowerShell that a comparison accepts: all of them, with a reason.

docs/scripts.md repeats each reason.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tests.fake_powershell.host import WindowsHost


@dataclass(frozen=True, slots=True, kw_only=True)
class Words:
    """Text that both replace before they are compared."""

    reason: str
    pattern: str
    same: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """Effects and values whose order is not compared."""

    reason: str
    effect: str
    """The beginning of effects that are sorted where they follow one another."""
    key: str
    """The part of an observation that is a registry key."""
    lists_of_keys: tuple[str, ...]
    """The parts that are lists of registry keys."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """A part of an observation that is not compared."""

    reason: str
    probe: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Host:
    """Hosts on which the real PowerShell does not run."""

    reason: str
    is_one: Callable[[WindowsHost], bool]


WORDS = (
    Words(
        reason="Each process has another number.",
        pattern=r"(process |\\undo-)[0-9]+",
        same=r"\1N",
    ),
    Words(
        reason="PowerShell words the error of a question that no console can answer.",
        pattern=r'Exception calling "?ShouldProcess.*',
        same="no console answers",
    ),
    Words(
        reason="PowerShell adds the .NET class of a cmdlet to the id of its error.",
        pattern=r"(\([A-Z][A-Za-z]+-[A-Za-z]+ \w+),[A-Za-z.]+(?=, line )",
        same=r"\1",
    ),
    Words(
        reason="PowerShell adds the name of a .NET method to the text of its error.",
        pattern=r'Exception calling \\?"\w+\\?" with \\?"[0-9]+\\?" argument\(s\): \\?"(.*?)\\?"',
        same=r"\1",
    ),
    Words(
        reason="The length and the checksum of a record depend on the texts in it.",
        pattern=r'"length":[0-9]+,"checksum":"[0-9a-f]{64}"',
        same='"length":0,"checksum":""',
    ),
)

ORDER = Order(
    reason="Wine sorts the values of a registry key by name.",
    effect="Remove-ItemProperty ",
    key="profile",
    lists_of_keys=("tasks", "records"),
)

ENGINE = LeftOut(
    reason="`observe.ps1` reports the version of the PowerShell that runs it.",
    probe="powershell",
)

FIELDS = "The fields of a JSON object have no order."
"""The reason to compare lines of JSON by their values."""

_OF_THE_ENGINE = ("language", "bits", "loads_hyperv", "module", "all_signed")

HOSTS = (
    Host(
        reason="This engine is a FullLanguage PowerShell with 64 bits, one Hyper-V module and the policy RemoteSigned.",
        is_one=lambda host: any(getattr(host, fact) != getattr(WindowsHost(), fact) for fact in _OF_THE_ENGINE),
    ),
    Host(
        reason="Wine cannot make a link.",
        is_one=lambda host: any(file.link for file in host.files.values()),
    ),
    Host(
        reason="A program cannot have a missing file open.",
        is_one=lambda host: not all(host.file(one.path) for one in host.opened),
    ),
)

REASONS = (*(each.reason for each in (*WORDS, ORDER, ENGINE)), FIELDS, *(each.reason for each in HOSTS))
