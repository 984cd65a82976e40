"""The digests that marks carry: whether settings and values on a host are still those that rarms wrote."""

from collections.abc import Mapping
from dataclasses import replace

from rarms_iac.model.state import PartitionSettings, RegistryValue, StartAction
from rarms_iac.storage.codec import encode
from rarms_iac.storage.digest import digest, short


def set_of_settings(settings: PartitionSettings) -> str:
    """12 hex digits of what a partition is to be.

    Whether a partition that does not start by itself runs is its user's affair, so it is not part of the digest; nor is
    secure boot where it is not fixed.

    Args:
        settings: as rarms writes them to a host; secure boot only where the manifest fixes it.

    Returns:
        The `set` of a mark: where the host's settings have another one, they were changed with another tool.
    """
    by_hand = settings.start_action is StartAction.NOTHING
    values = encode(replace(settings, running=False) if by_hand else settings)
    assert isinstance(values, dict), "settings are an object"
    if settings.secure_boot is None:
        del values["secure_boot"]
    return short(digest(values))


def set_of_values(values: Mapping[str, RegistryValue]) -> str:
    """12 hex digits of a task class's values, with their types.

    Args:
        values: the registry values that rarms wrote, with their types.

    Returns:
        The `set` of a record.
    """
    return short(digest({name: [value.kind.value, value.data] for name, value in values.items()}))
