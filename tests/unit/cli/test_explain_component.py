"""`rarms explain COMPONENT`, from manifest and data logs to text and exit code."""

import json
from pathlib import Path

from tests.measuring import leave_log
from tests.unit.cli.running import rarms
from tests.unit.cli.test_data_logs import MEANS, edit, here, measure
from tests.unit.views.test_json import check

__all__ = ["here"]

SECOND_HOST = """\
  workshop:
    provider: simulated
    platform: two-core
    logical_processors: 2
    memory: 256 MiB

components:
"""


def test_a_walk_leads_from_the_apt_to_the_per_cent(here: Path) -> None:
    measure(here, MEANS)
    edit(here / "rarms.yaml", "components:\n", SECOND_HOST)

    answer = rarms("explain", "vision", "-f", str(here))

    assert answer.code == 0, answer.err
    assert max(map(len, answer.lines)) <= 80
    said = " ".join(answer.out.split())
    for part in (
        "mean_response_time at most 100 ms",
        "measurements/two-core/vision/busy-loop.jsonl, 6 settings, measured 2026-01-01T00:00:00Z",
        "at 62 %: mean_response_time 97 ms",
        "CR 62 %: the least whole per cent of P1's 2 virtual processors",
        "1.24 LP, 62 % of onboard",
        "62 % of each of its 2 virtual processors (whole per cent are the provider's grain): 1.24 LP, nothing is lost",
        "left over: 0.76 LP (38 %)",
        "limit 100 %: left open: a cap would falsify what was measured",
        "weight 100: policy.headroom is by_criticality, and all are equally critical",
        "61 %, one less: mean_response_time 105 ms (measured)",
        "on workshop: it would reserve 1.24 LP there too; it does not fit",
    ):
        assert part in said


def test_what_lies_between_two_settings_is_said_to(here: Path) -> None:
    measure(here, {40: 160.0, 60: 104.0, 70: 88.0})

    answer = rarms("explain", "vision", "--json", "-f", str(here))

    check(answer.out)
    document = json.loads(answer.out)
    assert (document["cr"], document["interpolated"], document["reserve"], document["fits"]) == (63, True, 63, True)
    verdicts = next(step["says"] for step in document["steps"] if step["topic"] == "setting and verdict")
    assert any("between the settings at 60 % and 70 %, not measured itself" in one for one in verdicts)


def test_a_fixed_reserve_that_does_not_fit_is_walked_to_its_end(here: Path) -> None:
    fixed = "    memory: 512 MiB\n    cpu: { reserve: 1.25 LP }\n    processors: 2\n"
    edit(here / "rarms.yaml", "    memory: 512 MiB\n", fixed)
    speech = "  speech:\n    criticality: 10\n    memory: 64 MiB\n    cpu: { reserve: 60 % }\n  vision:\n"
    edit(here / "rarms.yaml", "  vision:\n", speech)

    answer = rarms("explain", "vision", "-f", str(here))

    assert answer.code == 4
    said = " ".join(answer.out.split())
    assert "none is needed: the manifest, for vision, fixes the reserve" in said
    assert "63 % of each of its 2 virtual processors (whole per cent are the provider's grain): 1.26 LP" in said
    assert "rounded up by 0.01 LP" in said
    assert "weight 200: policy.headroom is by_criticality: criticality 2 of 2" in said
    assert "Reservations exceed the platform (RARMS014)" in said


def test_who_shares_a_partition_is_named_with_the_reason(here: Path) -> None:
    speech = "  speech:\n    criticality: 10\n    memory: 64 MiB\n    together: [vision]\n  vision:\n"
    edit(here / "rarms.yaml", "  vision:\n", speech)
    leave_log(here, ["speech", "vision"], [])
    edit(here / "rarms.yaml", "    memory: 512 MiB\n", "    memory: 512 MiB\n    cpu: { reserve: 40 % }\n")

    answer = rarms("explain", "speech", "-f", str(here))

    assert answer.code == 0, answer.err
    said = " ".join(answer.out.split())
    assert "speech has none: nothing says how well it must do" in said
    assert "vision: speech is combined with vision (criticality 30)" in said
    assert "speech says that it must be together with vision" in said


def test_what_combining_saves_and_what_else_was_measured_stands_with_the_rejected(here: Path) -> None:
    speech = "  speech:\n    criticality: 10\n    memory: 64 MiB\n    cpu: { reserve: 45 % }\n  vision:\n"
    edit(here / "rarms.yaml", "  vision:\n", speech)
    measure(here, MEANS)
    manifest = (here / "rarms.yaml").read_text(encoding="utf-8")
    both = "\npartitions:\n  vision: { components: [vision, speech], cpu: { reserve: 70 % } }\n"
    (here / "rarms.yaml").write_text(manifest + both, encoding="utf-8", newline="\n")

    answer = rarms("explain", "speech", "-f", str(here))

    assert answer.code == 0, answer.err
    said = " ".join(answer.out.split())
    assert "as the manifest's partition vision fixes it" in said
    assert "the manifest's `partitions` puts them together" in said
    assert "apart: speech 0.9 LP and vision 1.24 LP, 2.14 LP instead of 1.4 LP; that does not fit" in said


def test_what_is_no_component_and_what_needs_a_measurement_say_so(here: Path) -> None:
    for word, meant in (("visoin", "vision"), ("RAMS014", "RARMS014")):
        unknown = rarms("explain", word, "-f", str(here))
        says = f'The manifest has no component "{word}", and no finding is called so. Did you mean "{meant}"?'
        assert unknown.code == 64
        assert says in " ".join(unknown.err.split())

    unmeasured = rarms("explain", "vision", "-f", str(here))
    assert unmeasured.code == 4
    assert "error[RARMS100]" in unmeasured.err
