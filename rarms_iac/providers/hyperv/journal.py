r"""The journal that scripts keep under `%ProgramData%\rarms`, as the last run on that operating system. Pure.

docs/scripts.md says what its records hold. One that belongs to neither Administrators nor SYSTEM was planted, and is
not believed.
"""

from dataclasses import dataclass
from pathlib import Path

from rarms_iac.model.journal import RunClosed, ScriptRun, ScriptStarted, StepRecorded
from rarms_iac.storage.append import Damaged, records_in
from rarms_iac.storage.codec import Json, NotDecodable, decode

TRUSTED = frozenset({"S-1-5-32-544", "S-1-5-18", ""})
"""Administrators and SYSTEM; empty where the system has no such owners, as off Windows."""

PLACE = Path("%ProgramData%/rarms/journal.jsonl")


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalDamaged:
    """It cannot be read: nothing is known of the last run."""

    message: str


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalPlanted:
    """It belongs to an account that must not tell an administrator what to do."""

    owner: str


@dataclass(frozen=True, slots=True, kw_only=True)
class NoJournal:
    """Nothing has run there yet."""


LastRun = ScriptRun | JournalDamaged | JournalPlanted | NoJournal


def last_run(owner: str, text: str) -> LastRun:
    """Read the last run from the journal, which is believed only from an owner who may."""
    if owner not in TRUSTED:
        return JournalPlanted(owner=owner)
    try:
        return _run(records_in(text.encode("utf-8", "surrogatepass"), PLACE))
    except Damaged as error:
        return JournalDamaged(message=f"line {error.line}: {error.message}")
    except NotDecodable as error:
        return JournalDamaged(message=str(error))


def _run(records: tuple[dict[str, Json], ...]) -> ScriptRun:
    started = _started(records[0])
    steps: list[StepRecorded] = []
    closed: RunClosed | None = None
    for record in records[1:]:
        if closed is not None:
            raise NotDecodable("", "there are records after the run was closed")
        if record.get("kind") == "run_closed":
            closed = decode(RunClosed, record)
        else:
            steps.append(decode(StepRecorded, record))
    return ScriptRun(started=started, steps=tuple(steps), closed=closed)


def _started(record: dict[str, Json]) -> ScriptStarted:
    touched = record.get("touched")
    texts: list[Json] = [str(number) for number in touched] if isinstance(touched, list) else []
    return decode(ScriptStarted, {**record, "touched": texts})
