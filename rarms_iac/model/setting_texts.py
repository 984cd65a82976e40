"""The settings of a partition in words, in the units of a manifest, for findings and views."""

from enum import Enum

from rarms_iac.model.quantities import guaranteed, show_period, show_processors, write_bytes
from rarms_iac.model.state import PartitionSettings, StartAction

LABELS = {
    "name": "name",
    "processors": "processors",
    "reserve": "reserve",
    "limit": "limit",
    "weight": "weight",
    "quota_period_us": "period",
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

NO_LIMIT = 100

_AUTOMATIC_START = {
    StartAction.NOTHING: "no",
    StartAction.START_IF_RUNNING: "if it ran",
    StartAction.START: "yes",
}


def setting_text(field: str, settings: PartitionSettings) -> str:
    """Write a field of the settings: `0.6 LP`, `512 MiB`, `yes`.

    Args:
        field: one of `LABELS`.
        settings: reserve and limit are of all virtual processors together.
    """
    value = getattr(settings, field)
    match field:
        case "limit" if value == NO_LIMIT:
            return "none"
        case "reserve" | "limit":
            return show_processors(guaranteed(value, settings.processors))
        case "memory":
            return write_bytes(value) if value else "no limit"
        case "quota_period_us":
            return show_period(value)
        case "start_action":
            return _AUTOMATIC_START[value]
        case _:
            return _plain(value)


def _plain(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return str(value.value).replace("_", " ") if isinstance(value, Enum) else str(value)
