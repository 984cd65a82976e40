"""Applying a plan to simulated hosts: used once, only on what it saw, host by host, and finished by the next run."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.applying.execute import apply_plan
from rarms_iac.applying.run_report import ReportedStep, RunEnding, RunReporter
from rarms_iac.applying.run_steps import RunControl, hold
from rarms_iac.applying.undo import abandon, steps_undone
from rarms_iac.model.host import Fault, FaultEffect, SimulatedHost
from rarms_iac.model.journal import StepStatus
from rarms_iac.model.operations import Operation, Set, set_to
from rarms_iac.model.plan import Purpose, Scope
from rarms_iac.model.quantities import Bytes
from rarms_iac.providers.simulated.provider import SimulatedHostProvider
from tests.builders import ORIGIN, a_component, a_host, a_system, codes, the_delivery_robot
from tests.lab import Countdown, Lab, a_lab, without_serials

OURS = Scope(application="robot", plan="")
VISION = a_component("vision", criticality=9, reserve="40 %", memory="512 MiB")
SPEECH = a_component("speech", criticality=5, reserve="30 %", memory="512 MiB")


def faulty(**faults: Fault) -> SimulatedHost:
    return SimulatedHost(faults=faults)


@pytest.fixture
def lab() -> Iterator[Lab]:
    with a_lab(a_system(hosts=[a_host("onboard")], components=[VISION, SPEECH])) as made:
        yield made


def with_reserve(lab: Lab, reserve: str) -> Lab:
    vision = a_component("vision", criticality=9, reserve=reserve, memory="512 MiB")
    return lab.wanting(a_system(hosts=[a_host("onboard")], components=[vision, SPEECH]))


def another_tool_sets_the_reserve(lab: Lab, reserve: int) -> None:
    lab.hosts["onboard"].execute(set_to("vision", reserve=reserve, limit=100, weight=100), OURS)


def test_a_plan_that_another_run_overtook_is_refused(lab: Lab) -> None:
    old = lab.plan()
    lab.apply(with_reserve(lab, "20 %").plan())
    lab.undo()

    (refusal,) = lab.apply(old).findings
    assert refusal.code == "RARMS182"
    assert refusal.summary == "The host has changed since the plan was made"
    assert "another apply or undo has run there" in refusal.detail


def test_the_same_plan_finishes_its_own_run(lab: Lab) -> None:
    plan = lab.plan()
    assert lab.apply(plan, Countdown(5)).ending is RunEnding.INTERRUPTED

    report = lab.apply(plan)

    assert report.ending is RunEnding.DONE
    assert report.hosts[0].resumed
    assert lab.steps_left() == 0


def test_unfinished_run_refuses_another_plan(lab: Lab) -> None:
    lab.apply(lab.plan(), Countdown(5))
    before = lab.observe()

    report = lab.apply(with_reserve(lab, "20 %").plan())

    assert (report.ending, codes(report.findings)) == (RunEnding.REFUSED, ["RARMS183"])
    assert lab.observe() == before


def test_run_of_another_version_is_not_finished(lab: Lab) -> None:
    lab.apply(lab.plan(), Countdown(5))
    journal = lab.hosts["onboard"].journal()
    assert journal is not None
    lab.hosts["onboard"].start_run(replace(journal.started, rarms="0.0.1"))
    before = lab.observe()

    finished, (undone,) = lab.finish(), lab.undo()

    assert finished is not None
    assert [finished.ending, undone.ending] == [RunEnding.REFUSED] * 2
    assert "0.0.1" in finished.findings[0].detail
    assert lab.observe() == before


def test_abandoned_run_leaves_the_host(lab: Lab) -> None:
    lab.apply(lab.plan(), Countdown(5))
    before = lab.observe()

    assert abandon(lab.hosts["onboard"]).ending is RunEnding.DONE
    assert lab.observe() == before
    assert abandon(lab.hosts["onboard"]).ending is RunEnding.NOTHING

    assert lab.apply(lab.plan()).ending is RunEnding.DONE
    assert lab.steps_left() == 0


def test_setting_changed_after_last_step_fails_run(lab: Lab) -> None:
    class Meddling(RunReporter):
        def step_ended(self, host: str, number: int, total: int, step: ReportedStep, status: StepStatus) -> None:
            if number == total:
                another_tool_sets_the_reserve(lab, 10)

    report = apply_plan(lab.plan(), lab.hosts, ORIGIN, RunControl(reporter=Meddling()))

    assert report.ending is RunEnding.FAILED
    assert "Another tool also changes this setting." in str(report.findings[0].advice)


def test_setting_changed_in_middle_of_run_stops_it(lab: Lab) -> None:
    lab.apply(lab.plan())
    plan = with_reserve(lab, "20 %").plan()
    lab.apply(plan, Countdown(0))
    another_tool_sets_the_reserve(lab, 25)

    report = lab.finish()

    assert report is not None
    assert (report.ending, codes(report.findings)) == (RunEnding.REFUSED, ["RARMS182"])
    assert "reserve is 25, not 40" in report.findings[0].detail
    expected = {"host": "onboard", "expected_reserve": 40, "is_reserve": 25}
    assert expected.items() <= report.findings[0].values.items()


def test_step_found_done_is_not_undone(lab: Lab) -> None:
    lab.apply(lab.plan())
    plan = with_reserve(lab, "20 %").plan()
    first = plan.hosts[0].steps[0].operation

    class Ahead(RunReporter):
        def step_started(self, host: str, number: int, total: int, step: ReportedStep) -> None:
            if number == 1:
                lab.hosts[host].execute(first, OURS)

    report = apply_plan(plan, lab.hosts, ORIGIN, RunControl(reporter=Ahead()))

    assert (report.ending, report.hosts[0].unchanged) == (RunEnding.DONE, 1)
    lab.undo()
    reserves = {each.settings.name: each.settings.reserve for each in lab.observe()["onboard"].partitions}
    assert reserves["vision"] == 20


def test_undo_without_rights_begins_nothing(lab: Lab) -> None:
    lab.apply(lab.plan())
    journal = lab.hosts["onboard"].journal()
    host = a_host("onboard", settings=SimulatedHost(administrator=False))
    powerless = lab.wanting(a_system(hosts=[host], components=[VISION, SPEECH]))

    (report,) = powerless.undo()

    assert (report.ending, codes(report.findings)) == (RunEnding.FAILED, ["RARMS158"])
    assert lab.hosts["onboard"].journal() == journal


def test_set_without_effect_fails_its_step(lab: Lab) -> None:
    class Idle(SimulatedHostProvider):
        def execute(self, operation: Operation, scope: Scope) -> None:
            if not isinstance(operation, Set):
                super().execute(operation, scope)

    plan = lab.plan()
    hosts = {name: Idle(host, lab.folder / f"{name}.json") for name, host in lab.system.hosts.items()}

    report = apply_plan(plan, hosts, ORIGIN)

    assert (report.ending, codes(report.findings)) == (RunEnding.FAILED, ["RARMS186"])
    journal = hosts["onboard"].journal()
    assert journal is not None
    assert journal.steps[-1].status is StepStatus.BEGUN
    assert isinstance(plan.hosts[0].steps[journal.steps[-1].number].operation, Set)


def test_step_failing_after_work_counts_as_done() -> None:
    fault = Fault(operation="set_cpu", at="partition/vision", effect=FaultEffect.FAIL_AFTER, times=1)
    system = a_system(hosts=[a_host("onboard", settings=faulty(once=fault))], components=[VISION])
    with a_lab(system) as lab:
        before = lab.observe()
        failed = lab.apply(lab.plan())
        assert (failed.ending, codes(failed.findings)) == (RunEnding.FAILED, ["RARMS186"])

        finished = lab.finish()

        assert finished is not None
        assert finished.ending is RunEnding.DONE
        assert finished.hosts[0].unchanged == 0, "the step that had done its work counts as ours"
        lab.undo()
        assert without_serials(lab.observe()) == without_serials(before)


def test_refused_step_keeps_earlier_ones() -> None:
    fault = Fault(operation="start_partition", at="partition/speech", effect=FaultEffect.REFUSE)
    system = a_system(hosts=[a_host("onboard", settings=faulty(always=fault))], components=[VISION, SPEECH])
    with a_lab(system) as lab:
        before = lab.observe()

        report = lab.apply(lab.plan())

        assert report.ending is RunEnding.FAILED
        assert "partition/speech" in report.findings[0].detail
        assert [partition.mark.name for partition in lab.observe()["onboard"].partitions if partition.mark] == [
            "speech",
            "vision",
        ]
        assert [report.ending for report in lab.undo()] == [RunEnding.DONE]
        assert without_serials(lab.observe()) == without_serials(before)


def test_failure_ends_before_the_next_host() -> None:
    fault = Fault(operation="start_partition", at="partition/vision", effect=FaultEffect.REFUSE, times=1)
    vision = replace(VISION, hosts=("arm",))
    other = replace(SPEECH, hosts=("base",))
    hosts = [a_host("arm", settings=faulty(once=fault)), a_host("base")]
    with a_lab(a_system(hosts=hosts, components=[vision, other])) as lab:
        plan = lab.plan()

        assert [part.host for part in lab.apply(plan).hosts] == ["arm"]
        assert lab.observe()["base"].partitions == ()

        report = lab.apply(plan)

        assert (report.ending, [part.host for part in report.hosts]) == (RunEnding.DONE, ["arm", "base"])
        assert lab.steps_left() == 0
        assert codes(lab.apply(plan).findings) == ["RARMS182", "RARMS182"]


def test_all_hosts_are_looked_at_before_first_step() -> None:
    vision, other = replace(VISION, hosts=("arm",)), replace(SPEECH, hosts=("base",))
    hosts = [a_host("arm"), a_host("base")]
    with a_lab(a_system(hosts=hosts, components=[vision, other])) as lab:
        lab.apply(lab.plan())
        less = a_system(
            hosts=hosts,
            components=[replace(vision, memory=Bytes(vision.memory * 2)), replace(other, memory=Bytes(2**28))],
        )
        plan = lab.wanting(less).plan()
        lab.hosts["base"].execute(set_to("speech", reserve=5, limit=100, weight=100), OURS)
        before = lab.observe()

        report = lab.apply(plan)

        assert codes(report.findings) == ["RARMS182"]
        assert lab.observe() == before


def test_hosts_are_held_in_order_of_names(tmp_path: Path) -> None:
    order: list[str] = []

    class Noted(SimulatedHostProvider):
        @contextmanager
        def lock(self, owner: str, timeout_ms: int = 0) -> Iterator[None]:
            order.append(self.name)
            with super().lock(owner, timeout_ms):
                yield

    hosts = tuple(Noted(a_host(name), tmp_path / f"{name}.json") for name in ("base", "camera", "arm"))
    with hold(hosts, "ann@lab", 0):
        assert order == ["arm", "base", "camera"]


def test_next_holder_removes_what_killed_writers_left(lab: Lab) -> None:
    for name in (".onboard.json.7-1.new", ".onboard.journal.jsonl.7-1.new"):
        (lab.folder / name).write_bytes(b"half")

    with lab.hosts["onboard"].lock("ann@lab"):
        pass

    assert [file.name for file in lab.folder.iterdir()] == ["onboard.lock"]


def told(lab: Lab) -> list[str]:
    journal = lab.hosts["onboard"].journal()
    assert journal is not None
    return [f"{step.address}: {step.title}" for step in steps_undone(journal)]


def test_undo_titles_say_what_changes_back(lab: Lab) -> None:
    lab.apply(lab.plan())

    assert told(lab) == [
        "partition/speech: stop it",
        "partition/vision: stop it",
        "partition/vision: remove it",
        "partition/speech: remove it",
    ]

    (mark,) = (
        each.mark for each in lab.observe()["onboard"].partitions if each.settings.name == "vision" and each.mark
    )
    lab.apply(with_reserve(lab, "20 %").plan())
    assert told(lab) == [
        f"partition/vision: mark it as robot/vision, set {mark.set}",
        "partition/vision: reserve 0.4 -> 0.8 LP (20 -> 40 % of each of 2 processors)",
    ]


def test_undo_of_destroy_says_what_is_lost(lab: Lab) -> None:
    lab.apply(lab.plan())
    lab.apply(lab.plan(purpose=Purpose.DESTROY))

    (report,) = lab.undo()

    assert report.ending is RunEnding.DONE
    assert sorted((diagnostic.code, diagnostic.address) for diagnostic in report.findings) == [
        ("RARMS193", "partition/speech"),
        ("RARMS193", "partition/vision"),
    ]
    assert lab.steps_left() == 0


def test_undo_of_destroy_restores_task_classes() -> None:
    with a_lab(the_delivery_robot()) as lab:
        lab.apply(lab.plan())
        before = lab.observe()
        lab.apply(lab.plan(purpose=Purpose.DESTROY))

        (report,) = lab.undo()

        assert report.ending is RunEnding.DONE
        assert without_serials(lab.observe()) == without_serials(before)


def test_released_partition_can_be_imported_again(lab: Lab) -> None:
    lab.apply(lab.plan())
    was = {partition.settings.name: partition for partition in lab.observe()["onboard"].partitions}

    lab.apply(lab.plan(purpose=Purpose.RELEASE, partitions=("vision",)))

    (vision,) = (partition for partition in lab.observe()["onboard"].partitions if partition.settings.name == "vision")
    assert (vision.mark, vision.settings) == (None, was["vision"].settings)
    in_the_way = lab.prepare()
    assert codes(in_the_way.findings) == ["RARMS150", "RARMS014"], "there is no room beside it, and it is why"
    assert "would fit" not in str(in_the_way.findings[1].advice)

    lab.apply(lab.plan(purpose=Purpose.IMPORT, partitions=("vision",), machine=vision.id))

    assert lab.steps_left() == 0
    assert lab.observe()["onboard"].partitions == tuple(was[name] for name in ("speech", "vision"))


@pytest.mark.parametrize(
    ("asked", "code"),
    [
        ({"purpose": Purpose.IMPORT, "partitions": ("vision",), "machine": "no-such-id"}, "RARMS194"),
        ({"purpose": Purpose.RELEASE, "partitions": ("visoin",)}, "RARMS194"),
        ({"targets": ("partition/visoin",)}, "RARMS194"),
    ],
)
def test_unknown_machine_partition_or_target_is_refused(lab: Lab, asked: dict[str, object], code: str) -> None:
    lab.apply(lab.plan())

    prepared = lab.prepare(**asked)

    assert prepared.plan is None
    assert codes(prepared.findings) == [code]


def test_release_where_nothing_is_managed_advises_no_name(lab: Lab) -> None:
    (finding,) = lab.prepare(purpose=Purpose.RELEASE, partitions=("vision",)).findings

    assert str(finding.detail).endswith(" No partition has this mark.")
    assert str(finding.advice) == "No partition can be released."


def test_a_target_that_is_as_wanted_changes_nothing(lab: Lab) -> None:
    lab.apply(lab.plan())

    assert [part.changes for part in lab.plan(targets=("partition/vision",)).hosts] == [()]
    (finding,) = lab.prepare(targets=("vision",)).findings
    assert 'Did you mean "partition/vision"?' in finding.detail


@pytest.mark.parametrize("target", ["partition/visoin", "vision", "visoin"])
def test_misspelt_target_gets_the_meant_address(lab: Lab, target: str) -> None:
    (finding,) = lab.prepare(targets=(target,)).findings

    assert 'Did you mean "partition/vision"?' in finding.detail
    assert "`rarms plan --verbose` lists the changes" in str(finding.advice)


def test_import_from_empty_host_recommends_plan(lab: Lab) -> None:
    (finding,) = lab.prepare(purpose=Purpose.IMPORT, partitions=("vision",), machine="no-such-id").findings

    assert finding.detail.endswith("it has no machines.")
    assert "Give one of these ids" not in str(finding.advice)
    assert "`rarms plan`" in str(finding.advice)


def test_machine_that_is_ours_already_is_not_imported(lab: Lab) -> None:
    lab.apply(lab.plan())
    machine = lab.observe()["onboard"].partitions[0].id

    prepared = lab.prepare(purpose=Purpose.IMPORT, partitions=("ears",), machine=machine)

    assert codes(prepared.findings) == ["RARMS194"]
