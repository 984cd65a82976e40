"""Certificates as a plan holds them: what the checker accepted, with the names that it is about, as JSON."""

import json
from collections.abc import Mapping, Sequence

from rarms_iac.planner.packing.program import Problem

CERTIFICATE_UP_TO = 200_000
"""Characters of a certificate that a plan holds: 30 partitions on 50 hosts need no more."""


def certificate_of(problem: Problem, claim: Mapping[str, object], items: Sequence[str], hosts: Sequence[str]) -> str:
    """The certificate as JSON; empty where the checker does not accept it, or it is too long for a plan.

    Args:
        problem: what was packed, or cannot be.
        claim: what is claimed of it.
        items: names of the partitions, in the problem's order.
        hosts: names of the hosts, in the problem's order.
    """
    from rarms_iac.planner.certifying.checker import Wrong, check
    from rarms_iac.planner.certifying.claim import problem_data

    data = problem_data(problem)
    try:
        check(data, claim)
    except Wrong:
        return ""
    told = {"partitions": list(items), "hosts": list(hosts), "problem": data, "claim": claim}
    text = json.dumps(told, separators=(",", ":"))
    return text if len(text) <= CERTIFICATE_UP_TO else ""
