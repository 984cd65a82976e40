"""`policy.accept`: findings that are known and borne, where, why, and until when (DESIGN section 9)."""

from collections.abc import Collection, Iterator, Sequence
from datetime import date

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity, in_order
from rarms_iac.model.system import Acceptance, Policy
from rarms_iac.model.wording import suggestion
from rarms_iac.storage.finding_pages import finding_page, known_codes, may_be_accepted, severity_line

EXPIRED = Finding(code="RARMS095", severity=Severity.WARNING, summary="An acceptance has expired", acceptable=False)
UNUSED = Finding(code="RARMS096", severity=Severity.WARNING, summary="An acceptance is not used", acceptable=False)
UNKNOWN = Finding(code="RARMS097", severity=Severity.ERROR, summary="An acceptance of a finding that does not exist")
REFUSED = Finding(code="RARMS098", severity=Severity.ERROR, summary="A finding that cannot be accepted")
FINDINGS = (EXPIRED, UNUSED, UNKNOWN, REFUSED)


def check_acceptances(policy: Policy, places: Places, today: date) -> Iterator[Diagnostic]:
    """What is wrong with the acceptances themselves, whatever the run finds; `today` is a day in UTC."""
    for acceptance in policy.accept.values():
        page = finding_page(acceptance.code)
        where = ("policy", "accept", acceptance.code)
        if page is None:
            yield UNKNOWN.at(
                places.key(*where),
                f"There is no finding {acceptance.code}.{suggestion(acceptance.code, known_codes())}",
                "Correct the id, or remove the acceptance; docs/diagnostics.md lists every finding.",
            )
        elif not may_be_accepted(page):
            yield REFUSED.at(
                places.key(*where),
                f"{acceptance.code} has the severity {severity_line(page)}: only warnings can be accepted, "
                "and errors where "
                "their page says so.",
                f"Remove the acceptance; `rarms explain {acceptance.code}` says how to mend what it finds.",
            )
        elif has_expired(acceptance, today):
            yield EXPIRED.at(
                places.value(*where, "until"),
                f"{acceptance.code} was accepted until {acceptance.until}, and today is {today} (UTC): "
                "it is shown again.",
                "Mend what it finds, or look at the reason again and set a later day.",
            )


def apply_acceptances(
    diagnostics: Sequence[Diagnostic],
    policy: Policy,
    places: Places,
    today: date,
    *,
    codes: Collection[str] | None = None,
) -> tuple[tuple[Diagnostic, ...], tuple[Diagnostic, ...]]:
    """What is kept, with a finding for every acceptance that silenced nothing; and what is accepted.

    Args:
        diagnostics: everything that the run found, in order.
        policy: the manifest's.
        places: where the manifest says so.
        today: a day in UTC.
        codes: the codes that this run could have found. An acceptance of another code is not called unused: it
            may be meant for another command. None: every code.
    """
    valid = {acceptance.code: acceptance for acceptance in policy.accept.values() if silences(acceptance, today)}
    accepted = tuple(diagnostic for diagnostic in diagnostics if _covers(valid.get(diagnostic.code), diagnostic))
    kept = [diagnostic for diagnostic in diagnostics if not _covers(valid.get(diagnostic.code), diagnostic)]
    used = {(diagnostic.code, diagnostic.address) for diagnostic in accepted}
    for acceptance in valid.values():
        if codes is None or acceptance.code in codes:
            kept += _unused(acceptance, used, places)
    return in_order(kept), accepted


def silences(acceptance: Acceptance, today: date) -> bool:
    """Whether it is in force: a finding that may be accepted, on a day up to and including its last."""
    page = finding_page(acceptance.code)
    return page is not None and may_be_accepted(page) and not has_expired(acceptance, today)


def has_expired(acceptance: Acceptance, today: date) -> bool:
    """Whether its last day is over."""
    return acceptance.until is not None and acceptance.until < today


def _covers(acceptance: Acceptance | None, diagnostic: Diagnostic) -> bool:
    return acceptance is not None and bool(diagnostic.address) and diagnostic.address in acceptance.at


def _unused(acceptance: Acceptance, used: Collection[tuple[str, str]], places: Places) -> Iterator[Diagnostic]:
    for number, address in enumerate(acceptance.at):
        if (acceptance.code, address) not in used:
            yield UNUSED.at(
                places.value("policy", "accept", acceptance.code, "at", number),
                f"{acceptance.code} does not occur at {address}.",
                "Remove it, so that the finding is seen should it come back; or correct the address.",
            )
