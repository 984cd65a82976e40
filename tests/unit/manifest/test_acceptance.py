from datetime import date

import pytest

from rarms_iac.manifest.acceptance import apply_acceptances, check_acceptances
from rarms_iac.manifest.checks import CODES, run_checks
from rarms_iac.model.diagnostics import Diagnostic, Place, Severity
from rarms_iac.model.system import Acceptance, Policy
from rarms_iac.texts.findings import Finding
from tests.builders import PathPlaces, a_component, a_partition, a_system, codes

WARNING = Finding(
    code="RARMS058", severity=Severity.WARNING, summary="Too little memory or processor time for components"
)
PLACES = PathPlaces()
LAST_DAY = date(2026, 1, 31)


def case(address: str, finding: Finding = WARNING) -> Diagnostic:
    return finding.at(None, "Why.", "What to do.", address=address)


def policy(code: str = "RARMS058", *at: str, until: date | None = LAST_DAY) -> Policy:
    return Policy(accept={code: Acceptance(code=code, at=at, reason="Known.", until=until)})


def test_warning_is_accepted_only_at_its_place() -> None:
    here, there = case("partition/vision"), case("partition/speech")

    kept, accepted = apply_acceptances([here, there], policy("RARMS058", "partition/vision"), PLACES, LAST_DAY)

    assert (kept, accepted) == ((there,), (here,))


@pytest.mark.parametrize(("today", "expired"), [(date(2026, 1, 31), False), (date(2026, 2, 1), True)])
def test_an_acceptance_holds_through_its_last_day(today: date, expired: bool) -> None:
    accepting = policy("RARMS058", "partition/vision")

    kept, accepted = apply_acceptances([case("partition/vision")], accepting, PLACES, today)

    assert codes(check_acceptances(accepting, PLACES, today)) == (["RARMS096"] if expired else [])
    assert (len(kept), len(accepted)) == ((1, 0) if expired else (0, 1))


def test_without_a_last_day_it_holds_for_good() -> None:
    accepting = policy("RARMS058", "partition/vision", until=None)

    _, accepted = apply_acceptances([case("partition/vision")], accepting, PLACES, date(2999, 1, 1))

    assert len(accepted) == 1


def test_each_address_that_silences_nothing_is_told() -> None:
    accepting = policy("RARMS058", "partition/vision", "partition/gone")

    kept, _ = apply_acceptances([case("partition/vision")], accepting, PLACES, LAST_DAY)

    assert [(diagnostic.code, diagnostic.place) for diagnostic in kept] == [
        ("RARMS096", Place(file="rarms.yaml", line=1, column=1, path="policy.accept.RARMS058.at.1"))
    ]


def test_unsearched_acceptance_is_not_unused() -> None:
    accepting = policy("RARMS058", "partition/vision")

    assert apply_acceptances([], accepting, PLACES, LAST_DAY, codes={"RARMS041"}) == ((), ())
    assert codes(apply_acceptances([], accepting, PLACES, LAST_DAY, codes=CODES)[0]) == ["RARMS096"]


@pytest.mark.parametrize(
    ("code", "told"),
    [("RARMS058", []), ("RARMS999", ["RARMS042"]), ("RARMS060", ["RARMS098"]), ("RARMS096", ["RARMS098"])],
)
def test_only_known_warnings_can_be_accepted(code: str, told: list[str]) -> None:
    assert codes(check_acceptances(policy(code, "partition/vision"), PLACES, LAST_DAY)) == told


def test_an_error_is_kept_under_every_policy() -> None:
    error = case("component/vision", Finding(code="RARMS060", severity=Severity.ERROR, summary="x"))

    assert apply_acceptances([error], policy("RARMS060", "component/vision"), PLACES, LAST_DAY) == ((error,), ())


def test_acceptances_use_addresses_of_findings() -> None:
    system = a_system(
        components=[a_component("vision"), a_component("speech")],
        partitions=[a_partition("vision", components=["vision", "speech"], memory="768 MiB")],
        policy=policy("RARMS058", "partition/vision"),
    )

    told = run_checks(system, PLACES, date(2026, 2, 1))
    kept, accepted = apply_acceptances(told, system.policy, PLACES, LAST_DAY, codes=CODES)

    assert codes(told) == ["RARMS058", "RARMS096"]
    assert codes(kept) == ["RARMS096"]
    assert codes(accepted) == ["RARMS058"]
