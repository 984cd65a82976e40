"""Findings of what a setting's counts show: threads without their priority, and messages of another clock."""

import pytest

from rarms_iac.measuring.other_work import work_of_evidence
from rarms_iac.model.series import HeardMessages
from rarms_iac.model.setting import SettingEvidence, ThreadsSeen
from tests.builders import PathPlaces


@pytest.mark.parametrize(
    ("seen", "detail", "advice"),
    [
        (
            ThreadsSeen(unmatched=("control_loop",), names=("arm_driver", "logger")),
            "arm: No thread has the name control_loop. Its threads: arm_driver, logger.",
            "Correct `threads`",
        ),
        (
            ThreadsSeen(refused="arm_driver: Operation not permitted"),
            "arm: The kernel refused the priority to arm_driver: Operation not permitted.",
            "Run rarms as root",
        ),
    ],
)
def test_threads_without_priority_are_named(seen: ThreadsSeen, detail: str, advice: str) -> None:
    (found,) = work_of_evidence(["arm"], [SettingEvidence(threads={"arm": seen})], PathPlaces(), [])

    assert (found.code, found.detail) == ("RARMS395", detail)
    assert str(found.advice).startswith(advice)
    assert found.values["unmatched"] == seen.unmatched


@pytest.mark.parametrize(
    ("ahead_ms", "side"), [(3000.0, "3 s ahead of"), (-20_000.0, "20 s behind"), (4.0, ""), (-9_000.0, "")]
)
def test_stamps_of_another_clock_are_named(ahead_ms: float, side: str) -> None:
    heard = HeardMessages(input="/image", inputs=9, ahead_ms=ahead_ms)

    found = list(work_of_evidence(["eyes"], [SettingEvidence(messages={"eyes": heard})], PathPlaces(), []))

    assert [each.code for each in found] == ["RARMS430"] * bool(side)
    assert all(f"the stamps of /image are {side} the clock of this machine" in each.detail for each in found)


def test_simulated_time_is_named() -> None:
    heard = HeardMessages(input="/image", inputs=9, ahead_ms=3000.0, simulated_time=True)

    (found,) = work_of_evidence(["eyes"], [SettingEvidence(messages={"eyes": heard})], PathPlaces(), [])

    assert (found.code, found.values["component"]) == ("RARMS431", "eyes")
