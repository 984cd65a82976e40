"""Hosts that nobody who is in the way may use yet: only because nothing was measured there."""

from collections.abc import Sequence

from rarms_iac.model.system import Host
from rarms_iac.planner import findings
from rarms_iac.planner.groups import Group
from rarms_iac.planner.problem import Problem, by_name
from rarms_iac.planner.reservations import NotMeasured, rests_on_a_log


def to_be_measured_elsewhere(problem: Problem, conflict: Sequence[str]) -> str | None:
    """The hosts on which measuring may help those who conflict; None: there is none."""
    groups = [one for one in problem.groups if one.name in conflict]
    hosts = [
        one.name for one in by_name(problem.system.hosts) if any(_is_unknown(group, one, problem) for group in groups)
    ]
    if not hosts:
        return None
    options = " ".join(f"--host {name}" for name in hosts)
    return f"measuring on {' and '.join(hosts)} may help: nothing says what they need there (`rarms measure {options}`)"


def _is_unknown(group: Group, host: Host, problem: Problem) -> bool:
    if host.name in problem.claims[group.name] or not rests_on_a_log(group):
        return False
    if any(one.hosts is not None and host.name not in one.hosts for one in group.members):
        return False
    answer = problem.reservations.reservation(group.members, host)
    return isinstance(answer, NotMeasured) and answer.code == findings.UNMEASURED.code
