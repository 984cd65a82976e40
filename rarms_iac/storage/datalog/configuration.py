"""The configuration log of a CoI: which level was chosen, what it gets, in what environment, and how it was proven.

JSON Lines like a data log, one per platform and component; the last `Chosen` is what holds.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from rarms_iac.model.measurement import Bench, EnvironmentSetup
from rarms_iac.storage.codec import decode_union
from rarms_iac.storage.datalog.files import append_to_log, decoded_records


@dataclass(frozen=True, slots=True, kw_only=True)
class Chosen:
    """A level and the reservation that follows from it, with the set-up that it was measured in."""

    kind: Literal["chosen"] = "chosen"
    component: str
    when: str  # UTC, as 2027-01-31T12:00:00Z
    rarms_version: str
    apt: Mapping[str, str]  # by index, as the manifest writes it: at most 100 ms
    partition: str
    reserve: int  # whole per cent of each of the partition's processors
    interpolated: bool  # it was not itself measured
    task: str | None
    data_log: str  # path below the manifest's folder
    identity: str  # the data log's digest
    setup: EnvironmentSetup
    bench: Bench


@dataclass(frozen=True, slots=True, kw_only=True)
class ProvenIndex:
    """One index beside its threshold."""

    index: str
    threshold: str
    value: float | None  # None: it could not be told
    lower: float | None
    upper: float | None
    met: bool  # it was shown to be; not so: missed, or without a verdict
    verdict: str = ""  # met, missed, within the noise, no steady state, cannot be told; empty: of an early rarms
    error: float | None = None  # that the verdict is wrong; the truth is outside the bounds with twice as much


@dataclass(frozen=True, slots=True, kw_only=True)
class Proven:
    """The component's indexes in the applied layout, all components together."""

    kind: Literal["proven"] = "proven"
    component: str
    when: str
    rarms_version: str
    host: str
    partition: str
    reserve: int
    beside: tuple[str, ...]  # the components that ran meanwhile, by name
    indexes: tuple[ProvenIndex, ...]


Entry = Chosen | Proven


def append_entry(path: Path, entry: Entry) -> None:
    """Add an entry; the log and its folder are made. It is on the disk on return.

    Args:
        path: of the configuration log (`configuration_path`).
        entry: a choice of `rarms select`, or a proof.

    Raises:
        OSError: it cannot be written.
    """
    append_to_log(path, entry)


def read_entries(path: Path) -> tuple[Entry, ...]:
    """All entries, oldest first; none where there is no file.

    Args:
        path: of the configuration log.

    Returns:
        Choices and proofs as they were made.

    Raises:
        LogUnreadable: the log is damaged, or holds something else.
        OSError: it cannot be read.
    """
    return decoded_records(path, partial(decode_union, Entry))


def last_chosen(entries: tuple[Entry, ...]) -> Chosen | None:
    """The choice that holds.

    Args:
        entries: oldest first.

    Returns:
        None: nobody chose yet.
    """
    return next((entry for entry in reversed(entries) if isinstance(entry, Chosen)), None)
