"""Stopping on the fake: a guest is asked for as long as the manifest says, and only a machine that runs is stopped."""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cache
from typing import ClassVar

import pytest

from rarms_iac.applying.run_script import run_job
from rarms_iac.applying.run_steps import RunControl
from rarms_iac.model.plan import Purpose
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.system import PartitionStop
from rarms_iac.providers.hyperv.provider import LiveHypervHost
from rarms_iac.providers.hyperv.transport import Listener
from rarms_iac.providers.interface import ScriptBundle, ScriptExited, ScriptLost, WaitLimits
from tests.builders import a_component, a_host, a_partition
from tests.fake_powershell.cell import Cell, apply, job_of, undo
from tests.fake_powershell.cells import a_cell_system, a_windows
from tests.fake_powershell.host import Vm, WindowsHost
from tests.fake_powershell.transport import FakePowerShellTransport

OTHER_STATES = ("Saved", "Paused", "Saving", "RunningCritical", "OffCritical")


def cell(processors: int, host: WindowsHost, grace_s: int = 120) -> Cell:
    request = replace(a_partition("vision"), stop=PartitionStop(grace=Milliseconds(Fraction(1000 * grace_s))))
    return Cell(
        a_cell_system(a_component("vision", reserve="10 %", processors=processors), partitions=(request,)), host
    )


def running() -> WindowsHost:
    return _running().copy()


@cache
def _running() -> WindowsHost:
    host = a_windows()
    assert apply(host, cell(1, host).plan()).code == 0
    return host


def the_machine(host: WindowsHost) -> Vm:
    (vm,) = host.vms.values()
    return vm


@pytest.mark.parametrize("grace_s", [0, 7, 300])
def test_guest_has_the_grace_of_the_manifest(grace_s: int) -> None:
    host = running()
    the_machine(host).obeys = False
    begun = host.clock
    plan = cell(2, host, grace_s).plan()
    script = plan.hosts[0].scripts["onboard.ps1"]

    ran = apply(host, plan)

    assert ran.code == 0, ran.says
    assert job_of(plan).script.longest_grace_ms == grace_s * 1000, "a silence that long is not an end"
    assert grace_s * 1000 <= host.clock - begun < (grace_s + 15) * 1000
    forced = {7: "3.5", 300: "150"}.get(grace_s)
    words = (
        f"shut down, after {forced} s forced, turned off after {grace_s} s"
        if forced
        else "turned off without a shutdown"
    )
    assert words in script
    assert the_machine(host).state == "Running"


class Patient(FakePowerShellTransport):
    """Tells how long it was to wait for a line."""

    silences: ClassVar[list[float]] = []

    def run(
        self, script: ScriptBundle, arguments: Sequence[str], silence_s: float, listener: Listener
    ) -> ScriptExited | ScriptLost:
        self.silences.append(silence_s)
        return FakePowerShellTransport.run(self, script, arguments, silence_s, listener)


def test_script_may_be_silent_while_guest_stops() -> None:
    plan = cell(2, running(), 300).plan()
    waits = WaitLimits(lock_ms=5_000, silence_ms=60_000)

    job = job_of(plan)
    run_job(LiveHypervHost(a_host("onboard"), Patient(running())), job, RunControl(waits=waits))

    assert Patient.silences == [365.0]


@pytest.mark.parametrize(
    ("grace_s", "guest", "stops_s", "says"),
    [
        (1200, {"needs_ms": 700_000}, 700, ""),
        (600, {"needs_ms": 30_000}, 30, ""),
        (200, {"needs_ms": 150_000}, 150, ""),
        (600, {"needs_ms": 900_000}, 600, ""),
        (120, {"needs_ms": 10_000, "unsaved": True}, 70, ""),
        (120, {"needs_ms": 10_000, "locked": True}, 70, "could not be asked"),
        (120, {"stop_fails": True}, 120, "The guest refused to shut down"),
        (120, {"needs_ms": 100_000}, 100, "could not be forced; waiting for it"),
    ],
)
def test_guest_is_asked_then_forced_then_cut(grace_s: int, guest: dict[str, object], stops_s: int, says: str) -> None:
    """It is forced from half of its grace on, and cut at its end, in spite of the cmdlet's own five minutes."""
    host = running()
    machine = the_machine(host)
    for name, value in guest.items():
        setattr(machine, name, value)
    begun = host.clock

    ran = apply(host, cell(2, host, grace_s).plan())

    assert ran.code == 0, ran.says
    assert stops_s * 1000 <= host.clock - begun < (stops_s + 20) * 1000
    assert machine.was_forced is bool({"unsaved", "locked"} & guest.keys())
    assert machine.was_cut is (machine.needs_ms > grace_s * 1000)
    assert says in ran.says
    assert ("could not be asked" in ran.says) is bool({"locked", "stop_fails"} & guest.keys())


def test_deaf_guest_is_turned_off_at_once() -> None:
    host = running()
    the_machine(host).shutdown_service = False
    begun = host.clock
    wanted = cell(2, host)
    told = wanted.prepare().findings

    ran = apply(host, wanted.plan())

    assert ran.code == 0, ran.says
    assert "RARMS255" in [finding.code for finding in told]
    assert host.clock - begun < 15_000


def test_starting_guest_is_asked_once_it_answers() -> None:
    host = running()
    plan = cell(2, host, 120).plan()
    machine = the_machine(host)
    machine.shutdown_service, machine.services_at = False, host.clock + 20_000
    begun = host.clock

    ran = apply(host, plan)

    assert ran.code == 0, ran.says
    assert 20_000 <= host.clock - begun < 40_000
    assert not machine.was_cut


@pytest.mark.parametrize("state", OTHER_STATES)
def test_machine_in_another_state_is_not_stopped(state: str) -> None:
    host = running()
    plan = cell(2, host).plan()
    the_machine(host).state = state

    ran = apply(host, plan)

    assert ran.code == 3, ran.says
    assert the_machine(host).state == state


@pytest.mark.parametrize("state", OTHER_STATES)
def test_machine_that_left_off_is_not_changed(state: str) -> None:
    host = running()
    the_machine(host).state = "Off"
    plan = cell(2, host).plan()
    the_machine(host).state = state

    ran = apply(host, plan)

    assert ran.code == 3, ran.says
    assert (the_machine(host).state, the_machine(host).processors) == (state, 1)


def test_paused_machine_is_turned_off_before_removal() -> None:
    host = running()
    the_machine(host).state = "Paused"
    begun = host.clock

    ran = apply(host, cell(1, host).plan(purpose=Purpose.DESTROY))

    assert ran.code == 0, ran.says
    assert host.vms == {}
    assert host.clock - begun < 60_000


def test_started_saved_machine_is_off_after_undo() -> None:
    host = running()
    the_machine(host).state = "Saved"
    plan = cell(1, host).plan()
    assert apply(host, plan).code == 0
    assert the_machine(host).state == "Running"

    ran = undo(host, plan)

    assert ran.code == 0, ran.says
    assert the_machine(host).state == "Off"
