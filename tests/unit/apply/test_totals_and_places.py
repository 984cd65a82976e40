from dataclasses import replace

from rarms_iac.apply.totals import totals_of
from rarms_iac.apply.where_asked import WhereAsked
from rarms_iac.model.changes import Address
from rarms_iac.model.plan import Claim, Step, Totals
from rarms_iac.model.state import State
from tests.builders import PathPlaces, a_partition, a_system, the_delivery_robot
from tests.builders_plan import facts, partition, settings, step


def test_totals_are_what_is_promised_after_the_steps_with_strangers_apart() -> None:
    observed = State(
        facts=facts(),
        partitions=(
            partition(settings("vision", reserve=40)),
            partition(settings("video", reserve=10)),
            partition(settings("speech", reserve=20), application="other"),
        ),
    )
    lowered = step(Address(partition="vision"))
    removed = step(Address(partition="video", machine="id-of-video"))

    after = totals_of(
        observed,
        "robot",
        [
            step_with(lowered, Claim(processors=2, reserve=30, memory=2**29)),
            step_with(removed, Claim()),
        ],
    )

    assert after == Totals(percent=60, memory=2**29, others_percent=40, others_memory=2**29)


def step_with(one: Step, claim: Claim) -> Step:
    return replace(one, claim_after=claim)


def test_a_partition_without_an_entry_is_asked_for_by_its_component() -> None:
    system = the_delivery_robot()
    asked = WhereAsked(system=system, places=PathPlaces())

    assert asked.key("partitions", "path-planning").path == "components.path-planning"
    assert asked.key("tasks", "SpeechRecognition").path == "components.speech-recognition.task"
    assert asked.key("hosts", "onboard").path == "hosts.onboard"


def test_a_partition_with_an_entry_is_asked_for_by_it() -> None:
    asked = WhereAsked(system=a_system(partitions=[a_partition("vision")]), places=PathPlaces())

    assert asked.value("partitions", "vision").path == "partitions.vision"
    assert asked.key("partitions", "former").path == "partitions.former"
    assert asked.key("tasks", "Unknown").path == "tasks.Unknown"
