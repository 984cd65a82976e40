"""The templates, filled: every script that rarms makes, by its file's name, with each operation at least once."""

from collections.abc import Mapping
from dataclasses import replace

from rarms_iac.model.changes import Address
from rarms_iac.model.host import HypervHost
from rarms_iac.model.operations import RemoveDisk, WriteTaskClass, set_to
from rarms_iac.model.plan import GuestTask, HostPlan
from rarms_iac.model.setting import PartitionShape
from rarms_iac.powershell import measuring
from rarms_iac.powershell.render import render_observe, render_scripts
from rarms_iac.powershell.templates import ScriptForm, shipped_module
from rarms_iac.providers.hyperv.transport import render_installed_receiver, render_loader, render_receiver
from tests import builders_plan as build
from tests.unit.powershell.plans import rendered_plan


def _filled_plan() -> HostPlan:
    """Return one of every operation, and a task class of a guest that was not looked into."""
    host_plan, _ = rendered_plan()
    machine = Address(partition="vision", machine="0a1b2c3d-0000")
    values = build.task().values
    more = (
        build.step(
            Address(task="MotionControl"),
            operation=WriteTaskClass(task="MotionControl", inside="", values=values),
            before={"exists": True, "value:Clock Rate": "dword:10000"},
        ),
        build.step(machine, operation=RemoveDisk(partition="vision", path="D:\\v.vhdx", parent="D:\\p.vhdx")),
        build.step(machine, operation=set_to("vision", secure_boot="MicrosoftWindows")),
        replace(build.step(machine, operation=set_to("vision", reserve=40)), wait_ms=30_000),
    )
    guest = GuestTask(partition="planning", name="MotionControl", values=values, set="c" * 12, replace=True)
    return replace(host_plan, steps=(*host_plan.steps, *more), guest_tasks=(guest,))


HOST_PLAN = _filled_plan()


def scripts(form: ScriptForm = ScriptForm.MODULE) -> Mapping[str, bytes]:
    """Return the scripts of the plan, each with its undo."""
    return render_scripts(HOST_PLAN, build.plan(HOST_PLAN), form)


def measuring_script() -> bytes:
    """Return a script that makes a test partition and measures in it."""
    shape = PartitionShape(name="p1", processors=2, memory=2**30, limit=100, weight=100)
    settings = HypervHost(image="D:\\images\\robot's.vhdx", vm_path="D:\\vms", secure_boot="off")
    work = measuring.GuestWork(
        partition="p1", credential="robot", name="vision", kind="runs", words=("vision.exe", "-x", "a b")
    )
    host = replace(HOST_PLAN.host, hyperv=settings)
    return measuring.render_measuring(host, build.facts(), "robot", [shape], [work])


def everything() -> dict[str, bytes]:
    """Return all PowerShell that rarms makes, by a path; of scripts that hold their module two."""
    single = scripts(ScriptForm.SINGLE)
    return {
        **scripts(),
        **{f"single/{name}": single[name] for name in ("onboard.ps1", "onboard.undo.ps1")},
        **{f"Rarms/{name}": text.encode("ascii") for name, text in shipped_module().items()},
        "observe.ps1": render_observe(),
        "onboard.measure.ps1": measuring_script(),
        "loader.ps1": render_loader(),
        "bootstrap.ps1": render_receiver(),
        "receive.ps1": render_installed_receiver(),
    }
