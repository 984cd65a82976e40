"""What tuning claims of other layouts: in the text, in JSON and in the trail."""

import json
from dataclasses import replace

import pytest

from rarms_iac.app.report_model import PlatformTuning
from rarms_iac.measuring.tune import TuningResult
from rarms_iac.storage.datalog.decisions import TrailSetting, TunedPartition
from rarms_iac.views.console import render
from rarms_iac.views.json_output import json_of
from rarms_iac.views.reports.tables import trail_table
from rarms_iac.views.tune import tuned_text
from tests.builders_measured import TUNED
from tests.unit.views.test_json import check


def tuned(*, proved: bool) -> TuningResult:
    run = replace(
        TUNED,
        before=230,
        after=190,
        proved=proved,
        partitions=(),
        trail=(
            TrailSetting(components=("a", "b"), reserve=40, worse=("a",), predicted=44),
            TrailSetting(components=("a", "b"), reserve=45, worse=(), predicted=44),
        ),
        written=False,
    )
    return TuningResult(platform="two-core", hosts=("onboard",), run=run, findings=())


def test_table_keeps_to_80_columns_with_long_names() -> None:
    names = ("navigation-and-mapping", "obstacle-avoidance-fast")
    partition = TunedPartition(name="+".join(names)[:40], components=names, processors=2, reserve=23, parts=82)
    result = tuned(proved=True)
    run = replace(result.run, partitions=(partition,))

    shown = render(tuned_text(replace(result, run=run)))

    assert max(map(len, shown.splitlines())) <= 80
    assert all(name in shown for name in names)


@pytest.mark.parametrize(
    ("proved", "claim"),
    [(True, "proved"), (False, "not proved")],
)
def test_the_claim_is_the_same_everywhere(proved: bool, claim: str) -> None:
    ended = tuned(proved=proved)
    answer = json_of(ended)
    check(answer)
    _, *rows = trail_table([PlatformTuning(platform="two-core", run=ended.run)]).for_files()

    assert json.loads(answer)["run"]["claim"] == claim
    assert [row[-2:] for row in rows] == [(44, ""), (44, claim)]
    text = render(tuned_text(ended))
    assert ("No other layout of these components is better by `policy.minimise`" in text) is proved


def test_written_layout_is_to_be_planned_next() -> None:
    result = tuned(proved=True)

    assert "Next: " not in render(tuned_text(result))
    assert render(tuned_text(replace(result, files=("rarms.yaml",)))).endswith("Next: `rarms plan`\n")
