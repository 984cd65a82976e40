"""A proof says that its layout was changed or undone, and when."""

from dataclasses import replace

import pytest

from rarms_iac.app.drift import ComparedHost
from rarms_iac.app.report import compared_with_hosts
from rarms_iac.diff.drift import DriftKind, ResourceDrift
from rarms_iac.model.changes import Address
from rarms_iac.model.journal import Closing, PastRun, RunKind
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import State
from tests.builders import a_host
from tests.builders_measured import a_proof
from tests.builders_plan import facts, partition, settings

PROVEN = a_proof(partition="vision", reserve=60, layout={"vision": 60, "speech": 20}, serial=1, machine="one")


def run(kind: RunKind, plan: str, hour: int) -> PastRun:
    at = f"2026-11-22 {hour}:00:00 UTC"
    return PastRun(run=kind, plan=plan, application="robot", started_by="ann", started_at=at, closing=Closing.DONE)


FIRST, SECOND = run(RunKind.APPLY, "a", 10), run(RunKind.APPLY, "b", 11)
LAYOUT = {"vision": 60, "speech": 20}


def now(
    *, serial: int = 1, runs: tuple[PastRun, ...] = (FIRST,), reserves: dict[str, int] = LAYOUT, changed: str = ""
) -> ComparedHost:
    partitions = tuple(partition(settings(name, reserve=reserve)) for name, reserve in reserves.items())
    state = State(facts=replace(facts(), id="one"), partitions=partitions, serials={"robot": serial})
    drift = ResourceDrift(address=Address(partition=changed), drift=DriftKind.HOST_CHANGED, message="by hand")
    return ComparedHost(
        seen=SeenHost(host=a_host(), application="robot", state=state),
        drifted=(drift,) if changed else (),
        runs=runs,
    )


TWO = (FIRST, SECOND)


@pytest.mark.parametrize(
    ("host", "outdated"),
    [
        (now(), ()),
        (now(serial=2, runs=TWO), ()),
        (
            now(serial=2, runs=TWO, reserves={"vision": 60, "speech": 30}),
            (
                "its layout on onboard was changed at 2026-11-22 11:00:00 UTC: "
                "speech has 30 % of its VPs instead of 20 %",
            ),
        ),
        (
            now(serial=2, runs=TWO, reserves={"vision": 60, "drive": 10}),
            ("its layout on onboard was changed at 2026-11-22 11:00:00 UTC: drive is new and speech is gone",),
        ),
        (
            now(serial=2, runs=(FIRST, run(RunKind.UNDO, "a", 12)), reserves={}),
            ("its layout on onboard was undone at 2026-11-22 12:00:00 UTC",),
        ),
        (now(serial=3, runs=(*TWO, run(RunKind.UNDO, "b", 12))), ()),
        (
            now(changed="vision"),
            ("its partition was changed on onboard by another tool after 2026-11-22 10:00:00 UTC",),
        ),
        (
            now(serial=3, runs=(*TWO, run(RunKind.UNDO, "b", 12)), changed="vision"),
            (
                "its partition was changed on onboard by the undo at 2026-11-22 12:00:00 UTC "
                "or by another tool after it",
            ),
        ),
        (
            now(changed="speech", reserves={"vision": 60, "speech": 30}),
            (
                "its layout was changed on onboard by another tool after 2026-11-22 10:00:00 UTC: "
                "speech has 30 % of its VPs instead of 20 %",
            ),
        ),
    ],
)
def test_changed_or_undone_layout_is_told_with_time(host: ComparedHost, outdated: tuple[str, ...]) -> None:
    [proof] = compared_with_hosts([PROVEN], [host])

    assert proof.outdated == outdated


def test_a_proof_of_another_machine_says_nothing_here() -> None:
    assert compared_with_hosts([a_proof(machine="two")], [now()]) == ()
    assert compared_with_hosts([PROVEN], []) == (PROVEN,)
