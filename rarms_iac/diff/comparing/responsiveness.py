"""The change of SystemResponsiveness."""

from rarms_iac.diff import findings
from rarms_iac.diff.comparing.tasks import not_restorable
from rarms_iac.diff.comparing.wishes import Found, Wishes
from rarms_iac.diff.disruption import disruption_of_task
from rarms_iac.model.changes import RESPONSIVENESS, Create, Delete, Reason, Update
from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.model.state import Responsiveness


def responsiveness_changes(
    after: Responsiveness | None, before: Responsiveness | None, application: str, wishes: Wishes
) -> Found:
    """Unlike a task class of others the value may be taken over: Windows sets it itself, and it is brought back."""
    found = Found()
    record = before.record if before else None
    is_ours = record is not None and record.application == application
    disruption = disruption_of_task("")
    if after is None:
        if before is not None and is_ours and (lost := not_restorable(RESPONSIVENESS, before, None)):
            found.findings.append(lost)
        elif before is not None and is_ours:
            reason = Reason(says=f"the manifest no longer sets it; {_restored(before)}")
            found.changes.append(Delete(address=RESPONSIVENESS, before=before, reason=reason, disruption=disruption))
        return found
    place = wishes.where(RESPONSIVENESS)
    reason = Reason(says="the manifest sets it", place=place)
    if before is None or (record is not None and not is_ours):
        found.findings.append(_undecided(record.application if record else "", place))
    elif before == after:
        found.unchanged += 1
    elif lost := not_restorable(RESPONSIVENESS, before, place):
        found.findings.append(lost)
    elif before.value is None and record is None:
        found.changes.append(Create(address=RESPONSIVENESS, after=after, reason=reason, disruption=disruption))
    else:
        found.changes.append(
            Update(address=RESPONSIVENESS, before=before, after=after, reason=reason, disruption=disruption)
        )
    return found


def _restored(before: Responsiveness) -> str:
    kept = before.record.before if before.record else None
    return (
        f"{', '.join(str(registry_value.data) for registry_value in kept.values())} comes back"
        if kept
        else "it was not there before"
    )


def _undecided(application: str, place: Place | None) -> Diagnostic:
    if application:
        says = f"application {application!r} set it"
        advice = "Take `system_responsiveness` out of one of the two manifests."
    else:
        says = "what it is now could not be read, so it could not be brought back"
        advice = "Look at the host again with the rights of an administrator."
    return findings.RESPONSIVENESS.at(
        place, f"`system_responsiveness` is wanted, but {says}.", advice, address=str(RESPONSIVENESS)
    )
