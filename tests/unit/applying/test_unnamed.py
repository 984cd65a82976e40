"""A partition that the manifest no longer names: removed where it holds nothing that could be lost, otherwise kept."""

from collections.abc import Iterable
from dataclasses import replace

from rarms_iac.applying.make_plan import make_plan
from rarms_iac.model.changes import Delete, Update
from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.model.plan import UndoLevel
from rarms_iac.model.state import Disk, DiskKind, StartAction, State, StopAction
from rarms_iac.model.system import Disruption, PartitionRequest, Policy, System, Unused
from tests.builders import a_component, a_host, a_partition, a_system, codes
from tests.lab import a_lab, without_serials
from tests.planning import a_request, route
from tests.pure_host import PureHost
from tests.strategies import empty_state

VISION = a_component("vision", criticality=9, reserve="40 %", memory="512 MiB")
SPEECH = a_component("speech", criticality=5, reserve="30 %", memory="512 MiB")


def both(*, host: Host | None = None, partitions: Iterable[PartitionRequest] = ()) -> System:
    return a_system(hosts=[host or a_host("onboard")], components=[VISION, SPEECH], partitions=partitions)


def vision_alone(policy: Policy | None = None, host: Host | None = None) -> System:
    return a_system(hosts=[host or a_host("onboard")], components=[VISION], policy=policy)


def test_simulated_removal_can_be_undone() -> None:
    with a_lab(both()) as lab:
        lab.apply(lab.plan())
        before = lab.observe()

        plan = lab.wanting(vision_alone()).plan()
        (change,) = plan.hosts[0].changes
        lab.apply(plan)
        after = lab.observe()
        lab.undo()

        assert isinstance(change, Delete)
        assert change.disruption is Disruption.PARTITION_STOP
        stop, removal = plan.hosts[0].steps
        assert (stop.undo.level, removal.undo.level) == (UndoLevel.PARTIAL, UndoLevel.FULL)
        assert [partition.settings.name for partition in after["onboard"].partitions] == ["vision"]
        assert without_serials(lab.observe()) == without_serials(before)


def test_its_reserve_is_in_no_sum() -> None:
    with a_lab(both()) as lab:
        lab.apply(lab.plan())
        totals = lab.wanting(vision_alone()).plan().hosts[0].totals

    assert totals is not None
    assert totals.reserved_lp == totals_alone()


def totals_alone() -> object:
    with a_lab(vision_alone()) as lab:
        totals = lab.plan().hosts[0].totals
    assert totals is not None
    return totals.reserved_lp


def test_its_mark_remembers_that_it_is_protected() -> None:
    with a_lab(both(partitions=[a_partition("speech", protect=True)])) as lab:
        lab.apply(lab.plan())
        assert lab.steps_left() == 0

        assert codes(lab.wanting(vision_alone()).prepare().findings) == ["RARMS152"]


def test_new_protection_changes_the_mark() -> None:
    with a_lab(both()) as lab:
        lab.apply(lab.plan())
        protecting = lab.wanting(both(partitions=[a_partition("speech", protect=True)]))

        (change,) = protecting.plan().hosts[0].changes
        protecting.apply(protecting.plan())

        assert change.reason.message == "its mark says that the manifest protects it"
        assert protecting.steps_left() == 0


HYPERV = a_host("onboard", provider=ProviderKind.HYPERV)
"""A host on which a partition may hold what could be lost."""


def on_hyperv() -> State:
    """Both partitions, applied; speech has a disk, and is saved when its host stops."""
    host = PureHost(empty_state(HYPERV))
    ordered = route(both(host=HYPERV), host.state).ordered
    host.walk(ordered.steps)  # type: ignore[union-attr]  # no cycle
    speech = next(partition for partition in host.state.partitions if partition.settings.name == "speech")
    saved = replace(speech, settings=replace(speech.settings, stop_action=StopAction.SAVE))
    others = [partition for partition in host.state.partitions if partition is not speech]
    disk = Disk(path="D:\\speech.vhdx", kind=DiskKind.DYNAMIC, machine=speech.id)
    return replace(host.state, partitions=(*others, saved), disks=(disk,))


def test_hyperv_leaves_it_stopped_and_listed() -> None:
    state = on_hyperv()
    found = route(vision_alone(host=HYPERV), state)
    (change,) = found.difference.changes
    assert isinstance(change, Update)
    assert change.reason.message == "the manifest no longer names it"

    host = PureHost(state, made=50)
    host.walk(found.ordered.steps)  # type: ignore[union-attr]  # no cycle
    stopped = next(partition for partition in host.state.partitions if partition.settings.name == "speech")
    assert not stopped.settings.running
    assert stopped.settings.start_action is StartAction.NOTHING

    planned = make_plan(a_request(vision_alone(host=HYPERV)), {"onboard": host.state}).plan
    assert planned is not None
    (part,) = planned.hosts
    assert part.changes == ()
    assert [(unused.name, unused.memory_on_disk, unused.disks) for unused in part.unused] == [
        ("speech", 512 * 2**20, ("D:\\speech.vhdx",))
    ]
    assert part.totals is not None
    assert part.totals.reserved_lp == totals_alone()


def test_on_hyperv_policy_and_limit_remove_it_together() -> None:
    remove = vision_alone(Policy(unused=Unused.REMOVE), HYPERV)

    (kept,) = route(remove, on_hyperv(), Disruption.HOST_RESTART).difference.changes
    (removed,) = route(remove, on_hyperv(), Disruption.REMOVAL).difference.changes

    assert isinstance(kept, Update)
    assert isinstance(removed, Delete)
    assert removed.disruption is Disruption.REMOVAL
