"""The identity of a data log: what can change the PI, in named parts, so that a stale log can say what changed.

In it: `run`, `memory`, `processors` where the manifest fixes them, limit and weight, how P1 was held to CR, `task`,
`simulation`, the interference, and the files that belong to them. Not in it: `apt`, `criticality`, the reserve,
placement. What has its default is left out, so that a field that a later rarms adds makes no log stale.
"""

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from enum import Enum
from fractions import Fraction
from typing import Any, get_type_hints

from rarms_iac.model.keys import Key
from rarms_iac.model.loads import Interference
from rarms_iac.model.quantities import Bytes, Milliseconds, Percent, write_bytes
from rarms_iac.model.setting import CONFINEMENT, EnvironmentSetup, PlatformFacts
from rarms_iac.model.system import Component, TaskRequest
from rarms_iac.storage.datalog.log import Header, Identity
from rarms_iac.storage.json_text import canonical, digest, short

FILE = "file "
"""What the part of a file begins with; its path follows, below the manifest's folder."""

PROCESSORS = "processors"
"""The part that only a manifest has which fixes them."""

_CHANGES_NOTHING = ("run.files", "run.until")
"""Which pattern named files is said by the files themselves; how many samples are taken changes none of them."""


def can_change_indexes(part: str) -> bool:
    """Tell whether a part of `run` can change a performance index; older logs hold some that cannot.

    Args:
        part: its name, `run.timeout`, also with its component before it.

    Returns:
        False for what is no part of an identity.
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
    fixes_processors: bool = True  # whether the manifest does: otherwise each setting says its own number


def identity_of(subject: LogSubject, files: Mapping[str, str], interpreters: Mapping[str, str]) -> Identity:
    """Return the parts of a subject; `files` and `interpreters` are digests by path, as `hashing` finds them.

    Args:
        files: digests by path below the manifest's folder; one that is missing here cannot be verified.
        interpreters: digests of programs outside of it, by the command's word; they only warn.

    Returns:
        Everything that can change a performance index, flat and by name.
    """
    parts = dict(_setup_parts(subject))
    for component in subject.components:
        parts.update(_component_parts(component, subject.tasks))
    parts.update({f"{FILE}{path}": value for path, value in files.items()})
    return Identity(parts=dict(sorted(parts.items())), interpreters=dict(sorted(interpreters.items())))


def header_of(subject: LogSubject, identity: Identity, platform_facts: PlatformFacts) -> Header:
    """Return what the log of a subject begins with.

    Args:
        identity: as `identity_of` makes it.

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
    yield from parts_of(f"interference.{setup.interference}", subject.load)


def _component_parts(component: Component, tasks: Mapping[str, TaskRequest]) -> Iterator[tuple[str, str]]:
    if component.run is not None:
        for name, text in parts_of("run", component.run):
            if can_change_indexes(name):
                yield f"{component.name}.{name}", text
    if component.simulation is not None:
        yield from parts_of(f"{component.name}.simulation", component.simulation)
    if component.task is not None:
        yield f"{component.name}.task", component.task
        fixed = tasks.get(component.task)
        if fixed is not None:
            yield from parts_of(f"tasks.{component.task}", fixed, without=frozenset({"name", "replace_shipped"}))


def parts_of(name: str, value: Any, *, without: frozenset[str] = frozenset()) -> Iterator[tuple[str, str]]:
    """Yield what a value of the model says, flat: a dotted name and a text each; a field at its default is left out.

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
    """Return what users call a field."""
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
