"""Services below a real systemd, which is process 1 of a podman container with this computer's programs."""

import shutil
import subprocess
import sys
import uuid
from pathlib import Path

import pytest

from tests.needs import CHECKOUT

pytestmark = [pytest.mark.needs("control-groups", "podman", "systemd", "system-bus"), pytest.mark.alone]

PODMAN = (
    "podman --cgroup-manager=cgroupfs --runtime=runc run --rm --systemd=always --network=none "
    "--ulimit=nofile=1024:1024 --ulimit=nproc=1024:1024 --cap-add=SYS_ADMIN,SYS_NICE,SYS_RESOURCE"
)
SHARED = ("/usr", sys.base_prefix, str((CHECKOUT / ".venv").resolve()), str(CHECKOUT))
"""Folders of this computer that the container sees: its programs, its Python and this checkout."""

UNIT = """\
[Unit]
Requires=dbus.socket
After=dbus.socket basic.target
[Service]
Type=oneshot
TimeoutStartSec=infinity
StandardOutput=file:/out/said
StandardError=file:/out/said
WorkingDirectory={checkout}
Environment=PYTHONDONTWRITEBYTECODE=1
ExecStart=-{checkout}/.venv/bin/python -m pytest -p no:cacheprovider -p no:xdist -p no:cov -q \
    --basetemp=/tmp/pytest-in-container tests/linux_machine/transient.py
ExecStopPost=/usr/bin/systemctl exit
"""


def make_root(root: Path) -> None:
    """Make a root file system around the programs of this computer."""
    for name in ("etc/systemd/system", "dev", "proc", "sys", "tmp", "run", "var/lib", "var/log", "out"):
        (root / name).mkdir(parents=True)
    for name in ("bin", "sbin", "lib", "lib64"):
        (root / name).symlink_to(f"usr/{name}")
    for name in ("passwd", "group", "nsswitch.conf", "ld.so.cache"):
        shutil.copy(f"/etc/{name}", root / "etc")
    for name in ("alternatives", "dbus-1", "pam.d", "security"):
        shutil.copytree(f"/etc/{name}", root / "etc" / name, symlinks=True)
    (root / "etc" / "machine-id").touch()
    (root / "etc" / "systemd" / "system" / "job.service").write_text(UNIT.format(checkout=CHECKOUT), encoding="utf-8")


def test_services_below_systemd(tmp_path: Path) -> None:
    root, out, name = tmp_path / "root", tmp_path / "out", f"rarms-test-{uuid.uuid4().hex[:8]}"
    make_root(root)
    out.mkdir()
    volumes = [f"--volume={each}:{each}:ro" for each in dict.fromkeys(SHARED)]
    words = [*PODMAN.split(), f"--name={name}", *volumes, f"--volume={out}:/out"]
    try:
        started = [*words, "--rootfs", str(root), "/usr/lib/systemd/systemd", "--unit=job.service"]
        ended = subprocess.run(started, capture_output=True, text=True, timeout=600, check=False)
    finally:
        subprocess.run(["podman", "rm", "--force", "--ignore", "--time=0", name], capture_output=True, check=False)

    said = (out / "said").read_text(encoding="utf-8") if (out / "said").exists() else ended.stdout + ended.stderr
    assert " passed" in said, said
    assert "failed" not in said, said
    assert "error" not in said, said
