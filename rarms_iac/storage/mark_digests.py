"""The digests that marks carry: whether settings and values on a host are still those that rarms wrote."""

from collections.abc import Mapping
from dataclasses import replace

from rarms_iac.model.state import Partition, PartitionSettings, RegistryValue, StartAction, StoppedBy
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


def was_changed(there: Partition, *, by_hand: bool) -> bool:
    """Tell whether a marked partition is not as rarms wrote it.

    Args:
        by_hand: its user starts it, so whether it runs counts for nothing.
    """
    assert there.mark is not None
    is_started = there.mark.stopped_by is not StoppedBy.NO_USER and there.settings.running
    unfixed = replace(there, settings=replace(there.settings, secure_boot=None))
    digests = {_digest_now(partition, by_hand=by_hand) for partition in (there, unfixed)}
    return is_started or there.mark.set not in digests


def _digest_now(there: Partition, *, by_hand: bool) -> str:
    """Return the digest of what is there.

    Whether a partition that is started by hand runs counts for nothing, nor that rarms itself stopped one.
    """
    settings = there.settings
    if there.mark is not None and there.mark.stopped_by is not StoppedBy.NO_USER:
        settings = replace(settings, running=True)
        by_hand = by_hand or settings.start_action is StartAction.NOTHING
    if settings.start_action is StartAction.NOTHING and settings.running and not by_hand:
        return "running"  # no digest: it was written as stopped
    return set_of_settings(replace(settings, running=False) if by_hand else settings)


def set_of_values(values: Mapping[str, RegistryValue]) -> str:
    """12 hex digits of a task class's values, with their types.

    Args:
        values: the registry values that rarms wrote, with their types.

    Returns:
        The `set` of a record.
    """
    return short(digest({name: [value.kind.value, value.data] for name, value in values.items()}))
