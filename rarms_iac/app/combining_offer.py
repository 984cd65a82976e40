"""Whether combining is worth a try: what is needed, what there is, and what would probably be needed then."""

from dataclasses import dataclass

from rarms_iac.app.errors import UseCaseError
from rarms_iac.app.hosts import Hosts, observe_hosts
from rarms_iac.app.tuning_subject import TuningSubject, bench_of, subject_of_tuning
from rarms_iac.planner.combining.candidates import candidates_of
from rarms_iac.planner.combining.guiding import guide_of
from rarms_iac.planner.combining.oracle import WHOLE, total


@dataclass(frozen=True, slots=True, kw_only=True)
class CombiningOffer:
    """All in per cent of one logical processor."""

    need: int  # what is reserved apart
    have: int
    predicted: int | None  # what would be reserved with the best single compound; None: none would save anything


def combining_offer(hosts: Hosts) -> CombiningOffer | None:
    """Work out whether the measured reservations exceed their hosts, and what one compound would probably save.

    Args:
        hosts: Of one platform; they are looked at.

    Returns:
        None where all fits, or not all is measured.
    """
    try:
        subject = subject_of_tuning(hosts, bench_of(hosts), observe_hosts(hosts))
    except UseCaseError:
        return None
    need = total(subject.cois)
    if need <= subject.capacity:
        return None
    return CombiningOffer(need=need, have=subject.capacity, predicted=_predicted(subject, need))


def _predicted(subject: TuningSubject, need: int) -> int | None:
    candidates = candidates_of(subject.cois, subject.may_share, most=WHOLE)
    guide = guide_of(candidates, subject.predictor)
    savings: list[int] = []
    for mask, candidate in candidates.by_mask.items():
        reserve, members = guide.predicted(mask), set(candidate.coi.members)
        if reserve is not None:
            parts = total(coi for coi in subject.cois if set(coi.members) <= members)
            savings.append(parts - candidate.coi.processors * reserve)
    saved = max(savings, default=0)
    return need - saved if saved > 0 else None
