"""A plan that makes, changes, renames and removes, and writes task classes on the host and in a guest."""

from collections.abc import Iterable
from dataclasses import replace

from rarms_iac.diff.step_context import StepContext
from rarms_iac.diff.steps import steps_for
from rarms_iac.model.changes import Adopt, Change, Create, Release
from rarms_iac.model.layout import Making
from rarms_iac.model.plan import HostPlan, Plan
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import Mark, Partition, State, TaskClass, TaskRecord
from tests import builders_plan as build
from tests.builders import a_host


def marked(of: Partition, written: str = "a" * 12) -> Partition:
    """As it is wanted: with a new digest in its mark."""
    mark = of.mark or Mark(application="robot", name=of.settings.name, machine="01234567", set="")
    return replace(of, mark=replace(mark, set=written))


def recorded(of: TaskClass, before: TaskClass | None = None) -> TaskClass:
    """A task class of ours, and what was there before."""
    return replace(of, record=TaskRecord(application="robot", set="b" * 12, before=before.values if before else None))


def all_changes() -> tuple[Change, ...]:
    """One of every kind of change."""
    new = replace(build.partition(build.settings("planning", reserve=30)), id="")
    old, smaller = build.partition(build.settings(reserve=70)), build.partition(build.settings(reserve=40, weight=200))
    wide = build.partition(build.settings("speech", processors=1))
    foreign = build.partition(build.settings("kiosk"), application=None)
    host_task, guest_task = recorded(build.task()), recorded(build.task("SpeechRecognition", inside="speech"))
    games = recorded(build.task("Games", priority=4), before=build.task("Games", priority=2))
    changes: tuple[Change, ...] = (
        build.update(old, marked(smaller)),
        build.create(marked(new)),
        build.create(marked(replace(build.partition(build.settings("video")), id=""))),
        build.update(wide, marked(build.partition(build.settings("speech", processors=2, ram="1 GiB")))),
        build.delete(build.partition(build.settings("former"))),
        Adopt(
            address=build.address_of(foreign), before=foreign, after=marked(foreign), reason=build.because("it is ours")
        ),
        Release(
            address=build.address_of(wide),
            before=marked(wide),
            after=replace(wide, mark=None),
            reason=build.because("it\u2019s somebody else's now\r\n; Remove-Item x"),
        ),
        build.create(host_task),
        build.delete(games),
        build.create(guest_task),
    )
    return tuple(map(_of_machine, changes))


def _of_machine(change: Change) -> Change:
    """With the id of the machine, where there is one."""
    if isinstance(change, Create) or not isinstance(change.before, Partition):
        return change
    return replace(change, address=replace(change.address, machine=change.before.id))


def rendered_plan(
    changes: Iterable[Change] | None = None, image: str = "D:\\images\\robot's.vhdx"
) -> tuple[HostPlan, Plan]:
    """The plan of these changes on one host, with a disk from an image for `planning` and a switch for `video`."""
    wanted = tuple(all_changes() if changes is None else changes)
    making = {
        "planning": Making(image=image, vm_path="D:\\vms"),
        "video": Making(switch="lab \u2018net\u2019"),
    }
    seen = SeenHost(host=a_host(), application="robot", state=State(facts=build.facts()))
    context = StepContext(seen=seen, making=making)
    steps = [step for change in wanted for step in steps_for(change, context)]
    on = build.host_plan(changes=wanted, steps=steps)
    return on, build.plan(on)
