"""Partitions of a manifest are not called like those that measuring makes and removes."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import partition_names
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.measurement import TEST_PARTITIONS
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS260", severity=Severity.ERROR, summary="A partition is called like a test partition")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of partitions, with an entry or without, that measuring would remove."""
    for name in sorted({*partition_names(system)} & {*TEST_PARTITIONS}):
        section = "partitions" if name in system.partitions else "components"
        yield FINDING.at(
            places.key(section, name),
            f"`rarms measure` makes partitions called {' and '.join(TEST_PARTITIONS)}, and removes them again.",
            "Rename the partition (its component, where it has no entry of its own).",
            address=f"partition/{name}",
        )
