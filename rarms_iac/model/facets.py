"""The settings of a partition as a table: which of them one call sets, with which cmdlet, and their labels.

All code that reads, compares, sets, undoes or shows a setting uses `FACETS` and `LABELS`; `texts/plans.py` writes its
values. A new setting is a field of `PartitionSettings`, a label and a place in a row. The operation is `Set`
(`model/operations.py`).

The boot order is in the row of the firmware as a parameter only, not as a setting: a creation names the first device,
and no plan compares or changes it later, because a guest puts an entry of its own first once it runs.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from enum import Enum, StrEnum
from typing import Any

from rarms_iac.model.state import NO_GENERATION, PartitionSettings

Reading = bool | int | str
Readings = Mapping[str, Reading]
"""Some of what can be read at an address, by name: see `diff.readings`."""


class Facet(StrEnum):
    """The settings of a partition that one call sets, in the order in which a change sets them."""

    PROCESSORS = "processors"
    CPU = "cpu"
    MEMORY = "memory"
    ACTIONS = "actions"
    FIRMWARE = "firmware"


@dataclass(frozen=True, slots=True, kw_only=True)
class FacetRow:
    """The settings of a facet, and the call that sets them."""

    settings: tuple[str, ...]  # fields of `PartitionSettings`
    cmdlet: str  # of Hyper-V
    # Of the cmdlet, in their order: by setting, or by a reading that is not a setting and that a creation alone sets.
    parameters: Mapping[str, str]
    while_off: frozenset[str] = frozenset()  # those that Hyper-V changes only while the machine is off
    maybe_off: frozenset[str] = frozenset()  # those for which that depends on host and guest: `diff.disruption`
    capacity: str = ""  # the one that takes capacity of the host; empty: none
    only_changed: bool = False  # a call names only the settings that differ
    in_group: bool = False  # a running control group is given them, too
    in_creation: bool = False  # `CreatePartition` sets them; a new machine needs no step for them


FACETS: Mapping[Facet, FacetRow] = {
    Facet.PROCESSORS: FacetRow(
        settings=("processors",),
        cmdlet="Set-VMProcessor",
        parameters={"processors": "Count"},
        while_off=frozenset({"processors"}),
        capacity="processors",
        in_group=True,
    ),
    Facet.CPU: FacetRow(
        settings=("reserve", "limit", "weight", "quota_period_us", "threads"),
        cmdlet="Set-VMProcessor",
        parameters={"reserve": "Reserve", "limit": "Maximum", "weight": "RelativeWeight"},
        capacity="reserve",
        in_group=True,
    ),
    Facet.MEMORY: FacetRow(
        settings=("memory", "dynamic_memory"),
        cmdlet="Set-VMMemory",
        parameters={"dynamic_memory": "DynamicMemoryEnabled", "memory": "StartupBytes"},
        maybe_off=frozenset({"memory", "dynamic_memory"}),
        capacity="memory",
        in_group=True,
        in_creation=True,
    ),
    Facet.ACTIONS: FacetRow(
        settings=("start_action", "stop_action", "checkpoints"),
        cmdlet="Set-VM",
        parameters={
            "start_action": "AutomaticStartAction",
            "stop_action": "AutomaticStopAction",
            "checkpoints": "CheckpointType",
        },
        while_off=frozenset({"stop_action"}),
        only_changed=True,
    ),
    Facet.FIRMWARE: FacetRow(
        settings=("secure_boot",),
        cmdlet="Set-VMFirmware",
        parameters={"secure_boot": "SecureBootTemplate", "boots_from": "FirstBootDevice"},
        while_off=frozenset({"secure_boot"}),
        in_creation=True,
    ),
}

WHILE_OFF = frozenset(name for row in FACETS.values() for name in row.while_off)
MAYBE_OFF = frozenset(name for row in FACETS.values() for name in row.maybe_off)

LABELS = {
    "name": "name",
    "processors": "processors",
    "reserve": "reserve",
    "limit": "limit",
    "weight": "weight",
    "quota_period_us": "period",
    "threads": "threads",
    "memory": "memory",
    "dynamic_memory": "dynamic memory",
    "generation": "generation",
    "start_action": "automatic start",
    "stop_action": "stop action",
    "checkpoints": "checkpoints",
    "secure_boot": "secure boot",
    "running": "running",
}
"""What each field of `PartitionSettings` is called, in the order in which a plan lists them."""

_OF_GROUPS_ALONE = ("quota_period_us", "threads")
_OF_MACHINES = tuple(name for name in LABELS if name not in _OF_GROUPS_ALONE)
_OF_GENERATION_1 = tuple(name for name in _OF_MACHINES if name != "secure_boot")
_OF_GROUPS = ("name", "processors", "reserve", "limit", *_OF_GROUPS_ALONE, "memory", "start_action", "running")

NO_LIMIT = 100

_TYPES: Mapping[str, Any] = {field.name: field.type for field in fields(PartitionSettings)}


def settings_of(generation: int) -> tuple[str, ...]:
    """Return the settings that a machine of this generation has, or a control group, in the order of `LABELS`."""
    return {NO_GENERATION: _OF_GROUPS, 1: _OF_GENERATION_1}.get(generation, _OF_MACHINES)


def setting_values(settings: PartitionSettings, names: Iterable[str] = LABELS) -> Readings:
    """Return settings by name as JSON has them."""
    values = ((name, getattr(settings, name)) for name in names)
    return {name: value.value if isinstance(value, Enum) else value for name, value in values}


def with_values(settings: PartitionSettings, values: Readings) -> PartitionSettings:
    """Return the settings with these in place of theirs."""
    return replace(settings, **{name: _TYPES[name](value) for name, value in values.items()})


def facet_of(setting: str) -> Facet:
    """Return the facet of a setting that a call sets."""
    return next(facet for facet, row in FACETS.items() if setting in row.settings)


def differing(facet: Facet, before: PartitionSettings, after: PartitionSettings) -> tuple[str, ...]:
    """Return the settings of a facet that differ."""
    return tuple(name for name in FACETS[facet].settings if getattr(before, name) != getattr(after, name))


def refuse_values(facet: Facet, values: Readings) -> None:
    """Refuse values that a facet does not have.

    Raises:
        ValueError: a name is not a setting of it, or a value is of another type than its setting.
    """
    for name, value in values.items():
        if name not in FACETS[facet].settings:
            raise ValueError(f"{name} is not a setting of {facet}")
        kind = _TYPES[name]
        if issubclass(kind, Enum):
            kind(value)
        elif type(value) is not kind:
            raise ValueError(f"{name} is {value!r}, not of type {kind.__name__}")
