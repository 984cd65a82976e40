"""`policy.accept`: findings that are known and accepted, where, why, and until when."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from datetime import date

from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, Places, in_order
from rarms_iac.model.system import Acceptance, Policy, System
from rarms_iac.storage.shipped import finding_page, known_codes, may_be_accepted, severity_line
from rarms_iac.texts.findings import UNKNOWN_NAME, Finding, first_of_each_kind
from rarms_iac.texts.messages import Suggestions

NOT_IN_EFFECT = Finding.warning("RARMS096", "An acceptance has no effect")

REFUSED = Finding.error("RARMS098", "An acceptance names a finding that cannot be accepted")
FINDINGS = (NOT_IN_EFFECT, UNKNOWN_NAME, REFUSED)


def check_acceptances(policy: Policy, places: Places, today: date) -> Iterator[Diagnostic]:
    """Report what is wrong with the acceptances themselves; `today` is a day in UTC."""
    suggestions = Suggestions()
    for acceptance in policy.accept.values():
        page = finding_page(acceptance.code)
        path = ("policy", "accept", acceptance.code)
        if page is None:
            similar, suggestion = suggestions.find(acceptance.code, known_codes())
            yield UNKNOWN_NAME.at(
                places.key(*path),
                "The finding {code} does not exist.{_suggestion}",
                "Correct the id, or remove the acceptance. docs/diagnostics.md lists all findings.",
                code=acceptance.code,
                similar=similar,
                _suggestion=suggestion,
            )
        elif not may_be_accepted(page):
            yield REFUSED.at(
                places.key(*path),
                (
                    "{code} has the severity {severity}. Only warnings, and errors whose page allows it, can be "
                    "accepted."
                ),
                prose(
                    "Remove the acceptance. To correct the cause, see ",
                    command("explain", acceptance.code),
                    ".",
                ),
                code=acceptance.code,
                severity=severity_line(page),
            )
        elif has_expired(acceptance, today):
            yield NOT_IN_EFFECT.at(
                places.value(*path, "until"),
                "{code} was accepted until {until}, but today is {today} (UTC). The finding is shown again.",
                "Correct the cause, or check the reason again and set a later day.",
                code=acceptance.code,
                until=str(acceptance.until),
                today=str(today),
            )


def apply_acceptances(
    diagnostics: Sequence[Diagnostic],
    policy: Policy,
    places: Places,
    today: date,
    *,
    codes: Collection[str] | None = None,
) -> tuple[tuple[Diagnostic, ...], tuple[Diagnostic, ...]]:
    """Split findings into those to show and those that the policy accepts.

    Args:
        diagnostics: all findings of the run, in order.
        today: a day in UTC.
        codes: the codes that this run can find. An acceptance of another code is not called unused: it
            may be meant for another command. None: every code.

    Returns:
        The first of each kind of those to show, in order, and of those that are accepted.
    """
    valid = {acceptance.code: acceptance for acceptance in policy.accept.values() if is_in_force(acceptance, today)}
    accepted = tuple(diagnostic for diagnostic in diagnostics if _covers(valid.get(diagnostic.code), diagnostic))
    shown = [diagnostic for diagnostic in diagnostics if not _covers(valid.get(diagnostic.code), diagnostic)]
    used = {(diagnostic.code, diagnostic.address) for diagnostic in accepted}
    for acceptance in valid.values():
        if codes is None or acceptance.code in codes:
            shown += _unused(acceptance, used, places)
    return first_of_each_kind(in_order(shown)), first_of_each_kind(accepted)


def is_in_force(acceptance: Acceptance, today: date) -> bool:
    """Return whether the finding may be accepted and the last day is not over."""
    page = finding_page(acceptance.code)
    return page is not None and may_be_accepted(page) and not has_expired(acceptance, today)


def with_acceptances_in_force(system: System, today: date) -> System:
    """Return the manifest with the acceptances that count on a day; no search and no check counts on another.

    Args:
        today: a day in UTC.
    """
    in_force = {code: each for code, each in system.policy.accept.items() if is_in_force(each, today)}
    return replace(system, policy=replace(system.policy, accept=in_force))


def has_expired(acceptance: Acceptance, today: date) -> bool:
    """Return whether the last day is over."""
    return acceptance.until is not None and acceptance.until < today


def _covers(acceptance: Acceptance | None, diagnostic: Diagnostic) -> bool:
    return acceptance is not None and bool(diagnostic.address) and diagnostic.address in acceptance.at


def _unused(acceptance: Acceptance, used: Collection[tuple[str, str]], places: Places) -> Iterator[Diagnostic]:
    for number, address in enumerate(acceptance.at):
        if (acceptance.code, address) not in used:
            yield NOT_IN_EFFECT.at(
                places.value("policy", "accept", acceptance.code, "at", number),
                "{code} does not occur at {resource}.",
                (
                    "Correct the address, or remove the acceptance. Without the acceptance, rarms shows the finding "
                    "if it occurs again."
                ),
                code=acceptance.code,
                resource=address,
            )
