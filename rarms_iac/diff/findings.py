"""Kinds of problems that show when the wanted state meets a host (RARMS150-159, 165, 228)."""

from rarms_iac.model.diagnostics import Finding, Severity

FOREIGN_AT_NAME = Finding(
    code="RARMS150", severity=Severity.ERROR, summary="A machine that rarms did not make has a wanted name"
)
FOREIGN_MARK = Finding(code="RARMS151", severity=Severity.WARNING, summary="A mark that does not count")
PROTECTED = Finding(code="RARMS152", severity=Severity.ERROR, summary="A protected partition would be removed")
FOREIGN_TASK = Finding(
    code="RARMS153", severity=Severity.ERROR, summary="A task class that rarms did not write has a wanted name"
)
NO_ORDER = Finding(code="RARMS154", severity=Severity.ERROR, summary="No order of steps keeps within the host")
NOT_AT_REST = Finding(
    code="RARMS155", severity=Severity.ERROR, summary="A partition is in a state that it cannot be changed in"
)
NOTHING_TO_MOVE = Finding(code="RARMS156", severity=Severity.WARNING, summary="Both names of a move exist on the host")
RESPONSIVENESS = Finding(
    code="RARMS228", severity=Severity.ERROR, summary="SystemResponsiveness of this host cannot be decided here"
)
NOT_RESTORABLE = Finding(
    code="RARMS165", severity=Severity.ERROR, summary="A registry value is in the way that could not be brought back"
)
GUEST_FIRST = Finding(
    code="RARMS157", severity=Severity.NOTE, summary="A shipped task class of a new guest waits for the next plan"
)
