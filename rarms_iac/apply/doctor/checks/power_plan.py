"""Balanced reaches full speed only under load: response times vary (FACTS 2)."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity

FINDING = Finding(code="RARMS236", severity=Severity.WARNING, summary="The power plan slows the processors down")


SLOW = {"381b4222-f694-41f0-9685-ff5bb260df2e": "Balanced", "a1841308-3541-4fab-bc81-f71556f20b4a": "Power saver"}
"""Windows' own plans, by id; their names are in the host's language."""


def check(host: Examination) -> Iterator[Diagnostic]:
    """Tells of an active plan that is known to slow down."""
    for one in host.condition.power_plans or ():
        name = next((name for plan, name in SLOW.items() if plan in one.lower()), None)
        if name is not None:
            yield FINDING.at(
                host.place,
                f"{host.state.facts.name}: the power plan {name} is active. Its processors reach full speed only "
                "under load, so that measured response times vary and do not hold later.",
                "Choose High performance: `powercfg /setactive SCHEME_MIN`, before anything is measured.",
                address=host.address,
            )
