"""What tuning is about, and how it ends when the user stops it."""

import json
from collections.abc import Iterator, Mapping
from contextlib import chdir
from dataclasses import replace
from datetime import date
from pathlib import Path

import pytest

from rarms_iac.app.declared_hosts import totals_at_hand
from rarms_iac.app.hosts import observe_hosts, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.measuring.level_prompt import _predicted
from rarms_iac.measuring.tune import tuning_findings
from rarms_iac.measuring.tuning import TuningStopped, search_combinations
from rarms_iac.measuring.tuning_subject import LayoutFit, TuningSubject, subject_of_tuning, tuning_host
from rarms_iac.planner.combining.oracle import Coi, Members
from rarms_iac.planner.combining.paper import Inquiry
from rarms_iac.planner.infeasibility.relaxations import pair_relaxations
from rarms_iac.planner.planning_findings import CONTRADICTION
from rarms_iac.storage.datalog.decisions import TuningStrategy
from tests.measuring import leave_logs
from tests.unit.cli.running import rarms

MANIFEST = """\
schema: rarms/v1

application: { name: robot }
policy: { interference: busy-loop }

hosts:
  onboard: { logical_processors: 2, memory: 4 GiB, platform: two-core }
  workshop: { logical_processors: 2, memory: 4 GiB, platform: two-core }

components:
  vision: { criticality: 30, apt: &apt, memory: 64 MiB, simulation: { work: 10 ms }, hosts: [onboard] }
  paths: { criticality: 20, apt: &apt, memory: 64 MiB, simulation: { work: 10 ms }, hosts: [onboard] }
  ballast: { criticality: 10, cpu: { reserve: 0.8 LP }, memory: 64 MiB, hosts: [onboard] }
""".replace("&apt", "{ mean_response_time: { at_most: 100 ms } }")

VIDEO = """\
  video:
    criticality: 5
    apt: { mean_response_time: { at_most: 100 ms } }
    memory: 64 MiB
    simulation: { work: 10 ms }
"""


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Path]:
    """A folder with a measured robot, which is where we are."""
    with chdir(tmp_path):
        write(MANIFEST + VIDEO)
        leave_logs(tmp_path, {"vision": 30, "paths": 30, "video": 30})
        yield tmp_path


def write(text: str) -> None:
    Path("rarms.yaml").write_text(text, encoding="utf-8", newline="\n")


def subject_of(*hosts: str) -> TuningSubject:
    source = ManifestSource(today=date(2026, 11, 22))
    found = select_hosts(load_manifest(source), HostSelection(hosts=hosts))
    return subject_of_tuning(found, tuning_host(found), observe_hosts(found))


def test_compound_stays_where_partition_of_its_name_runs(here: Path) -> None:
    write(MANIFEST)
    done = rarms("apply", "--auto-approve")
    assert done.code == 0, done.err
    write(MANIFEST.replace("}, hosts: [onboard] }\n  ballast", "} }\n  ballast") + VIDEO)

    subject = subject_of()
    vision = next(coi for coi in subject.cois if coi.name == "vision")
    both = Coi(name="paths", members=("paths", "video"), criticality=20, processors=2, reserve=31)

    layout_fit = LayoutFit(subject=subject)
    assert not layout_fit.fits([vision, both]), "paths runs on onboard, and there is room for 30 % only"
    assert layout_fit.fits([vision, Coi(name="paths", members=both.members, criticality=20, processors=2, reserve=30)])
    assert not layout_fit.unsure


class Once:
    """An oracle that answers once; then the user asks for an end."""

    def __init__(self) -> None:
        self.asked: list[Members] = []

    def worse(self, members: Members, reserve: int) -> frozenset[str]:
        if self.asked:
            raise TuningStopped("stopped")
        self.asked.append(members)
        return frozenset()

    def unresolved(self, members: Members, reserve: int) -> bool:
        return False


def test_declined_combination_tells_its_prediction(here: Path) -> None:
    write(MANIFEST.replace("0.8 LP", "1 LP") + VIDEO)
    subject = subject_of("onboard")
    oracle = Once()

    end = search_combinations(subject, Inquiry(oracle=oracle, may_share=subject.may_share), "default", repeat=False)

    assert end.ending == "stopped"
    assert [trial.components for trial in end.trail] == oracle.asked
    assert end.trail[0].predicted is not None


class AsIfBroken:
    """An oracle of components of which three together need less than two of them."""

    needs: Mapping[Members, int] = {
        ("gripper", "paths"): 44,
        ("paths", "speech"): 35,
        ("paths", "video"): 48,
        ("gripper", "paths", "speech"): 41,
        ("gripper", "paths", "video"): 45,
        ("paths", "speech", "video"): 32,
    }

    def worse(self, members: Members, reserve: int) -> frozenset[str]:
        return frozenset() if reserve >= self.needs.get(members, 64) else frozenset(members)

    def unresolved(self, members: Members, reserve: int) -> bool:
        return False


def test_contradicting_setting_proves_nothing(tmp_path: Path) -> None:
    component = "{ criticality: 10, apt: { mean_response_time: { at_most: 100 ms } }, simulation: { work: 10 ms } }"
    least = {"gripper": 13, "speech": 11, "paths": 28, "video": 15}
    lines = "".join(f"  {name}: {component.replace('10,', f'{40 - at},')}\n" for at, name in enumerate(least))
    head, ballast = (
        MANIFEST.partition("  vision:")[0],
        "  ballast: { criticality: 1, cpu: { reserve: 0.59 LP }, hosts: [onboard] }\n",
    )
    lines = lines.replace("work: 10 ms } }", "work: 10 ms }, hosts: [onboard] }")
    with chdir(tmp_path):
        write(head.replace("logical_processors: 2", "logical_processors: 1") + lines + ballast)
        leave_logs(tmp_path, least)
        subject = subject_of("onboard")
        inquiry = Inquiry(oracle=AsIfBroken(), may_share=subject.may_share)
        end = search_combinations(subject, inquiry, "default", repeat=False)
        diagnostics = list(tuning_findings(end, "default", subject.hosts.manifest.places))
        contradictions = [finding for finding in diagnostics if finding.code == CONTRADICTION.code]

    assert [contradiction.message for contradiction in end.contradictions] == [
        "paths+speech+video needs less than its part paths+video"
    ]
    assert not end.proved
    assert len(contradictions) == 1
    assert "The layout is valid" in contradictions[0].detail


def test_miss_with_hardest_load_ends_a_question(here: Path) -> None:
    text = MANIFEST.replace("interference: busy-loop", "interference: [busy-loop, bursts-20]")
    write(text.replace("100 ms", "12 ms").replace("0.8 LP", "1 LP"))
    leave_logs(here, {"vision": 30, "paths": 30})
    rarms("tune", "--host", "onboard")
    asked = [path.stem for path in here.glob("measurements/two-core/paths+vision/*.jsonl")]

    assert asked == ["bursts-20"]


class Never:
    """An oracle of components that miss their thresholds together."""

    def worse(self, members: Members, reserve: int) -> frozenset[str]:
        return frozenset(members)

    def unresolved(self, members: Members, reserve: int) -> bool:
        return False


def test_after_papers_procedure_default_strategy_is_way_out(here: Path) -> None:
    write(MANIFEST.replace("0.8 LP", "1 LP") + VIDEO)
    subject = subject_of("onboard")
    inquiry = Inquiry(oracle=Never(), may_share=subject.may_share)

    def advice(strategy: TuningStrategy) -> str:
        end = search_combinations(subject, inquiry, strategy, repeat=False)
        (finding,) = tuning_findings(end, strategy, subject.hosts.manifest.places)
        return str(finding.advice)

    assert "Or try other combinations with the default strategy: `rarms tune --host onboard`." in advice("paper")
    assert "rarms tune" not in advice("default")


def test_platforms_are_tuned_by_named_commands(here: Path) -> None:
    write(MANIFEST.replace("platform: two-core }\n\n", "platform: dual }\n\n"))

    refused = rarms("tune")

    assert (refused.code, "error[RARMS309]" in refused.err) == (4, True)
    advice = " ".join(refused.err.split())
    assert "Tune one platform after the other: `rarms tune --host workshop`, `rarms tune --host onboard`." in advice


TWO_HOSTS = """\
schema: rarms/v1
application: { name: robot }
policy: { interference: busy-loop }
hosts:
  a: { logical_processors: 1, memory: 4 GiB, keep_for_host: { processor: 50 % } }
  b: { logical_processors: 2, memory: 4 GiB }
components:
  p: { criticality: 30, apt: &apt, memory: 64 MiB, simulation: { work: 10 ms }, hosts: [a] }
  q: { criticality: 20, apt: &apt, memory: 64 MiB, simulation: { work: 10 ms } }
  r: { criticality: 10, apt: &apt, memory: 64 MiB, simulation: { work: 10 ms }, hosts: [b] }
""".replace("&apt", "{ mean_response_time: { at_most: 100 ms } }")


def on_two_hosts(folder: Path, **least: int) -> None:
    write(TWO_HOSTS)
    leave_logs(folder, least)


def test_tuning_a_host_counts_what_can_be_there(tmp_path: Path) -> None:
    with chdir(tmp_path):
        on_two_hosts(tmp_path, p=29, q=25, r=65)
        over, subject = rarms("plan"), subject_of("a")
        on_two_hosts(tmp_path, p=20, q=25, r=101)
        fits = rarms("tune", "--host", "a")

    assert over.code == 4
    assert (subject.capacity, subject.fixed, sum(coi.cost for coi in subject.cois)) == (50, 0, 54)
    assert fits.code == 0, fits.err
    assert "\na: nothing to do, 0.45 LP are reserved; the capacity is 0.5 LP. Next: `rarms plan`\n" in fits.out


def test_full_other_host_does_not_prevent_tuning(tmp_path: Path) -> None:
    """Component q may run on both hosts; b has no room for r and s, and so none for q."""
    with chdir(tmp_path):
        write(TWO_HOSTS + "  s: { criticality: 9, memory: 64 MiB, cpu: { reserve: 0.8 LP }, hosts: [b] }\n")
        leave_logs(tmp_path, {"p": 29, "q": 25, "r": 65})
        measured = subject_of("a")
        fits = rarms("tune", "--host", "a")
        plan = rarms("plan")

    assert (measured.capacity, measured.fixed, sum(coi.cost for coi in measured.cois)) == (50, 0, 54)
    assert (fits.code, "Tuned a: 0.54 LP became 0.29 LP, of 0.5 LP." in fits.out) == (0, True), fits.out
    assert (plan.code, "r 1.3 LP and s 0.8 LP need 2.1 LP; b has 2 LP" in " ".join(plan.err.split())) == (4, True), (
        plan.err
    )


def test_component_measured_for_full_host_counts_there(tmp_path: Path) -> None:
    """Component q names no hosts: only its data log binds it to a."""
    with chdir(tmp_path):
        on_two_hosts(tmp_path, p=55, q=25, r=65)
        over = rarms("plan", "--json")
        manifest = load_manifest(ManifestSource(today=date(2026, 11, 22)))
        totals = totals_at_hand(manifest)[0].hosts

    (finding,) = [each for each in json.loads(over.out)["findings"] if each["code"] == "RARMS014"]
    assert "p needs 0.55 LP; a has 0.5 LP for partitions. With q, the total is 0.8 LP." in finding["detail"]
    assert {name: float(each.reserved_lp) for name, each in totals.items()} == {"a": 0.8, "b": 1.3}


def test_component_with_choice_counts_where_room_is(tmp_path: Path) -> None:
    with chdir(tmp_path):
        write(
            TWO_HOSTS.replace("memory: 4 GiB", "memory: 4 GiB, platform: alike").replace(
                "processors: 1,", "processors: 2,"
            )
        )
        leave_logs(tmp_path, {"p": 60, "q": 15, "r": 65})
        totals = totals_at_hand(load_manifest(ManifestSource(today=date(2026, 11, 22))))[0].hosts

    assert {name: float(each.reserved_lp) for name, each in totals.items()} == {"a": 1.2, "b": 1.6}


def test_whole_cores_count_in_offers(tmp_path: Path) -> None:
    """One thread and two take a core each, and three together take two: 4 LPs, of which one stands idle."""
    host = "  onboard: { logical_processors: 4, memory: 4 GiB, simulated: { smt: true } }\n"
    head, components = MANIFEST.partition("hosts:\n")[0], MANIFEST.partition("components:\n")[2]
    components = components.replace("30, ", "30, processors: 1, ").replace("20, ", "20, processors: 2, ")
    with chdir(tmp_path):
        write(f"{head}hosts:\n{host}components:\n{components}")
        leave_logs(tmp_path, {"vision": 40, "paths": 40})
        subject = subject_of("onboard")

    assert {coi.name: (coi.processors, coi.cost) for coi in subject.cois} == {"vision": (1, 80), "paths": (2, 80)}
    assert _predicted(replace(subject, predict=lambda _members, _processors: 30), need=160) == 120
    (pair,) = pair_relaxations(subject.problem, ("vision", "paths"))
    (edit,) = pair.edits_at(30)
    assert "reserve 1.6 LP in two partitions on onboard; in one partition they may reserve up to 1.2 LP" in edit.message
