"""Transient services, and services that run already, below a real systemd. See `tests/system/test_services.py`.

pytest runs it in a container whose process 1 is systemd; nothing collects it elsewhere. Its control groups are those of
systemd alone, so nothing here says what the kernel gives to a service: `services.py` does.
"""

import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.app import install_there
from rarms_iac.app.install_there import WATCHER_PATH, WATCHER_UNIT, RobotPlaces
from rarms_iac.model.run import AttachedService, Run, SampleCount, Samples, Service, ServiceProperties, Stop, TimeField
from rarms_iac.providers.cgroups.attach_target import AttachTarget, find_target
from rarms_iac.providers.cgroups.attached import AttachedState
from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.providers.cgroups.trees import CONTROLLERS_V2, GroupTreeSystemd
from rarms_iac.running.component import ComponentRun
from rarms_iac.running.orders import CannotStart, ProcessPlace, StartContext
from tests.builders import a_run
from tests.needs import CHECKOUT
from tests.system.test_attached import Killed, MortalEffects

LINES = Samples(source="json_lines", response_time=TimeField(field="ms", unit="ms"))
WORKS = "while :; do echo '{\"ms\": 5}'; sleep 0.05; done"
SEEN = Path("/run/robot")
LEVEL = 'a "3" $HOME `b` \\ c'
"""What systemd reads in files of variables as more than letters."""


@pytest.fixture(autouse=True)
def seen() -> Iterator[None]:
    """A folder that everybody may write to."""
    SEEN.mkdir()
    SEEN.chmod(0o1777)
    yield
    shutil.rmtree(SEEN)


def output(*words: str) -> str:
    return subprocess.run(words, check=True, capture_output=True, text=True).stdout.strip()


def units() -> list[str]:
    listed = output("systemctl", "list-units", "--plain", "--no-legend", "rarms-camera-*.service")
    return [line.split()[0] for line in listed.splitlines()]


def service(script: str, properties: ServiceProperties, *, stop: Stop | None = None, failures: int = 0) -> Run:
    made = Service(exec=("/bin/sh", "-c", script), properties=properties)
    run = a_run(command=(), samples=LINES, until=SampleCount(samples=2), failures=failures)
    return replace(run, service=made, stop=stop or Stop())


def test_properties_and_variables_reach_the_unit() -> None:
    properties = ServiceProperties(
        environment=("OF_UNIT=1", "LEVEL=0"),
        supplementary_groups=("video",),
        working_directory=str(SEEN),
        limit_memlock="8M",
        nice=3,
        restart="on-failure",
    )
    script = f"(env; cat /proc/self/cgroup; ulimit -l; nice; id -un; id -Gn; pwd) >{SEEN}/said; {WORKS}"
    variables = {"LD_DEBUG": "files", "LD_DEBUG_OUTPUT": f"{SEEN}/loader", "LEVEL": LEVEL}
    run = replace(service(script, properties), user="nobody", environment=variables)
    context = StartContext(base=SEEN, inside=ProcessPlace(parent="rarms-camera.slice"))

    with ComponentRun("camera", run, context) as running:
        next(running)
        (unit,) = units()
        asked = "Slice,Restart,KillSignal,TimeoutStopUSec,Environment"
        shown = output("systemctl", "show", f"--property={asked}", unit).splitlines()
        (file,) = Path("/run").glob("rarms-camera-*.env")
        mode = file.stat().st_mode & 0o777
        list(running)

    assert {"Slice=rarms-camera.slice", "Restart=on-failure", "KillSignal=15", "TimeoutStopUSec=5s"} <= {*shown}
    assert "Environment=OF_UNIT=1 LEVEL=0" in shown, "everybody can read these: the others are in the file"
    assert mode == 0o600
    assert not file.exists()
    said = (SEEN / "said").read_text(encoding="utf-8").splitlines()
    assert {f"LEVEL={LEVEL}", "OF_UNIT=1"} <= {*said}
    assert any(line.endswith(f"/rarms.slice/rarms-camera.slice/{unit}") for line in said)
    assert said[-5:] == ["8192", "3", "nobody", "nogroup video", str(SEEN)]
    loaded = "".join(each.read_text(errors="replace") for each in SEEN.glob("loader.*"))
    assert "program: /bin/sh" in loaded
    assert "systemd-run" not in loaded, "root's own programs have no variable of the component"
    assert "systemctl" not in loaded
    assert units() == []
    assert running.series().cpu_ms is None, "the time of systemd-run is not the component's"


def test_killed_service_with_restart_does_not_survive() -> None:
    run = service(f"echo >>{SEEN}/starts; {WORKS}", ServiceProperties(restart="always"), stop=Stop(signal="KILL"))

    with ComponentRun("camera", run, StartContext(base=SEEN)) as running:
        assert len(list(running)) == 2
    time.sleep(1)  # systemd starts such a service again after 0.1 s

    assert units() == []
    assert (SEEN / "starts").read_text(encoding="ascii") == "\n"


def test_service_ends_with_its_killed_client() -> None:
    run = replace(service(WORKS, ServiceProperties(restart="always"), failures=1), until=SampleCount(samples=10_000))

    with ComponentRun("camera", run, StartContext(base=SEEN)) as running:
        next(running)
        (unit,) = units()
        output("pkill", "--parent", str(running.process), "--signal", "KILL", "systemd-run")
        assert next(sample.failure for sample in running if sample.failure) == "it was killed by SIGKILL"
        assert unit not in units()
    assert units() == []


EFFECTS = LinuxEffects()
TREE = GroupTreeSystemd(EFFECTS, dict.fromkeys((*CONTROLLERS_V2, "cpuacct"), Path("/sys/fs/cgroup/systemd/x.slice")))
CPU = "CPUWeight,CPUQuotaPerSecUSec,CPUQuotaPeriodUSec"


class MortalPrograms(MortalEffects):
    """Each call of systemd that changes something may be the last one, too."""

    def run(self, *words: str, may_fail: bool = False) -> None:
        self._count()
        super().run(*words, may_fail=may_fail)


@contextmanager
def running_service(unit: str, *properties: str) -> Iterator[None]:
    words = (f"--unit={unit}", *(f"--property={each}" for each in properties))
    output("systemd-run", "--quiet", "--collect", *words, "/bin/sh", "-c", WORKS)
    try:
        yield
    finally:
        output("systemctl", "stop", unit)


def shown() -> list[str]:
    return output("systemctl", "show", f"--property={CPU}", "nav2").split("\n")


def target(service: str = "nav2") -> AttachTarget:
    return find_target("nav2", AttachedService(service=service), TREE, EFFECTS)


def state(effects: LinuxEffects = EFFECTS) -> AttachedState:
    return AttachedState("onboard", SEEN, effects)


@pytest.mark.parametrize("properties", [(), ("CPUWeight=30", "CPUQuota=150%", "CPUQuotaPeriodSec=50ms")])
def test_held_service_gets_back_its_properties(properties: tuple[str, ...]) -> None:
    with running_service("nav2", *properties):
        before, group = shown(), output("systemctl", "show", "--property=ControlGroup", "nav2")

        state().hold(target(), TREE, "x", 60.0, "boot")
        held, where, named = shown(), output("systemctl", "show", "--property=ControlGroup", "nav2"), state().record()
        state().restore(TREE, "boot")

        assert held == ["CPUWeight=10000", "CPUQuotaPerSecUSec=600ms", "CPUQuotaPeriodUSec=20ms"]
        assert where == group, "nothing is moved"
        assert named is not None
        assert named.title == "the service nav2"
        assert shown() == before
        assert state().record() is None
        assert not [*Path("/run/systemd/system.control").glob("nav2*")]


def is_killed(at: int) -> bool:
    mortal = state(MortalPrograms(at))
    try:
        mortal.hold(target(), TREE, "x", 60.0, "boot")
        mortal.restore(TREE, "boot")
    except Killed:
        return True
    return False


def test_service_killed_at_each_change_is_given_back() -> None:
    at = 1
    with running_service("nav2", "CPUWeight=30", "CPUQuota=150%"):
        before = shown()
        while is_killed(at):
            assert at == 1 or state().record() is not None
            state().restore(TREE, "boot")
            assert shown() == before, at
            at += 1

    assert at > 6


def refused(service: str) -> str:
    with pytest.raises(CannotStart) as caught:
        target(service)
    return caught.value.message


def test_services_that_cannot_be_held_are_refused() -> None:
    with running_service("nav2@1"):
        assert refused("nav2") == "the service nav2.service is not running, but its instance nav2@1.service is"
        assert target("nav2@1").unit == "nav2@1.service"
        assert refused("nobody") == "the service nobody.service is not running"
        with running_service("nav2@2"):
            assert "several services have the name nav2: nav2@1.service, nav2@2.service" in refused("nav2")


def awaited(unit: str, wanted: str) -> None:
    until = time.monotonic() + 60
    while (found := output("systemctl", "show", "--property=ActiveState", "--value", unit)) != wanted:
        assert time.monotonic() < until, found
        time.sleep(0.2)


def test_watcher_runs_while_there_are_rules() -> None:
    (SEEN / "current").symlink_to(CHECKOUT / ".venv")
    places = RobotPlaces(versions=str(SEEN))
    rules = Path(places.state) / "rarms.threads"
    install_there._install_boot(places)
    try:
        awaited(WATCHER_PATH, "active")
        awaited(WATCHER_UNIT, "inactive")
        rules.parent.mkdir(exist_ok=True)
        rules.write_text('{"/sys/fs/cgroup/rarms.slice/rarms-arm.slice": "controller* at 21"}', encoding="ascii")
        awaited(WATCHER_UNIT, "active")
        rules.unlink()
        awaited(WATCHER_UNIT, "inactive")
        result = output("systemctl", "show", "--property=Result", "--value", WATCHER_UNIT)
    finally:
        rules.unlink(missing_ok=True)
        install_there._remove_boot(places)

    assert result == "success"
    assert not any(file.exists() for file in places.boot_files)
    awaited(WATCHER_PATH, "inactive")
