"""Whether a setting was what it says: what the host counted against what was asked of it. Pure.

P2 is to take all that it reserves; where neither it nor P1 had that time, something else had the processors, and P1 may
have had less than CR. What P1 got of it, because threads that wake up get theirs at once, is the mechanism's own
doing, and in service it is the same. Time that the machine below took makes a component look slower than it is.
"""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

from rarms_iac.measuring.partitions import LoadShare
from rarms_iac.model.capacity import shared_processors
from rarms_iac.model.environment_setup import P1, P2
from rarms_iac.model.host import Host
from rarms_iac.model.loads import Interference, could_take_all, is_steady
from rarms_iac.model.outcomes import TooManyFailures
from rarms_iac.model.setting import SHORT, Setting, SettingEvidence

TRIES = 3
"""So often a disturbed setting is measured at most."""

STOLEN = 0.05
"""The part of all processors' time that the machine below may take: components are slower then, the safe side."""


def disturbance(evidence: SettingEvidence, processors: int, load: LoadShare | None) -> str:
    """Say what disturbed a setting.

    Args:
        load: the share of the load in P2; None: it does not want all that it can get.

    Returns:
        Words with numbers; empty: nothing did.
    """
    whole = evidence.elapsed_ms * processors
    if not whole:
        return ""
    stolen = evidence.stolen_ms / whole
    if stolen > STOLEN:
        return f"the machine below took {100 * stolen:.1f} % of the processors' time, and {100 * STOLEN:.0f} % may be"
    if load is None:
        return ""
    p1, p2 = (evidence.cpu_ms.get(name, 0.0) / evidence.elapsed_ms for name in (P1, P2))
    beyond_reserve = max(0.0, p1 - float(load.others))
    if p2 + beyond_reserve < load.processors - SHORT * processors:
        return f"the load in P2 got {p2:.2f} LP where {float(load.processors):.2f} are reserved"
    return ""


def with_memory_kills(failed: TooManyFailures, evidence: SettingEvidence | None) -> TooManyFailures:
    """Add the number of processes of a failed component that the kernel killed for memory."""
    killed = 0 if evidence is None else evidence.out_of_memory.get(failed.component, 0)
    return replace(failed, out_of_memory=killed)


def idle_share(evidence: SettingEvidence, shared: Fraction) -> float:
    """Return the part of the partitions' time that neither P1 nor P2 nor the machine below had.

    Args:
        shared: LPs that all partitions can use together.

    Returns:
        0 to 1; 0 where nothing was counted.
    """
    whole = evidence.elapsed_ms * float(shared)
    used = evidence.cpu_ms.get(P1, 0.0) + evidence.cpu_ms.get(P2, 0.0) + evidence.stolen_ms
    return max(0.0, 1.0 - used / whole) if whole else 0.0


def leaves_idle(evidence: SettingEvidence | None, shared: Fraction) -> bool:
    """Tell whether a load that never sleeps by design left processors idle all the same: more than `SHORT`.

    Args:
        evidence: what the host counted; None: it counts nothing.
        shared: LPs that all partitions can use together.
    """
    return evidence is not None and idle_share(evidence, shared) > SHORT


def is_weak(load: Interference, setting: Setting, host: Host) -> bool:
    """Tell whether what was measured with a load rests on one that leaves to P1 what others would take.

    Returns:
        Whether it cannot take all that P2 reserves, or never sleeps by design and was seen to leave some of it idle.
    """
    if not could_take_all(load, host.logical_processors):
        return True
    shared = shared_processors(host, host.logical_processors)
    return is_steady(load) and leaves_idle(setting.evidence, shared)


def with_evidence(
    setting: Setting, evidence: SettingEvidence, disturbances: Sequence[str], *, undisturbed: bool
) -> Setting:
    """Have a setting say what was counted, and what disturbed its tries; where all were disturbed, it has no verdict.

    Args:
        setting: as it was measured in the last try.
        disturbances: of each disturbed try, in order.
        undisturbed: whether the last try was none of them.

    Returns:
        The setting with both.
    """
    proof = replace(evidence, disturbances=tuple(disturbances))
    reason = "" if undisturbed else f"disturbed in each of {len(disturbances)} tries: {disturbances[-1]}"
    series = tuple(replace(each, unsettled=each.unsettled or reason, wanders=True) for each in setting.series)
    return replace(setting, series=series, evidence=proof)
