"""The wheels for a robot: of the lock, for its Python and processor, each with a hash of the lock."""

import hashlib
from pathlib import Path

import pytest

from rarms_iac.app import install_wheels
from rarms_iac.app.install_wheels import LOCK, RobotPython, build_name, pins_for, wheels_for
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.storage.shipped import shipped_text

JETSON = RobotPython(version="3.12.3", machine="aarch64", glibc=(2, 39))
DEBIAN = RobotPython(version="3.11.2", machine="x86_64", glibc=(2, 36))


def name_of(robot: RobotPython, platform: str) -> str:
    python = f"cp{robot.short_version.replace('.', '')}"
    return f"solver-1.0-{python}-{python}-{platform}_{robot.machine}.whl"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Wheels of one package for two robots, old and new; the lock has all of them."""
    digests = []
    for robot in (JETSON, DEBIAN):
        for platform in ("manylinux2014", "manylinux_2_28", "manylinux_2_99"):
            content = f"{robot.machine} {platform}".encode()
            (tmp_path / name_of(robot, platform)).write_bytes(content)
            digests.append(hashlib.sha256(content).hexdigest())
    hashes = "".join(f" --hash=sha256:{digest}" for digest in digests)
    lock = f"solver==1.0 ; python_full_version >= '3.11'{hashes}\nold==2.0 ; python_full_version < '3.11'{hashes}\n"
    monkeypatch.setattr(install_wheels, "shipped_text", lambda _path: lock)
    return tmp_path


@pytest.mark.parametrize("robot", [JETSON, DEBIAN], ids=["aarch64", "x86_64"])
def test_newest_wheel_that_runs_on_robot_is_taken(robot: RobotPython, folder: Path) -> None:
    own, solver = wheels_for(robot, folder)

    assert own.name.startswith("rarms_iac-")
    assert (solver.name, solver.content) == (
        name_of(robot, "manylinux_2_28"),
        f"{robot.machine} manylinux_2_28".encode(),
    )


def test_wheel_without_hash_of_lock_is_refused(folder: Path) -> None:
    damaged = folder / name_of(JETSON, "manylinux_2_28")
    damaged.write_bytes(b"replaced")

    with pytest.raises(UseCaseError) as refused:
        wheels_for(JETSON, folder)

    (finding,) = refused.value.findings
    assert finding.code == "RARMS415"
    assert f"{damaged} does not have a SHA-256 of {LOCK}" in finding.detail


def test_lock_has_one_version_of_each_package() -> None:
    lock = shipped_text(LOCK)
    for version in ("3.11.2", "3.12.3", "3.13.0", "3.14.0"):
        names = [pin.name for pin in pins_for(lock, RobotPython(version=version, machine="aarch64", glibc=(2, 36)))]
        assert len(names) == len(set(names)), version
        assert {"pip", "numpy", "highspy", "pydantic", "pyyaml"} <= set(names)
        assert "hatchling" not in names


def test_builds_of_different_robots_have_different_names() -> None:
    assert build_name(JETSON) == build_name(JETSON)
    assert build_name(JETSON) != build_name(DEBIAN)
