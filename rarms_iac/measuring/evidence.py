"""Whether a setting was what it says: what the host counted beside what was asked of it. Pure.

P2 is to take all that it reserves; where neither it nor P1 had that time, something else had the processors, and P1 may
have had less than CR. What P1 got of it, because threads that wake up get theirs at once, is the mechanism's own
doing, and in service it is the same. Time that the machine below took makes a component look slower than it is.
"""

from collections.abc import Sequence
from dataclasses import replace

from rarms_iac.model.environment_setup import P1, P2
from rarms_iac.model.loads import Interference, could_take_all, is_steady
from rarms_iac.model.outcomes import TooManyFailures
from rarms_iac.model.setting import Setting, SettingEvidence

TRIES = 3
"""So often a disturbed setting is measured at most."""

STOLEN = 0.05
"""The part of all processors' time that the machine below may take: components are slower then, the safe side."""

SHORT = 0.05
"""The part of all processors' time that neither P1 nor P2 may get of what P2 reserves: what rarms itself consumes is in
it, and about a two-hundredth of each other process that wants a processor. It is taken from both alike."""


def disturbance(evidence: SettingEvidence, processors: int, load_takes: float | None) -> str:
    """Say what disturbed a setting.

    Args:
        evidence: what the host counted.
        processors: LPs of the host.
        load_takes: the LPs that the load in P2 is to take at least; None: it does not want all that it can get.

    Returns:
        Words with numbers; empty: nothing did.
    """
    whole = evidence.elapsed_ms * processors
    if not whole:
        return ""
    stolen = evidence.stolen_ms / whole
    if stolen > STOLEN:
        return f"the machine below took {stolen:.1%} of the processors' time, and {STOLEN:.0%} may be"
    if load_takes is None:
        return ""
    p1, p2 = (evidence.cpu_ms.get(name, 0.0) / evidence.elapsed_ms for name in (P1, P2))
    beyond_reserve = max(0.0, p1 - (processors - load_takes))
    if p2 + beyond_reserve < load_takes - SHORT * processors:
        return f"the load in P2 got {p2:.2f} LP where {load_takes:.2f} are reserved"
    return ""


def with_memory_kills(failed: TooManyFailures, evidence: SettingEvidence | None) -> TooManyFailures:
    """Add the number of processes of a failed component that the kernel killed for memory."""
    killed = 0 if evidence is None else evidence.out_of_memory.get(failed.component, 0)
    return replace(failed, out_of_memory=killed)


def leaves_idle(evidence: SettingEvidence | None, processors: int) -> bool:
    """Tell whether a load that never sleeps by design left processors idle all the same.

    Args:
        evidence: what the host counted; None: it counts nothing.
        processors: LPs of the host.

    Returns:
        Whether neither P1 nor P2 nor the machine below had more than `SHORT` of all processors' time.
    """
    whole = 0.0 if evidence is None else evidence.elapsed_ms * processors
    if evidence is None or not whole:
        return False
    used = evidence.cpu_ms.get(P1, 0.0) + evidence.cpu_ms.get(P2, 0.0) + evidence.stolen_ms
    return used < (1.0 - SHORT) * whole


def is_weak(load: Interference, setting: Setting, processors: int) -> bool:
    """Tell whether what was measured beside a load rests on one that leaves to P1 what others would take.

    Args:
        load: in P2.
        setting: with what the host counted.
        processors: LPs of the host.

    Returns:
        Whether it cannot take all that P2 reserves, or never sleeps by design and was seen to leave some of it idle.
    """
    if not could_take_all(load, processors):
        return True
    return is_steady(load) and leaves_idle(setting.evidence, processors)


def with_evidence(
    setting: Setting, evidence: SettingEvidence, disturbances: Sequence[str], *, undisturbed: bool
) -> Setting:
    """Have a setting say what was counted, and what disturbed its tries; where all were disturbed, it has no verdict.

    Args:
        setting: as it was measured in the last try.
        evidence: of that try.
        disturbances: of each disturbed try, in order.
        undisturbed: whether the last try was none of them.

    Returns:
        The setting with both.
    """
    proof = replace(evidence, disturbances=tuple(disturbances))
    reason = "" if undisturbed else f"disturbed in each of {len(disturbances)} tries: {disturbances[-1]}"
    series = tuple(replace(each, unsettled=each.unsettled or reason, wanders=True) for each in setting.series)
    return replace(setting, series=series, evidence=proof)
