"""Credentials are references."""

import re
from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place, Places, Severity
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS090", severity=Severity.ERROR, summary="A secret stands in the manifest")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of credentials that do not look like the name of one."""
    for partition in system.partitions.values():
        here = ("partitions", partition.name, "guest")
        guest = partition.guest
        where = f"partition/{partition.name}"
        if guest.credential is not None and not is_reference(guest.credential):
            advice = "Write the name under which it is kept: letters, digits and . _ / - only, as in `robot/guest`."
            yield _told(places.value(*here, "credential"), f'"{partition.name}"', where, advice)


_REFERENCE = re.compile(r"[A-Za-z0-9][A-Za-z0-9._/-]{0,127}")
_KEY = re.compile(r"(?=.*[a-z])(?=.*[A-Z])(?=.*[0-9])[A-Za-z0-9_-]{16,}")


def is_reference(text: str) -> bool:
    """Whether it may be the name of a credential: no sign that only passwords have, and not as mixed as a key."""
    return _REFERENCE.fullmatch(text) is not None and _KEY.fullmatch(text) is None


def _told(place: Place, of: str, where: str, advice: str) -> Diagnostic:
    return FINDING.at(
        place,
        f"The credential of {of} looks like the secret itself. The manifest lies in git, where everybody reads it and "
        "nothing is ever forgotten.",
        f"{advice} Change the secret if it was committed.",
        address=where,
    )
