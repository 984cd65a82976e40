"""What the last run left on a host, by its journal: what is gone since then was removed by somebody else."""

from rarms_iac.model.changes import Adopt, Create, Delete, Release
from rarms_iac.model.journal import Closing, Journal, RunKind, ScriptRun


def left_by(journal: Journal | ScriptRun | None, application: str) -> frozenset[str] | None:
    """The partitions of this application that were on the host when its last run ended; None where that is not known.

    The plan's digests name what was there before it. An undo brings that back, except for what the plan removed.
    """
    if journal is None:
        return frozenset()
    started = journal.started
    if not isinstance(journal, Journal) or started.application != application:
        return None
    if journal.closed is None or journal.closed.closing is not Closing.DONE:
        return None
    plan = journal.started.host_plan
    before = {name.removeprefix(_PREFIX) for name in plan.digests if name.startswith(_PREFIX)}
    whole = [change for change in plan.changes if change.address.partition and not change.address.task]
    made = {one.address.partition for one in whole if isinstance(one, Create | Adopt)}
    gone = {one.address.partition for one in whole if isinstance(one, Delete | Release)}
    if started.run is RunKind.UNDO:
        return frozenset(before - made - gone)
    return frozenset((before | made) - gone)


_PREFIX = "partition/"
