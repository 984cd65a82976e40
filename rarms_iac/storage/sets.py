"""The `set` of a mark or record: a digest of what rarms last wrote, so that drift is told without other memory."""

from collections.abc import Mapping
from dataclasses import replace

from rarms_iac.model.state import PartitionSettings, RegistryValue, StartAction
from rarms_iac.storage.digest import digest, short


def set_of_settings(settings: PartitionSettings) -> str:
    """12 hex digits of what a partition is to be.

    Whether a partition that does not start by itself runs is its user's affair, so it is not part of the digest.
    """
    by_hand = settings.start_action is StartAction.NOTHING
    return short(digest(replace(settings, running=False) if by_hand else settings))


def set_of_values(values: Mapping[str, RegistryValue]) -> str:
    """12 hex digits of a task class's values, with their types."""
    return short(digest({name: [value.kind.value, value.data] for name, value in values.items()}))
