"""A robot's installation of rarms: a virtual environment that root owns, for this checkout's code."""

import shutil
import sysconfig
import tempfile
import venv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rarms_iac.model.version import __version__
from rarms_iac.providers import robot
from tests.needs import CHECKOUT, require


@contextmanager
def installed_rarms() -> Iterator[Path]:
    """The folder of all versions, in the place of /opt/rarms for this process; it has this version."""
    with tempfile.TemporaryDirectory(prefix="rarms-test-", dir="/opt") as folder, pytest.MonkeyPatch.context() as patch:
        Path(folder).chmod(0o755)
        install(Path(folder))
        patch.setattr(robot, "INSTALLED", folder)
        yield Path(folder)


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
    """An installation for all tests of this process."""
    require("ssh", "control-groups")
    with installed_rarms() as folder:
        yield folder
