"""Kinds of problems that planning finds (RARMS014, RARMS100-109, RARMS120-139)."""

from rarms_iac.model.diagnostics import Finding, Severity

_ERROR, _WARNING = Severity.ERROR, Severity.WARNING

RESERVATIONS = Finding(code="RARMS014", severity=_ERROR, summary="Reservations exceed the platform")
UNMEASURED = Finding(code="RARMS100", severity=_ERROR, summary="A measured reserve without a data log")
STALE = Finding(code="RARMS102", severity=_ERROR, summary="A data log is stale")
INTERPOLATED = Finding(code="RARMS103", severity=_WARNING, summary="A reservation that was not itself measured")
NOT_VERIFIED = Finding(code="RARMS104", severity=Severity.NOTE, summary="A data log could not be verified here")
DIFFERENT = Finding(code="RARMS105", severity=_WARNING, summary="A data log was measured under another system")
NOT_MET = Finding(code="RARMS106", severity=_ERROR, summary="No measured reservation meets the APT")
UNREADABLE = Finding(code="RARMS107", severity=_ERROR, summary="A data log cannot be read")
BUSY = Finding(code="RARMS108", severity=_WARNING, summary="A data log was measured beside other machines")
MEMORY = Finding(code="RARMS120", severity=_ERROR, summary="Memory exceeds the platform")
PACKING = Finding(code="RARMS121", severity=_ERROR, summary="Virtual processors do not fit the logical ones")
PLACEMENT = Finding(code="RARMS122", severity=_ERROR, summary="No placement on the hosts was found")
PARALLELISM = Finding(code="RARMS123", severity=_ERROR, summary="A reservation is more than its processors can use")
TOO_WIDE = Finding(code="RARMS124", severity=_ERROR, summary="A partition has more processors than any host")
COMPANY = Finding(code="RARMS125", severity=_ERROR, summary="Components share a partition that must not")
SMALLER = Finding(code="RARMS126", severity=_WARNING, summary="The host is smaller than the manifest says")
BETTER_ELSEWHERE = Finding(
    code="RARMS127", severity=Severity.NOTE, summary="A partition would be better off on another host"
)
CLASS_ORDER = Finding(
    code="RARMS128", severity=_WARNING, summary="Task classes cannot express the order of criticalities"
)
NEIGHBOURS = Finding(
    code="RARMS129", severity=Severity.NOTE, summary="Threads of different criticality are one priority apart"
)
IN_LOW = Finding(
    code="RARMS136", severity=Severity.NOTE, summary="A task class in Low goes first while those above are lowered"
)
NOT_PROVEN = Finding(code="RARMS301", severity=Severity.NOTE, summary="The layout is not proved to be the best")
LATE_JOBS = Finding(
    code="RARMS313", severity=Severity.NOTE, summary="Short jobs may be later beside the other partitions"
)
DEADLINES = Finding(code="RARMS314", severity=_ERROR, summary="SCHED_DEADLINE cannot keep a reservation")
KINDS = {
    finding.code: finding
    for finding in (
        RESERVATIONS,
        UNMEASURED,
        STALE,
        NOT_MET,
        UNREADABLE,
        MEMORY,
        PACKING,
        PLACEMENT,
        PARALLELISM,
        TOO_WIDE,
        COMPANY,
    )
}
"""What a `Cause` of an `Infeasible` may be."""

REMARKS = {finding.code: finding for finding in (INTERPOLATED, NOT_VERIFIED, DIFFERENT, BUSY)}
"""What may be said of a measured reservation that was found."""


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
