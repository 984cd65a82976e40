"""Named loads are used."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import System

BUILT_IN = "busy-loop"  # always there, whether or not the manifest describes it

FINDING = Finding(code="RARMS086", severity=Severity.NOTE, summary="Interference that no reservation rests on")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of interference that neither the policy nor a component names."""
    used = {system.policy.interference, *(component.interference for component in system.components.values())}
    for name in system.interference:
        if name not in used and name != BUILT_IN:
            yield FINDING.at(
                places.key("interference", name),
                f'Neither `policy.interference` nor a component names "{name}".',
                "Leave it if you measure with it by hand; otherwise name it or remove it.",
                address=f"interference/{name}",
            )
