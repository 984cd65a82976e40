"""Kinds of problems that planning finds (RARMS014, RARMS100-109, RARMS120-139, RARMS407)."""

from rarms_iac.model.diagnostics import Finding

RESERVATIONS = Finding.error("RARMS014", "Reservations exceed the platform")
UNMEASURED = Finding.error("RARMS100", "A reservation is not measured yet")
STALE = Finding.error("RARMS102", "A data log is stale")
NOT_VERIFIED = Finding.note("RARMS104", "A data log could not be verified here")
DIFFERENT = Finding.warning("RARMS105", "A data log was measured under another system")
NOT_MET = Finding.error("RARMS106", "No measured reservation is shown to meet the APT")
UNREADABLE = Finding.error("RARMS107", "A data log cannot be read")
OTHER_CONDITIONS = Finding.note("RARMS407", "A data log has settings that are not used")
BUSY = Finding.warning("RARMS108", "A data log was measured beside other machines")
MEMORY = Finding.error("RARMS120", "Memory exceeds the platform")
PACKING = Finding.error("RARMS121", "Virtual processors do not fit the logical ones")
PLACEMENT = Finding.error("RARMS122", "No placement on the hosts was found")
PARALLELISM = Finding.error("RARMS123", "A reservation is more than its processors can use")
TOO_WIDE = Finding.error("RARMS124", "A partition has more processors than any host")
SMALLER = Finding.warning("RARMS126", "The host is smaller than the manifest says")
BETTER_ELSEWHERE = Finding.note("RARMS127", "A partition would be better off on another host")
CLASS_ORDER = Finding.warning("RARMS128", "Task classes cannot express the order of criticalities")
NEIGHBOURS = Finding.note("RARMS129", "Threads of different criticality are one priority apart")
IN_LOW = Finding.note("RARMS136", "A task class in Low goes first while those above are lowered")
WEAK_LOG = Finding.warning("RARMS327", "A data log was measured beside a load that left processors idle")
NOT_PROVEN = Finding.note("RARMS301", "The layout is not proved to be the best")
MEASURED_STEADY = Finding.warning("RARMS313", "Measured beside loads that never pause, and others may")
ON_NEIGHBOURS = Finding.note("RARMS324", "A threshold depends on its neighbours")
DEADLINES = Finding.error("RARMS314", "SCHED_DEADLINE cannot keep a reservation")
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
    )
}
"""What a `Cause` of an `Infeasible` may be."""

NO_ROOM = frozenset({RESERVATIONS.code, MEMORY.code, PACKING.code})
"""Of them those of hosts that have too little."""

REMARKS = {finding.code: finding for finding in (NOT_VERIFIED, DIFFERENT, OTHER_CONDITIONS, BUSY, WEAK_LOG)}
"""What may be said of a measured reservation that was found."""


UNABLE = Finding.error("RARMS305", "Unable to reduce total CPU reservation by combining CoIs")
CONTRADICTION = Finding.warning("RARMS306", "A measurement contradicts what the proof assumes")
ABOVE_THE_SUM = Finding.warning("RARMS307", "A compound reserves more than its parts did")
STILL_TOO_MUCH = Finding.error("RARMS308", "Combined, and the reservations still do not fit")
PLATFORMS = Finding.error("RARMS309", "Tuning needs hosts of one platform")
NO_ANSWER = Finding.error("RARMS310", "A compound could not be measured")
