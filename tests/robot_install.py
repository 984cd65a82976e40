"""A robot's installation of rarms: a virtual environment that root owns, for this checkout's code."""

import os
import shutil
import sysconfig
import tempfile
import venv
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from rarms_iac.model.version import __version__
from rarms_iac.providers.robot import INSTALLED
from tests.needs import CHECKOUT, require


def install(folder: Path, version: str = __version__) -> Path:
    """Copy the package, and find what it needs where the tests find it."""
    place = folder / version
    venv.create(place, symlinks=True)
    (packages,) = place.glob("lib/python3*/site-packages")
    shutil.copytree(CHECKOUT / "rarms_iac", packages / "rarms_iac", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("schemas", "manifests", "templates", "docs/findings"):
        shutil.copytree(CHECKOUT / name, packages / "rarms_iac" / "shipped" / name)
    (packages / "tests.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
    return packages


@pytest.fixture(scope="session")
def robot_rarms() -> Iterator[Path]:
    """The folder of all versions of a robot, for all tests of this process; it has this version."""
    require("ssh", "control-groups", "mounts")
    with tempfile.TemporaryDirectory(prefix="rarms-test-", dir="/opt") as folder:
        Path(folder).chmod(0o755)
        mask = os.umask(0o022)
        install(Path(folder))
        os.umask(mask)
        yield Path(folder)


def on_robot(installed: Path, words: Sequence[str], *mounts: str) -> list[str]:
    """Return the words that start a program as on a robot: this installation lies where rarms looks for it there.

    Args:
        installed: as of `robot_rarms`.
        mounts: shell commands that mount something more, for the program alone.
    """
    Path(INSTALLED).mkdir(exist_ok=True)
    commands = (f"mount --bind {installed} {INSTALLED}", *mounts, 'exec "$@"')
    return ["unshare", "-m", "sh", "-c", " && ".join(commands), "robot", *words]
