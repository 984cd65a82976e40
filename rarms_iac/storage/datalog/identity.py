"""The identity of a data log: what can change the PI, in named parts; and which records of a log count now.

In it: `run`, `memory`, `processors` where the manifest fixes them, limit and weight, how P1 was held to CR, `task`,
`simulation`, the interference, and the files that belong to them. Not in it: `apt`, `criticality`, the reserve,
placement. What has its default is left out, so that a field that a later rarms adds makes no log stale. A log whose
parts differ is stale, and says what changed, what only warns and what cannot be looked at here: begin at `present_log`.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from enum import Enum
from fractions import Fraction
from itertools import chain
from typing import Any, TypeVar, get_type_hints

from rarms_iac.model.host import ProviderKind, SchedulerType
from rarms_iac.model.keys import Key
from rarms_iac.model.loads import Interference
from rarms_iac.model.quantities import Bytes, Milliseconds, Percent
from rarms_iac.model.setting import P2_WEIGHT, EnvironmentSetup, PlatformFacts
from rarms_iac.model.system import Component, TaskRequest
from rarms_iac.storage.datalog.log import DataLog, Header, Identity, LogFile
from rarms_iac.storage.json_text import canonical, digest, short
from rarms_iac.texts.quantities import write_bytes

FILE = "file "
"""What the part of a file begins with; its path follows, below the manifest's folder."""

VARIABLE = "variable "
"""What the part of a variable begins with that setup files change, among the interpreters; its name follows."""

CONFINEMENT = f"P2 reserves the rest, with the weight {P2_WEIGHT}"
"""How P1 is held to CR while it is measured: a condition of a data log (docs/data-logs.md)."""

GROUP_CONFINEMENT = "the weights of the control groups P1 and P2 are their reservations; P2 reserves the rest"
"""How P1 is held to CR on Linux, where weight with a reserve has no meaning."""

ATTACHED_CONFINEMENT = "a quota limits the component to its CR; P2 reserves the rest"
"""How a component that runs already is held to CR (`run.attach`)."""

PROCESSORS = "processors"
"""The part that only a manifest has which fixes them."""

_CHANGES_NOTHING = ("run.files", "run.until")
"""Which pattern named files is said by the files themselves; how many samples are taken changes none of them."""


def can_change_indexes(part: str) -> bool:
    """Tell whether a part of `run` can change a performance index; older logs hold some that cannot.

    Args:
        part: its name, `run.timeout`, also with its component before it.

    Returns:
        False for what is not part of an identity.
    """
    return not any(f".{part}.".find(f".{name}.") >= 0 for name in _CHANGES_NOTHING)


@dataclass(frozen=True, slots=True, kw_only=True)
class LogSubject:
    """The subject of a data log: components in one partition against a load, as the manifest has them."""

    platform: str
    components: tuple[Component, ...]  # by name
    setup: EnvironmentSetup
    load: Interference
    tasks: Mapping[str, TaskRequest]  # what the manifest fixes of task classes
    confinement: str = CONFINEMENT  # how P1 is held to CR there
    load_parts: int = 1  # the most partitions that P2 is
    fixes_processors: bool = True  # whether the manifest does: otherwise each setting says its own number


def identity_of(subject: LogSubject, files: Mapping[str, str], interpreters: Mapping[str, str]) -> Identity:
    """Return the parts of a subject; `files` and `interpreters` are digests by path.

    Args:
        files: digests by path below the manifest's folder; one that is missing here cannot be verified.
        interpreters: digests of programs outside of it, by the command's word, and of variables that setup files
            change; they only warn.

    Returns:
        Everything that can change a performance index, flat and by name.
    """
    parts = dict(_setup_parts(subject))
    for component in subject.components:
        parts.update(_component_parts(component, subject.tasks))
    parts.update({f"{FILE}{path}": value for path, value in files.items()})
    return Identity(parts=dict(sorted(parts.items())), interpreters=dict(sorted(interpreters.items())))


def header_of(subject: LogSubject, identity: Identity, platform_facts: PlatformFacts) -> Header:
    """Return the header of a subject's log.

    Returns:
        The header with its digest.
    """
    header = Header(
        platform=subject.platform,
        digest="",
        identity=identity,
        platform_facts=platform_facts,
        setup=subject.setup,
    )
    return replace(header, digest=header_digest(header))


def header_digest(header: Header) -> str:
    """Return the digest of a header, by which its records name it.

    Args:
        header: what it says of its own digest, and how many processors P1 had, does not count.

    Returns:
        16 hex digits.
    """
    return short(digest(replace(header, digest="", setup=replace(header.setup, processors=1))), 16)


def _setup_parts(subject: LogSubject) -> Iterator[tuple[str, str]]:
    setup = subject.setup
    if subject.fixes_processors:
        yield PROCESSORS, str(setup.processors)
    yield "memory", write_bytes(setup.memory)
    yield "limit", f"{setup.limit} %"
    yield "weight", str(setup.weight)
    yield "confinement", subject.confinement
    if subject.load_parts > 1:
        yield "parts of P2", str(subject.load_parts)
    yield from parts_of(f"interference.{setup.interference}", subject.load)


def _component_parts(component: Component, tasks: Mapping[str, TaskRequest]) -> Iterator[tuple[str, str]]:
    if component.run is not None:
        for name, text in parts_of("run", component.run):
            if can_change_indexes(name):
                yield f"{component.name}.{name}", text
    if component.simulation is not None:
        yield from parts_of(f"{component.name}.simulation", component.simulation)
    if component.task_class is not None:
        yield f"{component.name}.task", component.task_class
        if component.threads:
            yield f"{component.name}.task.threads", " ".join(component.threads)
        fixed = tasks.get(component.task_class)
        if fixed is not None:
            yield from parts_of(f"tasks.{component.task_class}", fixed, without=frozenset({"name", "replace_shipped"}))


def parts_of(name: str, value: Any, *, without: frozenset[str] = frozenset()) -> Iterator[tuple[str, str]]:
    """Yield the fields of a value of the model, flat: a dotted name and a text each; not a field at its default.

    Args:
        name: stands before the names of the fields.
        without: names of fields that are left out.

    Yields:
        Names and texts, by the order of the fields.
    """
    if kind := getattr(value, "kind", ""):
        yield name, kind
    hints, marked = get_type_hints(type(value)), get_type_hints(type(value), include_extras=True)
    for part in fields(value):
        inner = getattr(value, part.name)
        if part.name in without or inner == _default(part):
            continue
        yield from _inner(f"{name}.{_key(part.name, marked[part.name])}", inner, hints[part.name])


def _key(name: str, hint: Any) -> str:
    """Return the users' name of a field."""
    return next((mark.name for mark in getattr(hint, "__metadata__", ()) if isinstance(mark, Key) and mark.name), name)


def _inner(name: str, value: Any, hint: Any) -> Iterator[tuple[str, str]]:
    if is_dataclass(value):
        yield from parts_of(name, value)
    elif isinstance(value, Mapping):
        for key in sorted(value):
            yield from _inner(f"{name}.{key}", value[key], None)
    else:
        yield name, _text(value, hint)


def _text(value: Any, hint: Any) -> str:
    if isinstance(value, tuple):
        return canonical(list(value))
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, Fraction):
        unit = " ms" if _is(hint, Milliseconds) else " %" if _is(hint, Percent) else ""
        return f"{_decimal(value)}{unit}"
    if _is(hint, Bytes):
        return write_bytes(value)
    return "none" if value is None else str(value)


def _is(hint: Any, unit: Any) -> bool:
    return hint is unit or unit in getattr(hint, "__args__", ())


def _decimal(value: Fraction) -> str:
    """Return the exact number: as a decimal where it is one, as manifests write it."""
    scaled = value * 10**18
    if scaled.denominator != 1:
        return str(value)
    whole, rest = divmod(abs(scaled.numerator), 10**18)
    sign = "-" if value < 0 else ""
    return f"{sign}{whole}.{rest:018d}".rstrip("0").rstrip(".")


def _default(part: Any) -> Any:
    if part.default is not MISSING:
        return part.default
    return part.default_factory() if part.default_factory is not MISSING else MISSING


ABSENT = "not set"
HARDWARE = frozenset({"provider", "processor model", "logical processors", "SMT"})
"""Parts of a platform that only another machine has otherwise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PartialPlatform:
    """The known facts of the platform now; None: it was not looked at."""

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
        """Write as `vision.run.timeout: 60000 ms -> 1000 ms`; of a file, only that it changed."""
        if self.part.startswith(FILE):
            return f"{self.part} " + ("is new" if self.before == ABSENT else "changed")
        return f"{self.part}: {self.before} -> {self.after}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A log compared with what is now."""

    changed: tuple[Changed, ...]  # it is stale, if there are any
    warns: tuple[Changed, ...]  # could matter: the build of the operating system, an interpreter
    unverified: tuple[str, ...]  # files that are not here, so that it is unknown


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
    """The part of a data log's file that holds now."""

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
    """Join all of them, each once."""
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
            part = word if word.startswith(VARIABLE) else f"program {word}"
            yield Changed(part=part, before=before, after=after)


def _build(was: PlatformFacts, now: ObservedPlatform) -> Iterator[Changed]:
    if now.os_build is not None and was.os_build != now.os_build:
        yield Changed(part="build of the operating system", before=str(was.os_build), after=str(now.os_build))
