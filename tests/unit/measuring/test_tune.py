"""`rarms tune`, from words to the manifest's `partitions`, on the simulated host."""

import json
import re
from collections.abc import Iterator, Sequence
from contextlib import chdir
from dataclasses import replace
from pathlib import Path

import openpyxl
import pytest

from rarms_iac.storage.datalog.decisions import last_chosen, read_entries
from rarms_iac.storage.datalog.files import configuration_path
from rarms_iac.storage.snapshot_file import read_snapshot
from tests.builders_measured import a_setting
from tests.fluid import without_scheduler
from tests.measuring import leave_curves, leave_log, leave_logs, steady
from tests.unit.cli.running import rarms
from tests.unit.views.test_json import check

MANIFEST = """\
# A robot that asks for more than it has.
schema: rarms/v1

application: { name: robot }
policy: { interference: busy-loop }

hosts:
  onboard: { logical_processors: 2, memory: 4 GiB }

components:
  vision: # what it sees
    criticality: 30
    apt:
      mean_response_time: { at_most: 41 ms }
    memory: 512 MiB
    processors: 2
    cpu: { reserve: measured }
    simulation: { work: 20 ms, varies: 2 % }

  paths:
    criticality: 20
    apt:
      mean_response_time: { at_most: 65 ms }
    memory: 512 MiB
    processors: 2
    cpu: { reserve: measured }
    simulation: { work: 20 ms, varies: 2 % }

  video:
    criticality: 10
    apt:
      mean_response_time: { at_most: 75 ms }
    memory: 512 MiB
    processors: 2
    cpu: { reserve: measured }
    simulation: { work: 20 ms, varies: 2 % }
"""


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Path]:
    """The folder where we are: a robot with data logs of its components one by one, which do not fit."""
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    leave_curves(tmp_path, 20.0, (20, 25, 26, 27, 28, 29, 30, 31, 32, 36, 40, 44, 47, 48, 49, 50, 51, 60))
    with chdir(tmp_path), without_scheduler():
        yield tmp_path


def test_manifest_that_does_not_fit_is_tuned(tmp_path: Path) -> None:
    """With the scheduler: in the fluid model a compound needs exactly what its neediest part does."""
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    leave_logs(tmp_path, {"vision": 50, "paths": 32, "video": 28})
    with chdir(tmp_path):
        before = rarms("plan")
        declined = rarms("tune", "--samples", "60", "--dry-run", "--json")
        tuned = rarms("tune", "--samples", "60")
        rarms("export", "tuned.xlsx")
        after = rarms("plan")
        explained = " ".join(rarms("explain", "video").out.split())
        again = rarms("tune", "--json")
        trail = trail_in(Path("tuned.xlsx"))
        in_all_reports(trail)

    assert (before.code, declined.code, tuned.code, after.code, again.code) == (4, 0, 0, 0, 0), tuned.err
    found = json.loads(declined.out)["run"]
    assert (found["ending"], found["message"], found["proved"], found["written"]) == (
        "successful",
        "successful",
        True,
        False,
    )
    assert found["after_lp"] <= found["capacity_lp"] == 2 < found["before_lp"]
    text = (tmp_path / "rarms.yaml").read_text(encoding="utf-8")
    assert "vision: # what it sees" in text
    assert "partitions:\n  paths:\n    components: [paths, video]\n" in text
    assert len(trail) == len(found["trail"])
    assert "No other layout of these components is better by `policy.minimise`" in " ".join(tuned.out.split())
    assert "?" not in tuned.err, "nothing that looks like a question is told where no user is asked"
    numbers = [tuple(map(int, found)) for found in re.findall(r"^\[(\d+)/(\d+)\] ", declined.err, re.MULTILINE)]
    assert [number for number, _ in numbers] == [*range(1, len(found["trail"]) + 1)]
    assert all(number <= most for number, most in numbers)
    assert re.search(r"^\[1/\d+\] paths\+video  busy-loop  ", declined.err, re.MULTILINE)
    assert re.search(r": at most 4 combinations, \d+ settings,\s+about .* of host time\.", declined.err)
    assert declined.err.count("Tuning 3 partitions on onboard (simulated): at most ") == 1, declined.err
    assert "Tuning" not in again.err
    second = json.loads(again.out)["run"]
    assert second["ending"] == "nothing_to_do"
    assert {part["parts_lp"] for part in second["partitions"]} == {None}, "this run combined nothing"
    assert "by the default strategy, proved to be the best" in explained


def trail_in(workbook: Path) -> Sequence[tuple[object, ...]]:
    """The rows of the sheet of what tuning asked for, without their header."""
    return list(openpyxl.load_workbook(workbook)["tuning"].values)[1:]


def in_all_reports(trail: Sequence[tuple[object, ...]]) -> None:
    """What was asked for stands, in the same order, in the page, in its JSON and in XLSX."""
    assert rarms("report", "-o", "page.html").code == 0
    page = Path("page.html").read_text(encoding="utf-8")
    document = rarms("report", "--json").out
    assert rarms("export", "all.xlsx").code == 0
    check(document)
    tuning = json.loads(document)["tunings"][0]["run"]

    tried = [(trial["reserve"], trial["met"]) for trial in tuning["trail"]]
    assert tried == [(row[4], row[5] == "yes") for row in trail]
    assert trail_in(Path("all.xlsx")) == trail
    asked = re.findall(r'<th scope="row">paths \+ video</th><td data-is="Reservation">(\d+) % of its VPs</td>', page)
    assert asked == [str(row[4]) for row in trail]
    assert 'id="candidates"' in page


def test_what_tuning_finds_is_what_a_plan_reserves(tmp_path: Path) -> None:
    """Jobs vary so much that a verdict at 1 % of error and the curve's band are two points apart."""
    manifest = (
        MANIFEST.replace("at_most: 41 ms", "at_most: 120 ms").replace("65 ms", "170 ms").replace("75 ms", "177 ms")
    )
    manifest = manifest.replace("work: 20 ms, varies: 2 %", "work: 60 ms, blocked: 10 ms, varies: 25 %")
    (tmp_path / "rarms.yaml").write_text(manifest, encoding="utf-8", newline="\n")
    leave_logs(tmp_path, {"vision": 56, "paths": 40, "video": 38})
    with chdir(tmp_path):
        found = json.loads(rarms("tune", "--samples", "400", "--json").out)["run"]

    assert found["ending"] == "successful"
    (compound,) = [partition for partition in found["partitions"] if len(partition["components"]) > 1]
    chosen = last_chosen(read_entries(configuration_path(tmp_path, "onboard", "video")))
    assert chosen is not None
    assert chosen.reserve == compound["reserve"]


def test_unasked_log_may_void_the_proof(here: Path) -> None:
    """Vision and paths together are seen to do with less than vision was shown to miss with."""
    together = [replace(steady(name, 10.0), elapsed_ms=1000.0) for name in ("paths", "vision")]
    leave_log(here, ("paths", "vision"), [a_setting(5, *together)])

    ran = rarms("tune", "--samples", "60", "--dry-run")

    assert ran.code == 0
    assert "] paths+vision  " not in ran.err, "its log answers"
    assert "RARMS306" in ran.err
    assert "No other layout" not in ran.out


def test_papers_procedure_walks_by_ten(here: Path) -> None:
    ran = rarms("tune", "--samples", "60", "--strategy", "paper", "--json")

    found = json.loads(ran.out)["run"]
    assert found["message"] == "successful"
    asked = [(tuple(trial["components"]), trial["reserve"]) for trial in found["trail"]]
    assert {members for members, _ in asked} == {("paths", "video")}
    assert [reserve for _, reserve in asked[1:]] == list(range(10, 10 * len(asked), 10))


def test_where_nothing_may_be_combined_answer_is_no(here: Path) -> None:
    alone = MANIFEST.replace("    criticality:", "    dedicated: true\n    criticality:")
    (here / "rarms.yaml").write_text(alone, encoding="utf-8", newline="\n")
    for strategy in ("default", "paper"):
        ran = rarms("tune", "--strategy", strategy)
        found = json.loads(rarms("tune", "--strategy", strategy, "--json").out)["findings"]
        (values,) = [finding["values"] for finding in found if finding["code"] == "RARMS305"]
        assert ran.code == 4
        assert "RARMS305" in ran.err
        assert {"paths", "vision"} <= set(values["relaxed_components"]), "each has a level with which all fits"
        for component, level in zip(values["relaxed_components"], values["relaxed_levels"], strict=True):
            assert f"{component}: mean_response_time at most {level} instead of " in ran.err
        assert "Or remove `dedicated` and tune again." in ran.err
        assert "Unable to reduce total CPU reservation by combining CoIs" in ran.out
    assert (here / "rarms.yaml").read_text(encoding="utf-8") == alone


def test_where_another_host_has_room_nothing_is_tuned(tmp_path: Path) -> None:
    hosts = "  {}: {{ logical_processors: 1, memory: 4 GiB, platform: alike }}\n"
    component = (
        "  {}: {{ criticality: 1, dedicated: true, apt: {{ mean_response_time: {{ at_most: 100 ms }} }}, {} }}\n"
    )
    rest = "memory: 64 MiB, simulation: { work: 10 ms }"
    head, lines = MANIFEST.partition("hosts:\n")[0], [component.format(name, rest) for name in ("arm", "base")]
    hosts_and_components = ["hosts:\n", *map(hosts.format, ("left", "right")), "components:\n", *lines]
    (tmp_path / "rarms.yaml").write_text(head + "".join(hosts_and_components), encoding="utf-8", newline="\n")
    with chdir(tmp_path):
        leave_logs(tmp_path, {"arm": 68, "base": 68})
        plan, tunes = rarms("plan"), [rarms("tune", "--host", "left", *more) for more in ((), ("--strategy", "paper"))]

    assert [plan.code, *(tune.code for tune in tunes)] == [0, 0, 0], plan.err
    assert all("left, right: nothing to do, 1.36 LP are reserved" in " ".join(tune.out.split()) for tune in tunes)


def test_untried_pairs_are_a_way_out(tmp_path: Path) -> None:
    """It tries only pairs with the least critical component, which is on its own here."""
    (tmp_path / "rarms.yaml").write_text(
        MANIFEST.replace("    criticality: 10\n", "    criticality: 10\n    dedicated: true\n"),
        encoding="utf-8",
        newline="\n",
    )
    with chdir(tmp_path):
        leave_logs(tmp_path, {"vision": 45, "paths": 40, "video": 30})
        ran = rarms("tune", "--strategy", "paper")

    said = " ".join(ran.err.split())
    assert ran.code == 4
    assert "Combining components may be enough. Check with `rarms tune`: paths and vision reserve 1.7 LP" in said


def test_untuned_reservations_count(tmp_path: Path) -> None:
    fixed = MANIFEST.replace("reserve: measured", "reserve: 20 %")
    (tmp_path / "rarms.yaml").write_text(fixed, encoding="utf-8", newline="\n")

    with chdir(tmp_path):
        ran = rarms("tune")

    amount = "1.2 LP are reserved, 1.2 LP of it by partitions that are not tuned; the capacity is 2 LP."
    assert (ran.code, ran.out) == (0, f"onboard: nothing to do, {amount} Next: `rarms plan`\n")


def test_fixed_reserves_may_be_measured_instead(tmp_path: Path) -> None:
    fixed = MANIFEST.replace("reserve: measured", "reserve: 40 %")
    (tmp_path / "rarms.yaml").write_text(fixed, encoding="utf-8", newline="\n")

    with chdir(tmp_path):
        ran = rarms("tune")

    said = " ".join(ran.err.split())
    assert (ran.code, "error[RARMS305]" in said) == (4, True)
    assert "The manifest fixes all reserves. They do not fit, and no components can be combined." in said
    assert "- video reserves 20 % of host instead of 40 % of host" in said
    assert "Or use a measured reserve: `cpu: { reserve: measured }`." in said


def test_protected_partition_is_never_combined_away(here: Path) -> None:
    protected = "\npartitions:\n  {}: {{ protect: true }} # never lose it\n"
    (here / "rarms.yaml").write_text(MANIFEST + protected.format("video"), encoding="utf-8", newline="\n")
    graph = rarms("graph", "--candidates").out
    away = json.loads(rarms("tune", "--samples", "60", "--json").out)["run"]
    kept = (here / "rarms.yaml").read_text(encoding="utf-8")
    (here / "rarms.yaml").write_text(MANIFEST + protected.format("paths"), encoding="utf-8", newline="\n")
    taken_in = rarms("tune", "--samples", "60")

    assert "paths+video" not in graph
    assert not any("video" in trial["components"] for trial in away["trail"])
    assert "  video: { protect: true } # never lose it\n" in kept
    assert taken_in.code == 0, taken_in.err
    text = (here / "rarms.yaml").read_text(encoding="utf-8")
    assert "# never lose it" in text
    assert "components: [paths, video]" in text
    assert "protect: true" in text


def test_explain_says_what_was_measured_together_and_rejected(here: Path) -> None:
    before = rarms("explain", "paths").out
    rarms("tune", "--samples", "60", "--dry-run")
    after = rarms("explain", "paths").out

    assert "other compounds none `rarms tune` has measured nothing" in " ".join(before.split())
    assert "rejected by tuning" in next(line for line in after.splitlines() if line.startswith("paths+video "))


def test_only_confirmed_combinations_are_measured(here: Path) -> None:
    no = rarms("tune", "--interactive", "--samples", "60", stdin="\n" * 9, at_a_terminal=True)
    assert (no.code, "RARMS305" in no.err) == (4, True)
    assert "Try paths and video? About " in no.err
    assert "saves at most " in no.err
    assert not (here / "measurements" / "onboard" / "paths+video").exists()

    yes = rarms("tune", "--interactive", "--samples", "60", "--json", stdin="maybe\n" + "y\n" * 9, at_a_terminal=True)
    assert yes.code == 0, yes.err
    assert yes.err.count("Try paths and video?") == 2, "once for each combination, and where the answer was none"
    assert yes.err.count("Type y or n: ") == 1
    assert json.loads(yes.out)["run"]["ending"] == "successful"


@pytest.fixture
def applied(here: Path) -> Path:
    """The manifest on a host where its partitions run, with less than they need."""
    manifest = here / "rarms.yaml"
    manifest.write_text(MANIFEST.replace("reserve: measured", "reserve: 10 %"), encoding="utf-8", newline="\n")
    assert rarms("apply", "--auto-approve").code == 0
    manifest.write_text(MANIFEST, encoding="utf-8", newline="\n")
    return here


def running() -> list[str]:
    """The partitions that run on the host."""
    settings = [partition.settings for partition in read_snapshot(rarms("snapshot").out.encode()).partitions]
    return sorted(each.name for each in settings if each.running)


def test_applied_partitions_stop_only_on_request(applied: Path) -> None:
    refused = rarms("tune", "--samples", "60")
    tuned = rarms("tune", "--samples", "60", "--stop-partitions")

    assert refused.code == 3
    assert "`rarms tune --stop-partitions`" in " ".join(refused.err.split())
    assert tuned.code == 0, tuned.err
    assert "started paths, video and vision again" in " ".join(tuned.err.split())
    assert "partitions:" in (applied / "rarms.yaml").read_text(encoding="utf-8")
    assert running() == ["paths", "video", "vision"]
    assert rarms("tune", "--stop-partitions", "--on-busy-host").code == 64


def test_session_asks_once_before_stopping(
    applied: Path,
) -> None:
    levels, combined = "\n" * 3, "y\n" * 9
    words = ("measure", "--interactive", "--samples", "60")
    ran = rarms(*words, stdin=f"y\n{levels}{combined}", at_a_terminal=True)

    said = " ".join(ran.err.split())
    assert ran.code == 0, ran.err
    assert said.count("while measuring, and start") == 1
    assert "Combine components? [y/N/?/q]" in said
    assert "Write these partitions into the manifest? [y/N/?/q]" in said
    assert "partitions:" in (applied / "rarms.yaml").read_text(encoding="utf-8")
    assert running() == ["paths", "video", "vision"]
