"""Checks of secrets: the manifest lies in git, so it holds references to secrets only."""

import re
from collections.abc import Iterator

from rarms_iac.manifest.checks.violation import Violation, check, component_check, violation
from rarms_iac.model.diagnostics import Finding
from rarms_iac.model.host import HypervHost
from rarms_iac.model.system import Component, System

_REFERENCE = re.compile(r"[A-Za-z0-9][A-Za-z0-9._/-]{0,127}")
_KEY = re.compile(r"(?=.*[a-z])(?=.*[A-Z])(?=.*[0-9])[A-Za-z0-9_-]{16,}")
_SECRET = re.compile(r"(?i)(password|passwd|passphrase|secret|api_?key|access_?key|private_?key|(^|_)token$|(^|_)pw$)")


@check(Finding.error("RARMS090", "The manifest contains a secret"))
def secret_in_clear(system: System) -> Iterator[Violation]:
    """Credentials that do not look like the name of one."""
    named = [
        (("partitions", name, "guest"), name, request.guest.credential) for name, request in system.partitions.items()
    ]
    for name, host in system.hosts.items():
        if isinstance(host.settings, HypervHost):
            named.append((("hosts", name, "hyperv"), name, host.settings.credential))
    for path, name, credential in named:
        if credential is not None and not is_reference(credential):
            yield violation(
                (*path, "credential"),
                'The credential of "{name}" looks like the secret itself. The manifest lies in git, where '
                "others can read it and nothing is deleted.",
                "Write the name under which the credential is stored: letters, digits and . _ / - only, for "
                "example `robot/guest`. Change the secret if it was committed.",
                key="credential",
                name=name,
            )


def is_reference(text: str) -> bool:
    """Whether it may be the name of a credential: no sign that only passwords have, and not as mixed as a key."""
    return _REFERENCE.fullmatch(text) is not None and _KEY.fullmatch(text) is None


@component_check(Finding.warning("RARMS091", "The manifest contains a variable that looks like a secret"))
def secret_in_environment(component: Component) -> Iterator[Violation]:
    """Variables with a secret's name whose value stands in the manifest."""
    for name, value in (component.run.environment if component.run is not None else {}).items():
        if isinstance(value, str) and value and _SECRET.search(name):
            yield violation(
                ("components", component.name, "run", "environment", name),
                'The manifest contains the value of {variable} for "{component}". The manifest lies in '
                "git, where others can read it.",
                f"Write `{name}: {{ from_env: {name} }}`. Change the secret if it was committed.",
                variable=name,
            )
