"""Processes of this machine: what they consumed, and who left them behind."""

import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import ProviderKind
from rarms_iac.providers.cgroups.measuring import LinuxMeasuringHost
from rarms_iac.providers.cgroups.processes import consumed_ms, orphans
from rarms_iac.running.component import ComponentRun
from rarms_iac.running.kernel_files import read_process
from rarms_iac.running.start import StartContext
from tests.builders import a_host
from tests.contracts.benches import forget_groups, groups_of
from tests.contracts.test_measuring_contract import ready
from tests.unit.running.programs import a_run

pytestmark = pytest.mark.needs("linux")
BUSY = """
import subprocess, sys, time
quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
helper = subprocess.Popen([sys.executable, "-c", "while True: pass"], **quiet)
while True:
    say('{"ms": 1}')
    time.sleep(0.05)
"""


def test_consumption_counts_all_started_processes(tmp_path: Path) -> None:
    with ComponentRun("busy", a_run(BUSY, until=10_000), StartContext(base=tmp_path)) as run:
        next(run)
        assert run.process is not None
        before, until = consumed_ms(run.process), time.perf_counter() + 30
        while consumed_ms(run.process) < before + 100 and time.perf_counter() < until:
            next(run)
        after = consumed_ms(run.process)

    assert after >= before + 100
    assert consumed_ms(run.process) == 0, "it is gone"


def test_process_is_known_by_its_name_and_parent() -> None:
    own = read_process(os.getpid())

    assert own is not None
    assert own.parent == os.getppid()
    assert read_process(2**22 + 1) is None


def orphan_findings(host: LinuxMeasuringHost) -> list[Diagnostic]:
    return [finding for finding in host.examined().findings if finding.code == "RARMS168"]


@pytest.mark.needs("control-groups")
@pytest.mark.alone
def test_doctor_names_what_killed_supervisor_left_in_partition(tmp_path: Path) -> None:
    described, groups = a_host(provider=ProviderKind.LINUX, keep_processor="5 %"), groups_of(tmp_path)
    host = LinuxMeasuringHost(described, tmp_path, tmp_path / "state", groups)
    with ready(host):
        context = replace(StartContext(base=tmp_path), inside=groups.place("rarms-p1"))
        with ComponentRun("busy", a_run(BUSY, until=10_000), context) as run:
            next(run)
            assert orphans(groups.processes("rarms-p1")) == ()
            assert orphan_findings(host) == []
            os.kill(run.process or 0, signal.SIGKILL)
            until = time.perf_counter() + 20
            while not (left_over := orphan_findings(host)) and time.perf_counter() < until:
                time.sleep(0.02)
    forget_groups(tmp_path)

    (finding,) = left_over
    assert "(python" in finding.detail
    assert groups.names() == ()
