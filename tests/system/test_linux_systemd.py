"""Linux hosts in an emulated machine with systemd: the operator's way, and a restart of the machine; see machine.py."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from rarms_iac.app import install
from rarms_iac.app.install_there import RobotPlaces
from tests.linux_machine.machine import CommandResult, run_in_machine, run_tests_in_machine
from tests.system.test_linux_walk import MANIFEST
from tests.unit.cli.running import rarms

pytestmark = pytest.mark.needs("linux-machine", "systemd", "long")

WALK = ("tests/system/test_linux_walk.py",)
SERVICES = ("--noconftest", "-p", "no:hypothesispytest", "tests/linux_machine/services.py")  # its imports take 15 s
START_BUS = """\
touch /etc/.updated /var/.updated # nothing is to be brought up to date at this start
systemctl start dbus.socket systemd-journald.service # and all that services need
systemctl start --job-mode=ignore-dependencies dbus.service
"""
PARTITIONS = """\
  navigation: { components: [navigation] }
  speech: { components: [speech], start: manual }
"""
"""A start of the machine leaves the second one off."""

COMPONENT = "  navigation: { criticality: 3, memory: 64 MiB, cpu: { reserve: 10 % } }\npartitions:"

INSTALL = """\
set -e
mkdir -p /opt/rarms
mount --bind INSTALLED /opt/rarms
"""

APPLY = f"""\
{INSTALL}
mkdir -p /run/robot
cat >/run/robot/rarms.yaml <<'END'
{MANIFEST.format(slice="rarms").replace("partitions:", COMPONENT)}{PARTITIONS}
END
.venv/bin/rarms install -f /run/robot
systemctl is-enabled rarms-boot.service
/opt/rarms/current/bin/rarms apply -f /run/robot --auto-approve
/opt/rarms/current/bin/rarms start -f /run/robot --auto-approve speech
grep . /sys/fs/cgroup/rarms.slice/*/cpu.weight
cp /run/robot/rarms.yaml /etc/systemd
rm /etc/systemd/system/multi-user.target.wants/rarms-navigation.slice # the boot unit of rarms starts it
tar -cf /run/job/disk.tar -C / etc/systemd var/lib/rarms
"""

AFTER_RESTART = f"""\
ls -d /sys/fs/cgroup/rarms.slice && exit 51
{INSTALL}
systemctl start --no-block multi-user.target
for _ in $(seq 60); do
    sleep 1
    [ ! -e /sys/fs/cgroup/rarms.slice/rarms-face_detection.slice/memory.max ] || break
done
systemctl cancel # what else this computer starts is not needed
systemctl list-dependencies --plain multi-user.target | grep rarms
systemctl start --job-mode=ignore-dependencies rarms-boot.service || exit 53 # sysinit.target is cancelled
cd /sys/fs/cgroup/rarms.slice || exit 52
grep . cpu.max */cpu.weight */cpu.max */memory.max
cd -
/opt/rarms/current/bin/rarms plan -f /etc/systemd
"""


@pytest.fixture
def installed(tmp_path: Path) -> Iterator[Path]:
    """The folder of all versions of a robot, of which the machine sees a copy; it has this version."""
    manifest = MANIFEST.format(slice="rarms")
    (tmp_path / "rarms.yaml").write_text(manifest, encoding="utf-8")
    with tempfile.TemporaryDirectory(prefix="rarms-test-", dir="/opt") as folder, pytest.MonkeyPatch.context() as patch:
        root = Path(folder)
        names = ("versions", "state", "units", "systemd", "cron")
        patch.setattr(install, "PLACES", RobotPlaces(**{name: str(root / name) for name in names}))
        ended = rarms("install", "-f", str(tmp_path), "--wheels", str(tmp_path / "wheels"))
        assert ended.code == 0, ended.err
        assert "systemd and cron are not available" in " ".join(ended.out.split())
        yield root / "versions"


def test_systemd_partitions_are_units(tmp_path: Path) -> None:
    result = run_tests_in_machine(WALK, timeout_s=1200, disk=tmp_path / "disk.tar")

    assert result.exit_code == 0, result.output
    assert " passed" in result.output


@pytest.mark.needs("podman", "system-bus")
def test_services_and_what_runs_already(tmp_path: Path) -> None:
    result = run_tests_in_machine(SERVICES, timeout_s=1800, before=START_BUS, disk=tmp_path / "disk.tar")

    assert result.exit_code == 0, result.output
    assert " passed" in result.output


@pytest.mark.needs("network", "root")
def test_restart_keeps_partitions_except_manual_ones(tmp_path: Path, installed: Path) -> None:
    def in_machine(script: str) -> CommandResult:
        script = script.replace("INSTALLED", str(installed))
        return run_in_machine(script, timeout_s=900, disk=tmp_path / "disk.tar")

    applied = in_machine(APPLY)
    assert applied.exit_code == 0, applied.output
    assert "enabled" in applied.output
    assert "rarms-speech.slice/cpu.weight:" in applied.output

    restarted = in_machine(AFTER_RESTART)

    assert restarted.exit_code == 0, restarted.output
    kernel = "cpu.max:36000 20000", "rarms-face_detection.slice/cpu.weight:80", "rarms-face_detection.slice/cpu.max:"
    assert all(line in restarted.output for line in kernel), restarted.output
    assert "rarms-boot.service" in restarted.output, "multi-user.target wants it"
    assert "rarms-navigation.slice/cpu.weight:" in restarted.output
    assert "rarms-speech.slice" not in restarted.output
