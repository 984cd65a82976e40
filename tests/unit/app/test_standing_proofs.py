"""A proof says that its layout was changed or undone, and when."""

from dataclasses import replace

import pytest

from rarms_iac.app.standing_proofs import HostNow, compared_with_hosts
from rarms_iac.model.journal import Closing, PastRun, RunKind
from tests.builders_measured import PROOF

PROVEN = replace(PROOF, partition="vision", reserve=60, layout={"vision": 60, "speech": 20}, serial=1, machine="one")


def run(kind: RunKind, plan: str, hour: int) -> PastRun:
    at = f"2026-11-22 {hour}:00:00 UTC"
    return PastRun(run=kind, plan=plan, application="robot", started_by="ann", started_at=at, closing=Closing.DONE)


FIRST, SECOND = run(RunKind.APPLY, "a", 10), run(RunKind.APPLY, "b", 11)
NOW = HostNow(
    name="onboard",
    machine="one",
    serial=1,
    runs=(FIRST,),
    reserves={"vision": 60, "speech": 20},
    changed=frozenset(),
)
LATER = replace(NOW, serial=2, runs=(FIRST, SECOND))


@pytest.mark.parametrize(
    ("host", "outdated"),
    [
        (NOW, ()),
        (LATER, ()),
        (
            replace(LATER, reserves={"vision": 60, "speech": 30}),
            (
                "its layout on onboard was changed at 2026-11-22 11:00:00 UTC: "
                "speech has 30 % of its VPs instead of 20 %",
            ),
        ),
        (
            replace(LATER, reserves={"vision": 60, "drive": 10}),
            ("its layout on onboard was changed at 2026-11-22 11:00:00 UTC: drive is new and speech is gone",),
        ),
        (
            replace(NOW, serial=2, runs=(FIRST, run(RunKind.UNDO, "a", 12)), reserves={}),
            ("its layout on onboard was undone at 2026-11-22 12:00:00 UTC",),
        ),
        (replace(LATER, serial=3, runs=(FIRST, SECOND, run(RunKind.UNDO, "b", 12))), ()),
        (
            replace(NOW, changed=frozenset({"vision"})),
            ("its partition was changed on onboard by another tool after 2026-11-22 10:00:00 UTC",),
        ),
        (
            replace(LATER, serial=3, runs=(FIRST, SECOND, run(RunKind.UNDO, "b", 12)), changed=frozenset({"vision"})),
            (
                "its partition was changed on onboard by the undo at 2026-11-22 12:00:00 UTC "
                "or by another tool after it",
            ),
        ),
        (
            replace(NOW, changed=frozenset({"speech"}), reserves={"vision": 60, "speech": 30}),
            (
                "its layout was changed on onboard by another tool after 2026-11-22 10:00:00 UTC: "
                "speech has 30 % of its VPs instead of 20 %",
            ),
        ),
    ],
)
def test_changed_or_undone_layout_is_told_with_time(host: HostNow, outdated: tuple[str, ...]) -> None:
    [proof] = compared_with_hosts([PROVEN], [host])

    assert proof.outdated == outdated


def test_a_proof_of_another_machine_says_nothing_here() -> None:
    assert compared_with_hosts([replace(PROVEN, machine="two")], [NOW]) == ()
    assert compared_with_hosts([PROVEN], []) == (PROVEN,)
