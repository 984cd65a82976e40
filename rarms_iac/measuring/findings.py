"""What measuring finds; each has its page in docs/findings."""

from rarms_iac.model.diagnostics import Finding, Severity

NOT_ACHIEVABLE = Finding(
    code="RARMS110", severity=Severity.ERROR, summary="Threshold performance is not achievable on this platform."
)
NOT_RESOLVED = Finding(
    code="RARMS111", severity=Severity.ERROR, summary="The samples cannot tell whether a threshold is met"
)
NO_STEADY_STATE = Finding(code="RARMS112", severity=Severity.ERROR, summary="A component reaches no steady state")
FAILED_SAMPLES = Finding(code="RARMS113", severity=Severity.ERROR, summary="Too many samples failed")
NOTHING_TO_RUN = Finding(code="RARMS114", severity=Severity.ERROR, summary="This host cannot run the component")
BUSY_HOST = Finding(code="RARMS115", severity=Severity.ERROR, summary="Something runs on the host")
RESERVED_HOST = Finding(
    code="RARMS116", severity=Severity.ERROR, summary="The paper's procedure needs a host without other reservations"
)
NO_ROOM = Finding(code="RARMS117", severity=Severity.ERROR, summary="There is no room for the test partitions")
MISSED = Finding(code="RARMS118", severity=Severity.ERROR, summary="A component misses its threshold in the layout")
NOT_APPLIED = Finding(code="RARMS119", severity=Severity.ERROR, summary="The layout is not on the host")
LEFT_BEHIND = Finding(code="RARMS261", severity=Severity.NOTE, summary="Test partitions of an earlier run were removed")
CANNOT_MEASURE = Finding(code="RARMS262", severity=Severity.ERROR, summary="This version cannot measure on this host")
MEASURED_BUSY = Finding(code="RARMS263", severity=Severity.WARNING, summary="Measured while something else ran")
MEASURED_ELSEWHERE = Finding(code="RARMS265", severity=Severity.ERROR, summary="Another run measures the same")
NO_THRESHOLD = Finding(code="RARMS264", severity=Severity.ERROR, summary="There is no threshold to search for")
FIXED_ANYWAY = Finding(
    code="RARMS266", severity=Severity.NOTE, summary="The manifest fixes a reservation that was measured"
)
LESS_UNKNOWN = Finding(
    code="RARMS267", severity=Severity.WARNING, summary="Less may be enough: settings below have no steady state"
)
