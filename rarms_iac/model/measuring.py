"""What reading a manifest and planning it say alike of a reservation that nobody measured."""

from rarms_iac.model.diagnostics import Finding, Severity

UNMEASURED = Finding(code="RARMS100", severity=Severity.ERROR, summary="A measured reserve without a data log")
"""Told by the check of the manifest; the planner has it as a cause, where it is asked without that check."""
