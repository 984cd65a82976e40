"""Group policy outranks `-ExecutionPolicy`; other scopes matter where a person starts the script (FACTS 9)."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination
from rarms_iac.model.condition import PolicyScope
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity

FINDING = Finding(code="RARMS241", severity=Severity.WARNING, summary="The execution policy keeps scripts from running")


FORBIDDING = ("Restricted", "AllSigned")


def check(host: Examination) -> Iterator[Diagnostic]:
    """Tells of the policy that decides, where it forbids unsigned scripts: the first scope that sets one."""
    policies = host.condition.policies
    # How the PowerShell that looked was started says nothing of the next one.
    scopes = [
        scope
        for scope in PolicyScope
        if scope is not PolicyScope.PROCESS and policies.get(scope, "Undefined") != "Undefined"
    ]
    if policies and not scopes and host.state.facts.client:
        yield _told(host, "no scope sets an execution policy, and a client Windows then runs no scripts", by_hand=True)
    elif scopes and policies[scopes[0]] in FORBIDDING:
        says = f"the execution policy of {scopes[0].value} is {policies[scopes[0]]}"
        yield _told(host, says, by_hand=not scopes[0].is_group_policy)


def _told(host: Examination, says: str, *, by_hand: bool) -> Diagnostic:
    if by_hand:
        means = "`rarms apply` starts scripts with a policy of their own and is not concerned; a person is."
        advice = "By hand, start them with `powershell -NoProfile -ExecutionPolicy RemoteSigned -File SCRIPT`."
    else:
        means = "Group policy outranks what rarms starts PowerShell with: its scripts do not run there unsigned."
        advice = "Have the group policy allow RemoteSigned on this host, or sign the scripts and run them by hand."
    return FINDING.at(host.place, f"{host.state.facts.name}: {says}. {means}", advice, address=host.address)
