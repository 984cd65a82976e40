"""How large a manifest may be, and what it may not hold (DESIGN section 1, Reading)."""

from rarms_iac.model.diagnostics import Finding, Severity

MAX_DEPTH = 32
MAX_NODES = 400_000
MAX_SCALAR = 64 * 2**10  # characters

NOT_YAML = Finding(code="RARMS007", severity=Severity.ERROR, summary="Not valid YAML")
NOT_ALLOWED = Finding(code="RARMS008", severity=Severity.ERROR, summary="A part of YAML that rarms does not read")
SAME_KEY = Finding(code="RARMS009", severity=Severity.ERROR, summary="The same key twice")
TOO_MUCH = Finding(code="RARMS010", severity=Severity.ERROR, summary="More than a manifest may hold")
NOT_KEPT = Finding(code="RARMS011", severity=Severity.ERROR, summary="A number that cannot be kept")
