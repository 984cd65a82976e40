"""The collection rarms.fleet under Ansible's own checks of collections."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.needs import CHECKOUT

COLLECTION = Path("ansible_collections") / "rarms" / "fleet"
PIP = "get_pip_24_2.py"
"""What ansible-test 2.19 fetches to put pip into an environment; Python has the same in `ensurepip`."""

COVERED = ["--skip-test", "pylint", "--skip-test", "yamllint", "--skip-test", "pep8"]
"""Each is put into an environment of its own, which takes long; `make lint` holds the same files to ruff."""


@pytest.mark.needs("ansible", "posix", "network", "venv")
def test_ansible_test_finds_nothing(tmp_path: Path) -> None:
    shutil.copytree(
        CHECKOUT / "ansible" / COLLECTION,
        tmp_path / COLLECTION,
        ignore=shutil.ignore_patterns("__pycache__", "output"),
    )
    cache = tmp_path / ".ansible" / "test" / "cache"
    cache.mkdir(parents=True)
    (cache / PIP).write_text("import ensurepip\nensurepip.bootstrap(default_pip=True)\n", encoding="utf-8")
    program = Path(sys.executable).parent
    version = f"{sys.version_info.major}.{sys.version_info.minor}"

    ran = subprocess.run(
        [str(program / "ansible-test"), "sanity", "--local", "--python", version, "--color", "no", *COVERED],
        cwd=tmp_path / COLLECTION,
        env={
            **os.environ,
            "HOME": str(tmp_path),
            "PIP_CONFIG_FILE": os.environ.get("PIP_CONFIG_FILE", str(Path.home() / ".config" / "pip" / "pip.conf")),
            "PATH": f"{program}{os.pathsep}{os.environ['PATH']}",
            "LC_ALL": "C.UTF-8",
        },
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        timeout=540,
    )

    assert ran.returncode == 0, ran.stdout[-5000:] + ran.stderr[-5000:]
    assert 'Running sanity test "validate-modules"' in ran.stdout + ran.stderr
