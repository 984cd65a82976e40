"""Hyper-V can say the memory of a partition: it counts in MiB (FACTS 1.3)."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import address, behaves_like_hyperv
from rarms_iac.manifest.checks.memory_over_host import wanted_memory
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.quantities import show_bytes
from rarms_iac.model.system import System

MEBIBYTE = 2**20

FINDING = Finding(code="RARMS067", severity=Severity.ERROR, summary="Memory that is not a whole number of MiB")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of memory on a host like Hyper-V that is no whole number of MiB."""
    for section, name, memory, hosts in wanted_memory(system):
        if memory % MEBIBYTE and any(map(behaves_like_hyperv, hosts)):
            down = memory // MEBIBYTE
            yield FINDING.at(
                places.value(section, name, "memory"),
                f'"{name}" has {show_bytes(memory)}, and Hyper-V counts memory in whole MiB.',
                f"Write {down + 1} MiB{f' or {down} MiB' if down else ''}.",
                address=address(section, name),
            )
