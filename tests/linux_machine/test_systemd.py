"""Linux hosts in an emulated machine with systemd: the operator's way, and a restart of the machine; see machine.py."""

from pathlib import Path

import pytest

from tests.linux_machine.machine import run_in_machine
from tests.system.test_linux_walk import MANIFEST

pytestmark = pytest.mark.needs("linux-machine", "systemd", "long")

WALK = (
    ".venv/bin/python -m pytest -p no:cacheprovider -p no:xdist -p no:cov -q --durations=5 "
    "--basetemp=/tmp/pytest-in-machine tests/system/test_linux_walk.py"
)
START_BY_HAND = "speech: { components: [speech], start: manual }"
"""A partition that a start of the machine leaves off."""

APPLY = f"""\
set -e
mkdir -p /run/robot
cat >/run/robot/rarms.yaml <<'END'
{MANIFEST.format(slice="rarms")}  {START_BY_HAND}
END
.venv/bin/rarms apply -f /run/robot --auto-approve
.venv/bin/rarms start -f /run/robot --auto-approve speech
grep . /sys/fs/cgroup/rarms.slice/*/cpu.weight
cp /run/robot/rarms.yaml /etc/systemd
tar -cf /run/job/disk.tar -C / etc/systemd var/lib/rarms
"""

AFTER_RESTART = """\
ls -d /sys/fs/cgroup/rarms.slice && exit 51
systemctl start --no-block multi-user.target
for _ in $(seq 60); do
    sleep 1
    [ ! -e /sys/fs/cgroup/rarms.slice/rarms-face_detection.slice/memory.max ] || break
done
systemctl cancel # what else this computer starts is not needed
cd /sys/fs/cgroup/rarms.slice || exit 52
grep . cpu.max */cpu.weight */cpu.max */memory.max
cd -
.venv/bin/rarms plan -f /etc/systemd
"""


def test_below_systemd_partitions_are_units_for_rarms_and_for_its_script(tmp_path: Path) -> None:
    result = run_in_machine(WALK, timeout_s=1200, disk=tmp_path / "disk.tar")

    assert result.exit_code == 0, result.output
    assert " passed" in result.output


def test_a_restart_of_the_machine_keeps_partitions_but_those_that_start_by_hand(tmp_path: Path) -> None:
    applied = run_in_machine(APPLY, timeout_s=600, disk=tmp_path / "disk.tar")
    assert applied.exit_code == 0, applied.output
    assert "rarms-speech.slice/cpu.weight:" in applied.output

    restarted = run_in_machine(AFTER_RESTART, timeout_s=600, disk=tmp_path / "disk.tar")

    assert restarted.exit_code == 0, restarted.output
    kernel = "cpu.max:36000 20000", "rarms-face_detection.slice/cpu.weight:80", "rarms-face_detection.slice/cpu.max:"
    assert all(line in restarted.output for line in kernel), restarted.output
    assert "rarms-speech.slice" not in restarted.output
