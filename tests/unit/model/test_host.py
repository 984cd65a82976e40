"""What tells a machine from every other."""

import hashlib

import pytest

from rarms_iac.model.host import SchedulerType, SimulatedHost, host_identity

MACHINE = "5b0f6a3e-9d1c-4d57-8b7e-2f6a1c0d9e84"


def test_host_identity_is_a_digest() -> None:
    assert host_identity(MACHINE) == hashlib.sha256(f"rarms host {MACHINE}".encode()).hexdigest()[:32]


def test_identity_ignores_blanks_and_case() -> None:
    assert host_identity(f" {MACHINE.upper()}\n") == host_identity(MACHINE)
    assert host_identity(" \n") == ""


@pytest.mark.parametrize(
    ("host", "scheduler"),
    [
        (SimulatedHost(smt=True), SchedulerType.CORE),
        (SimulatedHost(smt=True, windows_build=14393), SchedulerType.CLASSIC),
        (SimulatedHost(smt=True, client=True), SchedulerType.CLASSIC),
        (SimulatedHost(smt=True, scheduler=SchedulerType.CLASSIC), SchedulerType.CLASSIC),
        (SimulatedHost(), SchedulerType.CLASSIC),
    ],
)
def test_simulated_server_has_its_windows_scheduler(host: SimulatedHost, scheduler: SchedulerType) -> None:
    assert host.scheduler_type is scheduler
