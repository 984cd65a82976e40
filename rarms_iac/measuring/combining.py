"""After levels were chosen: where they need more than there is, components are combined, if the user wants it.

Begin at `combine_if_wanted`. `combining_offer` says what is needed, what there is, and what would probably be needed.
"""

from dataclasses import dataclass
from typing import Protocol

from rarms_iac.app.control import Control
from rarms_iac.app.hosts import Hosts, observe_hosts
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.measuring.session import stopped_to_measure
from rarms_iac.measuring.tune import TuneRequest, TuningPrompt, TuningResult, tune_components
from rarms_iac.measuring.tuning_subject import LayoutFit, TuningSubject, subject_of_tuning, tuning_host
from rarms_iac.planner.combining.candidates import candidates_of
from rarms_iac.planner.combining.oracle import WHOLE, total
from rarms_iac.planner.combining.questions import expected
from rarms_iac.planner.planning_findings import NOT_MET, PLATFORMS, STALE, UNMEASURED

NO_SUBJECT = {finding.code for finding in (UNMEASURED, STALE, NOT_MET, PLATFORMS)}
"""Codes of findings with which there is nothing to combine yet; `plan` and `tune` tell of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CombiningOffer:
    """All in per cent of one logical processor."""

    need: int  # what is reserved apart, by all partitions
    have: int
    predicted: int | None  # what would be reserved with the best single compound; None: none would save anything


class CombiningPrompt(TuningPrompt, Protocol):
    """Asks whether components are combined, which of them, and whether that is written."""

    def combines(self, offer: CombiningOffer) -> bool:
        """Show what is needed and what there is, and tell whether to combine.

        Args:
            offer: amounts in per cent of one logical processor.

        Returns:
            Whether the search begins.
        """


def combine_if_wanted(
    hosts: Hosts, request: TuneRequest, prompt: CombiningPrompt, control: Control
) -> TuningResult | None:
    """Offer to combine components where their reservations exceed the hosts, and write what is found and confirmed.

    Args:
        hosts: Of one platform, with the manifest as it is now.

    Returns:
        What tuning came to; None where nothing had to be combined, or it was not wanted.

    Raises:
        SessionEnded: The user asked for an end at a question.
        UseCaseError: As `tune_components`.
    """
    offer = combining_offer(hosts)
    if offer is None or not prompt.combines(offer):
        return None
    return tune_components(hosts, request, control, prompt)


def combining_offer(hosts: Hosts) -> CombiningOffer | None:
    """Work out whether the measured reservations exceed their hosts, and what one compound would probably save.

    Args:
        hosts: Of one platform; they are looked at.

    Returns:
        None where all fits, or where tuning has no subject yet: not all is measured, or the hosts differ in platform.

    Raises:
        UseCaseError: A host cannot be looked at (failed), or a data log is damaged (negative).
    """
    try:
        application = hosts.system.application.name
        states = {name: stopped_to_measure(state, application) for name, state in observe_hosts(hosts).items()}
        subject = subject_of_tuning(hosts, tuning_host(hosts), states)
    except UseCaseError as problem:
        if {finding.code for finding in problem.findings} <= NO_SUBJECT:
            return None
        raise
    need = total(subject.cois) + subject.fixed
    if LayoutFit(subject=subject).fits(subject.cois):
        return None
    return CombiningOffer(need=need, have=subject.capacity, predicted=_predicted(subject, need))


def _predicted(subject: TuningSubject, need: int) -> int | None:
    candidates = candidates_of(subject.cois, subject.may_share, most=WHOLE)
    saved = max(
        (
            total(candidates.members(mask)) - candidate.coi.taken_processors * reserve
            for mask, candidate in candidates.by_mask.items()
            if (reserve := expected(candidate, subject.predict)) is not None
        ),
        default=0,
    )
    return need - saved if saved > 0 else None
