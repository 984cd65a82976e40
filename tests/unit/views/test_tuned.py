"""What tuning claims of other layouts: in the text, in JSON and in the trail."""

import json
from dataclasses import replace

import pytest

from rarms_iac.app.report_model import PlatformTuning
from rarms_iac.app.tune import TuningResult
from rarms_iac.cli.tuning_log import run_of
from rarms_iac.planner.combining.oracle import Asked
from rarms_iac.views.reports.spreadsheet import trail_rows
from rarms_iac.views.tuned import tuned_json, tuned_text
from tests.unit.views.test_json import check


def tuned(*, proved: bool, probability: float | None) -> TuningResult:
    return TuningResult(
        strategy="default",
        ending="successful",
        message="successful",
        capacity=200,
        before=230,
        after=190,
        proved=proved,
        probability=probability,
        contradictions=(),
        partitions=(),
        trail=(
            Asked(members=("a", "b"), reserve=40, worse=("a",), predicted=44),
            Asked(members=("a", "b"), reserve=45, worse=(), predicted=44),
        ),
    )


@pytest.mark.parametrize(
    ("proved", "probability", "claim"),
    [(True, None, "proved"), (False, 0.95, "not proved, at least 95 %"), (False, None, "not proved")],
)
def test_the_claim_is_the_same_everywhere(proved: bool, probability: float | None, claim: str) -> None:
    ended = tuned(proved=proved, probability=probability)
    told, run = tuned_json(ended, ()), run_of(ended)
    check(told)
    assert run is not None
    _, *rows = trail_rows([PlatformTuning(platform="two-core", run=run)])

    assert json.loads(told)["claim"] == claim
    assert [row[-2:] for row in rows] == [(44, ""), (44, claim)]
    text = tuned_text(ended, 80)
    assert ("No other layout is better, if" in text) is proved
    assert ("Not proved, at least 95 %" in text) is (probability is not None)


def test_where_nothing_was_predicted_there_is_no_column_of_it() -> None:
    ended = tuned(proved=False, probability=None)
    nothing = tuple(replace(one, predicted=None) for one in ended.trail)

    assert tuned_text(ended, 80).splitlines()[:2] == [
        "setting  CR    predicted  verdict",
        "a+b      40 %  44 %       not met for sure by a",
    ]
    assert tuned_text(replace(ended, trail=nothing), 80).splitlines()[:2] == [
        "setting  CR    verdict",
        "a+b      40 %  not met for sure by a",
    ]
