"""Which records of a data log count now, and what changed, what only warns and what cannot be looked at here."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TypeVar

from rarms_iac.model.host import ProviderKind, SchedulerType
from rarms_iac.model.setting import PlatformFacts
from rarms_iac.storage.datalog.identity import FILE, PROCESSORS, can_change_indexes
from rarms_iac.storage.datalog.log import DataLog, Header, Identity, LogFile

ABSENT = "not set"
HARDWARE = frozenset({"provider", "processor model", "logical processors", "SMT"})
"""Parts of a platform that only another machine has otherwise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PartialPlatform:
    """What is known of the platform now; None: it was not looked at."""

    provider: ProviderKind
    logical_processors: int
    guest_image: str | None = None
    processor: str | None = None
    smt: bool | None = None
    scheduler: SchedulerType | None = None
    os_build: int | None = None


ObservedPlatform = PlatformFacts | PartialPlatform
"""A platform as it is now: looked at whole, or as far as it is known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Changed:
    """One part that is not as it was measured."""

    part: str
    before: str
    after: str

    @property
    def is_of_hardware(self) -> bool:
        """Whether another machine, or the same one rebuilt, has it so; not the manifest or a file."""
        return self.part in HARDWARE

    def __str__(self) -> str:
        """`vision.run.timeout: 60000 ms -> 1000 ms`; of a file, only that it changed."""
        if self.part.startswith(FILE):
            return f"{self.part} " + ("is new" if self.before == ABSENT else "changed")
        return f"{self.part}: {self.before} -> {self.after}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A log beside what is now."""

    changed: tuple[Changed, ...]  # it is stale, if there are any
    warns: tuple[Changed, ...]  # could matter: the build of the operating system, an interpreter
    unverified: tuple[str, ...]  # files that are not here, so that it cannot be told


def compare_header(
    header: Header, members: Sequence[str], identity: Identity, platform_facts: ObservedPlatform
) -> Comparison:
    """Compare a log with what would be measured now.

    Args:
        members: the components that would be measured now, by name.
        identity: of what would be measured now.
        platform_facts: the host as it is now, as far as anybody looked.

    Returns:
        What makes the log stale, what only warns, and what could not be verified.
    """
    return Comparison(
        changed=(
            *_members(header, members),
            *_parts(header, identity),
            *_platform_changes(header.platform_facts, platform_facts),
        ),
        warns=(*_interpreters(header.identity, identity), *_build(header.platform_facts, platform_facts)),
        unverified=tuple(
            part.removeprefix(FILE)
            for part in header.identity.parts
            if part.startswith(FILE) and part not in identity.parts
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Present:
    """What of a data log's file holds now."""

    log: DataLog | None  # the records of the headers that hold; None: none does, and the file is stale
    comparison: Comparison  # of these headers; where none holds, of the one that was measured last
    others: int = 0  # settings of other headers, which do not count
    other_hardware: tuple[Changed, ...] = ()  # hardware of theirs that may be this host's too, and was measured earlier


def present_log(file: LogFile, members: Sequence[str], identity: Identity, platform_facts: ObservedPlatform) -> Present:
    """Select the records of a data log that hold now.

    Headers that all may hold, because something could not be looked at, may still contradict each other: another
    processor model, another digest of a file that is not here. Then the one counts of which most was verified, of
    equal ones the one that was measured last, with all that agree with it.

    Args:
        members: The components that would be measured now, by name.
        identity: Of what would be measured now.
        platform_facts: The host as it is now, as far as anybody looked.
    """
    comparisons = {
        digest: compare_header(header, members, identity, platform_facts) for digest, header in file.headers.items()
    }
    may_hold = [digest for digest, comparison in comparisons.items() if not comparison.changed]

    def rank(digest: str) -> tuple[int, str, str]:
        return -len(comparisons[digest].unverified), file.last_measured(digest), digest

    if not may_hold:
        latest = max(file.headers, key=lambda digest: (file.last_measured(digest), digest))
        return Present(log=None, comparison=comparisons[latest], others=len(file.recorded))
    chosen = max(may_hold, key=rank)
    reference = file.headers[chosen]
    contradictions = {
        digest: compare_header(file.headers[digest], members, reference.identity, reference.platform_facts).changed
        for digest in may_hold
    }
    counting = [digest for digest in may_hold if not contradictions[digest]]
    log = file.log_of(reference, counting)
    return Present(
        log=log,
        comparison=Comparison(
            changed=(),
            warns=_joined(comparisons[digest].warns for digest in counting),
            unverified=_joined(comparisons[digest].unverified for digest in counting),
        ),
        others=len(file.recorded) - len(log.recorded),
        other_hardware=_joined(
            tuple(change for change in contradictions[digest] if change.is_of_hardware) for digest in may_hold
        ),
    )


T = TypeVar("T")


def _joined(parts: Iterable[tuple[T, ...]]) -> tuple[T, ...]:
    """All of them, each once."""
    return tuple(dict.fromkeys(chain.from_iterable(parts)))


def _members(header: Header, members: Sequence[str]) -> Iterator[Changed]:
    was, now = ("+".join(sorted(names)) for names in (header.setup.members, members))
    if was != now:
        yield Changed(part="components", before=was or ABSENT, after=now)


def _parts(header: Header, now: Identity) -> Iterator[Changed]:
    was = header.identity.parts
    for part in filter(can_change_indexes, sorted({*was, *now.parts})):
        before, after = was.get(part, ABSENT), now.parts.get(part, ABSENT)
        is_missing_here = part.startswith(FILE) and after == ABSENT
        is_open = part == PROCESSORS and ABSENT in {before, after}  # each setting says its own number
        if before != after and not is_missing_here and not is_open:
            yield Changed(part=part, before=before, after=after)


def _platform_changes(was: PlatformFacts, now: ObservedPlatform) -> Iterator[Changed]:
    for part, before, after in (
        ("provider", was.provider.value, now.provider.value),
        ("processor model", was.processor, now.processor),
        ("logical processors", was.logical_processors, now.logical_processors),
        ("SMT", was.smt, now.smt),
        ("scheduler", was.scheduler.value, _known_scheduler(now.scheduler)),
        ("guest image", was.guest_image, now.guest_image),
    ):
        if after is not None and before != after:
            yield Changed(part=part, before=_describe(before), after=_describe(after))


def _known_scheduler(scheduler: SchedulerType | None) -> str | None:
    return None if scheduler in (None, SchedulerType.UNKNOWN) else scheduler.value


def _describe(value: str | int) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return str(value) or ABSENT


def _interpreters(was: Identity, now: Identity) -> Iterator[Changed]:
    for word in sorted(was.interpreters.keys() & now.interpreters.keys()):
        before, after = was.interpreters[word], now.interpreters[word]
        if before != after:
            yield Changed(part=f"program {word}", before=before, after=after)


def _build(was: PlatformFacts, now: ObservedPlatform) -> Iterator[Changed]:
    if now.os_build is not None and was.os_build != now.os_build:
        yield Changed(part="build of the operating system", before=str(was.os_build), after=str(now.os_build))
