from dataclasses import replace

from rarms_iac.applying.state_after import totals_after
from rarms_iac.model.changes import Address, Delete, Reason, Update
from rarms_iac.model.plan import Purpose
from rarms_iac.model.state import State
from rarms_iac.model.system import Disruption, StartMode
from rarms_iac.model.totals import Totals
from rarms_iac.views.console import UNLIMITED, render
from rarms_iac.views.plan import plan_text
from tests.builders import a_component, a_host, a_partition, a_system
from tests.builders_plan import facts, partition, settings
from tests.lab import a_lab


def test_totals_keep_strangers_apart() -> None:
    observed = State(
        facts=facts(),
        partitions=(
            partition(settings("vision", reserve=40)),
            partition(settings("video", reserve=10)),
            partition(settings("speech", reserve=20), application="other"),
        ),
    )
    vision, video, _ = observed.partitions
    reason = Reason(message="the manifest wants less")
    lowered = Update(
        address=Address(partition="vision", machine=vision.id),
        before=vision,
        after=replace(vision, settings=settings("vision", reserve=30)),
        reason=reason,
        disruption=Disruption.LIVE,
    )
    removed = Delete(
        address=Address(partition="video", machine=video.id), before=video, reason=reason, disruption=Disruption.REMOVAL
    )

    after = totals_after(observed, "robot", (lowered, removed), {"vision"})

    assert after == Totals(percent=60, memory=2**29, others_percent=40, others_memory=2**29)


def test_a_machine_that_changes_sides_is_counted_once() -> None:
    with a_lab(a_system(hosts=[a_host("onboard")], components=[a_component("eyes", reserve="40 %")])) as lab:
        lab.apply(lab.plan())
        (eyes,) = lab.observe()["onboard"].partitions

        release = lab.plan(purpose=Purpose.RELEASE, partitions=("eyes",))
        lab.apply(release)
        taking_over = lab.plan(purpose=Purpose.IMPORT, partitions=("eyes",), machine=eyes.id)

    memory = eyes.settings.memory
    assert release.hosts[0].totals == Totals(percent=0, memory=0, others_percent=80, others_memory=memory)
    assert taking_over.hosts[0].totals == Totals(percent=80, memory=memory)


def test_manual_partition_is_promised_as_planned() -> None:
    by_hand = a_partition("eyes", components=["eyes"], start=StartMode.MANUAL)
    with a_lab(
        a_system(hosts=[a_host("onboard")], components=[a_component("eyes", reserve="40 %")], partitions=[by_hand])
    ) as lab:
        first = lab.plan()
        lab.apply(first)
        again = lab.plan()
        (eyes,) = lab.observe()["onboard"].partitions

    memory = eyes.settings.memory
    assert not eyes.settings.running
    assert first.hosts[0].totals == Totals(percent=80, memory=memory, idle_percent=80, idle_memory=memory)
    assert again.hosts[0].totals == first.hosts[0].totals
    assert "of these, 0.8 LP and 512 MiB by partitions that do not run" in render(plan_text(first), UNLIMITED)
