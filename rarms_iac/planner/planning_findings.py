"""Kinds of problems that planning finds."""

from rarms_iac.texts.findings import Finding

CONTRADICTION = Finding.warning("RARMS306", "A compound contradicts an assumption of the proof")

UNABLE = Finding.error("RARMS305", "Unable to reduce total CPU reservation by combining CoIs")

NOT_VERIFIED = Finding.note("RARMS104", "A data log was not used in full")

NOT_PROVEN = Finding.note("RARMS301", "A better layout may exist")


RESERVATIONS = Finding.error("RARMS014", "Reservations exceed the platform")
PROVISIONAL = Finding.warning("RARMS108", "The plan has provisional reservations")
UNMEASURED = Finding.error("RARMS100", "A reservation is not measured yet")
STALE = Finding.error("RARMS102", "A data log is stale")
NOT_MET = Finding.error("RARMS106", "No measured reservation is shown to meet the APT")
UNREADABLE = Finding.error("RARMS107", "A data log cannot be read")
MEMORY = Finding.error("RARMS120", "Memory exceeds the platform")
PACKING = Finding.error("RARMS121", "Virtual processors do not fit the logical processors")
PLACEMENT = Finding.error("RARMS122", "No placement on the hosts was found")
LITTLE_MEMORY = Finding.warning("RARMS127", "A partition has little more memory than its components used")
SMALLER = Finding.warning("RARMS126", "The host is smaller than in the manifest")
MEASURED_STEADY = Finding.warning("RARMS313", "Measured only with loads that never pause")
ON_NEIGHBOURS = Finding.note("RARMS324", "A threshold depends on its neighbours")
DEADLINES = Finding.error("RARMS314", "SCHED_DEADLINE cannot keep a reservation")
BUDGETS = Finding.error("RARMS442", "Real-time budgets exceed the host")
NEVER_STOPPED = Finding.error("RARMS443", "The kernel never stops threads with a task class")
NO_ROOM = frozenset({RESERVATIONS.code, MEMORY.code, PACKING.code})
"""Findings of hosts that have too little."""

NO_ANSWER = Finding.error("RARMS310", "A compound could not be measured")
PLATFORMS = Finding.error("RARMS309", "Tuning needs hosts of one platform")
