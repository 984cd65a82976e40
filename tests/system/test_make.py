"""The first minute of a stranger: what `make` says where something is missing."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.needs import CHECKOUT

pytestmark = pytest.mark.needs("posix", "make")

TOOLS = ("bash", "cat", "cp", "dirname", "env", "make", "mktemp", "printf", "rm", "sed", "sh", "touch")
WITHOUT_VENV = '#!/bin/sh\ncase "$*" in *ensurepip*) exit 1 ;; esac\nexec {real} "$@"\n'
TOO_OLD = '#!/bin/sh\n[ "$1" = --version ] && echo "Python 3.9.2" && exit 0\nexit 1\n'


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """What `make` reads, in a folder without a virtual environment."""
    folder = tmp_path / "checkout"
    folder.mkdir()
    for name in ("Makefile", "pyproject.toml", "README.md"):
        shutil.copy(CHECKOUT / name, folder)
    shutil.copytree(CHECKOUT / "scripts", folder / "scripts")
    return folder


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """A folder that is all of PATH: the everyday tools, and Debian's installer."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for tool in TOOLS:
        (folder / tool).symlink_to(str(shutil.which(tool)))
    add_program(folder, "apt-get", "#!/bin/sh\nexit 1\n")
    return folder


def add_program(folder: Path, name: str, text: str) -> None:
    (folder / name).write_text(text, encoding="utf-8", newline="\n")
    (folder / name).chmod(0o755)


def make(checkout: Path, programs: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {"PATH": str(programs), "HOME": str(checkout.parent)}
    return subprocess.run(
        ["make", *arguments], cwd=checkout, env=environment, capture_output=True, text=True, encoding="utf-8"
    )


@pytest.mark.parametrize("target", ["demo", "test"])
def test_python_without_venv_is_named(checkout: Path, programs: Path, target: str) -> None:
    add_program(programs, "python3", WITHOUT_VENV.format(real=sys.executable))

    done = make(checkout, programs, target)

    assert done.returncode != 0
    assert "does not have its venv module" in done.stderr
    assert "apt install python3-venv" in done.stderr
    assert not (checkout / ".venv").exists()


@pytest.mark.parametrize("target", ["demo", "test"])
def test_no_python_at_all_says_what_to_install(checkout: Path, programs: Path, target: str) -> None:
    done = make(checkout, programs, target)

    assert done.returncode != 0
    assert "rarms needs Python 3.11 or newer; found none." in done.stderr
    assert "apt install python3 python3-venv" in done.stderr


def test_python_too_old_is_told_by_its_version(checkout: Path, programs: Path) -> None:
    add_program(programs, "python3", TOO_OLD)

    done = make(checkout, programs, "demo")

    assert done.returncode != 0
    assert "found Python 3.9.2" in done.stderr


def test_interpreter_named_by_user_is_only_one_tried(checkout: Path, programs: Path) -> None:
    add_program(programs, "python3", f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    add_program(programs, "old", TOO_OLD)

    done = make(checkout, programs, "demo", "PYTHON=old")

    assert done.returncode != 0
    assert "old: found Python 3.9.2" in done.stderr


def test_python_with_venv_is_preferred(checkout: Path, programs: Path) -> None:
    add_program(programs, "python3", WITHOUT_VENV.format(real=sys.executable))
    add_program(programs, "python3.12", '#!/bin/sh\n[ "$2" = venv ] && echo chosen >&2 && exit 9\nexit 0\n')

    done = make(checkout, programs, "demo")

    assert done.returncode != 0
    assert "chosen" in done.stderr


def test_make_alone_lists_what_it_can_do(checkout: Path, programs: Path) -> None:
    done = make(checkout, programs)

    assert done.returncode == 0
    for target in ("demo", "test", "test-long", "lint", "test-windows", "bench", "clean"):
        assert f"make {target} " in done.stdout


@pytest.mark.needs("network", "venv")
def test_demo_works_twice_in_a_fresh_checkout(tmp_path: Path) -> None:
    fresh = tmp_path / "fresh"
    shutil.copytree(CHECKOUT, fresh, ignore=shutil.ignore_patterns(".*", "__pycache__"))
    before = files_of(fresh)

    for _ in range(2):
        done = subprocess.run(
            ["make", "demo"],
            cwd=fresh,
            env=plain_environment(tmp_path),
            capture_output=True,
            text=True,
            encoding="utf-8",
        )
        assert done.returncode == 0, done.stdout + done.stderr
        assert "No drift." in done.stdout
        lines = done.stdout.splitlines()
        assert len(lines) <= 120
        assert max(map(len, lines)) <= 80
        excerpt = done.stdout.partition("$ rarms show --script")[2].partition("\n\n")[0]
        assert "New-VM -Name" in excerpt

    assert files_of(fresh) == before


def plain_environment(home: Path) -> dict[str, str]:
    """Nothing of this session but the way to the programs and to the package index."""
    kept = {
        name: value
        for name, value in os.environ.items()
        if name.startswith(("PIP_", "SSL_")) or "proxy" in name.lower()
    }
    return kept | {"PATH": os.defpath + ":/usr/local/bin", "HOME": str(home)}


def files_of(folder: Path) -> set[str]:
    """The files outside the virtual environment and Python's own caches."""
    names = (file.relative_to(folder) for file in folder.rglob("*") if file.is_file())
    return {name.as_posix() for name in names if not {".venv", "__pycache__"} & set(name.parts)}
