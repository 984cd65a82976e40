"""The loop without a Windows of ours: observe, plan, render, run what the scripts say, observe again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import date

from rarms_iac.applying.make_plan import PlanningResult, make_plan
from rarms_iac.applying.run_script import ScriptJob, apply_job
from rarms_iac.model.diagnostics import Places
from rarms_iac.model.plan import Plan
from rarms_iac.model.state import State
from rarms_iac.model.system import System
from rarms_iac.powershell.render import render_scripts, script_name
from rarms_iac.powershell.templates import MODULE_FOLDER, NEW_MODULE, ScriptForm, shipped_module
from tests.builders import PathPlaces
from tests.fake_powershell.host import WindowsHost
from tests.fake_powershell.observing import state_of
from tests.fake_powershell.run import Ran, put, run
from tests.planning import a_request

TODAY = date(2026, 11, 21)


@dataclass(frozen=True, slots=True)
class Cell:
    """A system of one Hyper-V host, and the stand-in for that host."""

    system: System
    host: WindowsHost
    places: Places = PathPlaces()

    @property
    def name(self) -> str:
        (name,) = self.system.hosts
        return name

    def observe(self) -> State:
        return state_of(self.host, self.name)

    def prepare(self, **asked: object) -> PlanningResult:
        request = a_request(self.system, places=self.places, today=TODAY, **asked)
        return make_plan(request, {self.name: self.observe()})

    def plan(self, **asked: object) -> Plan:
        prepared = self.prepare(**asked)
        assert prepared.plan is not None, prepared.findings
        return prepared.plan

    def on(self, host: WindowsHost) -> Cell:
        """This wish, on another host."""
        return replace(self, host=host)


def scripts_of(plan: Plan) -> Mapping[str, bytes]:
    """The scripts of its only host, as they lie in the plan."""
    (part,) = plan.hosts
    return {name: text.encode("ascii") for name, text in part.scripts.items()}


def with_module(scripts: Mapping[str, bytes]) -> Mapping[str, bytes]:
    """Scripts, and the module that lies beside them."""
    module = {f"{MODULE_FOLDER}/{name}": text.encode("ascii") for name, text in shipped_module().items()}
    return {**scripts, **module}


def in_one_file(plan: Plan) -> Plan:
    """The plan with scripts that hold their module."""
    (part,) = plan.hosts
    texts = {name: text.decode("ascii") for name, text in render_scripts(part, plan, ScriptForm.SINGLE).items()}
    return replace(plan, hosts=(replace(part, scripts=texts),))


def files_of(plan: Plan) -> Mapping[str, bytes]:
    """The scripts of its only host, with their module."""
    return with_module(scripts_of(plan))


def apply_script(plan: Plan) -> str:
    return script_name(plan.hosts[0])


def job_of(plan: Plan) -> ScriptJob:
    """The scripts of its only host, as `rarms apply` runs them."""
    (part,) = plan.hosts
    return apply_job(plan, part, part.scripts)


def undo_script(plan: Plan) -> str:
    return script_name(plan.hosts[0], undo=True)


def apply(host: WindowsHost, plan: Plan, **how: bool) -> Ran:
    """Lay the plan's scripts on the host and run the one for the host itself; a plan without one does nothing."""
    return _run_of(host, plan, apply_script(plan), **how)


def undo(host: WindowsHost, plan: Plan) -> Ran:
    """Lay the scripts on the host and run the undo script."""
    return _run_of(host, plan, undo_script(plan))


def _run_of(host: WindowsHost, plan: Plan, name: str, **how: bool) -> Ran:
    """As rarms runs it: nothing is asked, unless a test says so."""
    scripts = scripts_of(plan)
    if name not in scripts:
        return Ran(code=0, lines=(), talk=("the plan has no such script",))
    single = any(NEW_MODULE in text for text in plan.hosts[0].scripts.values())
    put(host, scripts if single else with_module(scripts))
    return run(host, name, **how)  # type: ignore[arg-type]  # names of options, said by tests
