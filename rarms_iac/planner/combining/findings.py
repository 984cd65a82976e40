"""What tuning finds; each has its page in docs/findings."""

from rarms_iac.model.diagnostics import Finding, Severity

UNABLE = Finding(
    code="RARMS305",
    severity=Severity.ERROR,
    summary="Unable to reduce total CPU reservation by combining CoIs",
)
CONTRADICTION = Finding(
    code="RARMS306", severity=Severity.WARNING, summary="A measurement contradicts what the proof assumes"
)
ABOVE_THE_SUM = Finding(
    code="RARMS307", severity=Severity.WARNING, summary="A compound reserves more than its parts did"
)
STILL_TOO_MUCH = Finding(
    code="RARMS308", severity=Severity.ERROR, summary="Combined, and the reservations still do not fit"
)
PLATFORMS = Finding(code="RARMS309", severity=Severity.ERROR, summary="Tuning needs hosts of one platform")
NO_ANSWER = Finding(code="RARMS310", severity=Severity.ERROR, summary="A compound could not be measured")
