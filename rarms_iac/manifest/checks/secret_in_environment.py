"""Secrets come from the environment."""

import re
from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import System

FINDING = Finding(
    code="RARMS091", severity=Severity.WARNING, summary="A variable that looks like a secret is written out"
)


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of variables with a secret's name whose value stands in the manifest."""
    for component in system.components.values():
        for name, value in (component.run.environment if component.run is not None else {}).items():
            if isinstance(value, str) and value and _SECRET.search(name):
                yield FINDING.at(
                    places.value("components", component.name, "run", "environment", name),
                    f'"{component.name}" gets {name} from the manifest, which lies in git.',
                    f"Write `{name}: {{ from_env: {name} }}`; change the secret if it was committed.",
                    address=f"component/{component.name}",
                )


_SECRET = re.compile(r"(?i)(password|passwd|passphrase|secret|api_?key|access_?key|private_?key|(^|_)token$|(^|_)pw$)")
