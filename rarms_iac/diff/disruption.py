"""Disruption: whether a change stops a partition, by its settings and by what the host can do live (windows.md 3)."""

from collections.abc import Mapping
from math import ceil

from rarms_iac.diff.step_context import HostContext
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.state import Facet, Partition, PartitionSettings, RunState
from rarms_iac.model.system import GRACE, Disruption

WINDOWS_10 = 10240
SERVER_2016 = 14393
"""The builds from which the memory of a running static-memory machine may change, on host and guest alike."""


def grace_ms(graces: Mapping[str, Milliseconds], partition: str) -> int:
    """Return how long a partition's guest may take to shut down.

    Args:
        graces: by partition, in ms, as the manifest has them.

    Returns:
        Whole milliseconds, rounded up; the default where the manifest does not know the partition.
    """
    return ceil(graces.get(partition, GRACE))


def changed_facets(before: PartitionSettings, after: PartitionSettings) -> frozenset[Facet]:
    """Tell which facets of the settings differ; whether the partition runs is none of them.

    Returns:
        The facets of which any setting differs; empty where none does.
    """
    pairs = {
        Facet.NAME: (before.name, after.name),
        Facet.PROCESSORS: (before.processors, after.processors),
        Facet.CPU: (
            (before.reserve, before.limit, before.weight, before.quota_period_us),
            (after.reserve, after.limit, after.weight, after.quota_period_us),
        ),
        Facet.MEMORY: ((before.memory, before.dynamic_memory), (after.memory, after.dynamic_memory)),
        Facet.ACTIONS: (
            (before.start_action, before.stop_action, before.checkpoints),
            (after.start_action, after.stop_action, after.checkpoints),
        ),
        Facet.GENERATION: (before.generation, after.generation),
        Facet.SECURE_BOOT: (before.secure_boot, after.secure_boot),
    }
    return frozenset(facet for facet, (old, new) in pairs.items() if old != new)


def needs_off(before: Partition, after: PartitionSettings, context: HostContext) -> bool:
    """Tell whether a setting changes for which the machine must be off.

    These are processors, memory, secure boot and the action at a stop.

    On Linux there is none: a control group takes every value while its processes run. A running machine's memory
    changes live where it is static and both Windows are new enough (windows.md 3).

    Args:
        context: the host's provider and version, and the guest's.

    Returns:
        Whether it must be off; the answer does not depend on whether it runs.
    """
    if context.facts.provider is ProviderKind.LINUX:
        return False
    if before.settings.stop_action is not after.stop_action:
        return True
    changed = changed_facets(before.settings, after)
    if {Facet.PROCESSORS, Facet.SECURE_BOOT} & changed:
        return True
    return bool(Facet.MEMORY in changed and why_memory_needs_off(before, after, context))


def why_memory_needs_off(before: Partition, after: PartitionSettings, context: HostContext) -> str:
    """Tell why memory cannot change while the machine runs (windows.md 3).

    Args:
        context: the host's version, and the guest's.

    Returns:
        The reason as part of a sentence; empty where memory changes live.
    """
    host_since = WINDOWS_10 if context.facts.client else SERVER_2016
    guest_build = context.guest_builds.get(before.id, 0)
    if before.settings.dynamic_memory or after.dynamic_memory:
        return "it is dynamic, or was"
    if context.facts.os_build < host_since:
        return f"the host's Windows has build {context.facts.os_build}, and it takes {host_since}"
    if not guest_build:
        return "its guest tells no build of Windows, and `guest.windows_build` says none"
    if guest_build < WINDOWS_10:
        return f"its guest's Windows has build {guest_build}, and it takes {WINDOWS_10}"
    return ""


def stops(before: Partition, after: PartitionSettings, context: HostContext) -> bool:
    """Tell whether the change stops the partition, for good or for a while.

    Args:
        context: the host's provider and version.

    Returns:
        False where it does not run now.
    """
    running = before.settings.running
    return running and (not after.running or needs_off(before, after, context))


def disruption_of_update(before: Partition, after: PartitionSettings, context: HostContext) -> Disruption:
    """How much a partition's change disturbs: removal, a stop, or nothing that runs.

    Args:
        after: the settings that it is to have; another generation means that it is made again.
        context: which settings of this host change live.

    Returns:
        The least disruption with which this host can make the change.
    """
    if Facet.GENERATION in changed_facets(before.settings, after):
        return Disruption.REMOVAL  # never after creation: it is made again (windows.md 3)
    return Disruption.PARTITION_STOP if stops(before, after, context) else Disruption.LIVE


def disruption_of_task(inside: str) -> Disruption:
    """Return how much a task class disturbs.

    It takes effect when its Windows starts again (windows.md 6.3), and rarms restarts none for it.

    Args:
        inside: the partition whose guest it is in; empty: the host itself.

    Returns:
        When it takes effect: at the next start of the guest, or of the host.
    """
    return Disruption.PARTITION_STOP if inside else Disruption.HOST_RESTART


def can_change_now(before: Partition, after: PartitionSettings, context: HostContext) -> bool:
    """Whether the machine is in a state from which rarms can do the change: off, running, or saved and live.

    What a saved machine is given, it gets once it runs: so it must be wanted running.

    Args:
        context: which settings of this host change live.

    Returns:
        False: nothing may be planned before the machine is off or runs (`not_at_rest`).
    """
    off_needed = needs_off(before, after, context)
    match before.state:
        case RunState.OFF | RunState.RUNNING:
            return True
        case RunState.SAVED:
            gets = changed_facets(before.settings, after) & {Facet.CPU, Facet.MEMORY}
            return not off_needed and (after.running or not gets)
        case RunState.PAUSED | RunState.BUSY | RunState.CRITICAL:
            return not off_needed and after.running == before.settings.running
