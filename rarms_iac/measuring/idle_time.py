"""The processes and limits that kept a load from using the processors that components left idle."""

from rarms_iac.measuring.evidence import idle_share
from rarms_iac.model.capacity import shared_processors
from rarms_iac.model.diagnostics import Facts
from rarms_iac.model.environment_setup import P1, P2
from rarms_iac.model.host import Host
from rarms_iac.model.quantities import show_duration, show_processors
from rarms_iac.model.setting import ALL_PARTITIONS, SettingEvidence
from rarms_iac.model.wording import in_a_row

LEAST_SHARE = 0.01
"""Part of the processor time from which a process or limit is listed."""

_LIMITS = {P1: "the limit of P1", P2: "the limit of P2", ALL_PARTITIONS: "the limit of all partitions"}


def describe_idle(load: str, evidence: SettingEvidence, host: Host) -> str:
    """Describe the processor time that a load did not use, and the processes that used it.

    Returns:
        Sentences.
    """
    shared = shared_processors(host, host.logical_processors)
    whole_ms = evidence.elapsed_ms * float(shared)
    idle = f"{load} left {100 * idle_share(evidence, shared):.0f} % of {show_processors(shared)}."
    had = [
        f"{work.name}{f' in {work.group}' if work.group else ''} had {100 * work.cpu_ms / whole_ms:.0f} %"
        for work in evidence.others
        if work.cpu_ms >= LEAST_SHARE * whole_ms
    ]
    limits = [
        f"{_LIMITS[name]} stopped its threads for {show_duration(time_ms)}, added up over the processors"
        for name, time_ms in sorted(evidence.throttled_ms.items())
        if name in _LIMITS and time_ms >= LEAST_SHARE * evidence.elapsed_ms
    ]
    reasons = [f"Of {show_processors(shared)}, {in_a_row(had)}."] if had else []
    reasons += [f"{reason[0].upper()}{reason[1:]}." for reason in limits]
    return " ".join((idle, *(reasons or ["No other process and no limit had it: the load waited."])))


def idle_facts(evidence: SettingEvidence, host: Host) -> Facts:
    """Return the numbers behind `describe_idle`."""
    return {
        "idle_percent": 100 * idle_share(evidence, shared_processors(host, host.logical_processors)),
        "processes": tuple(work.name for work in evidence.others),
        "groups": tuple(work.group for work in evidence.others),
        "throttled_ms": sum(evidence.throttled_ms.values()),
    }
