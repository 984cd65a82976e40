"""What reaches a user: the wheel, installed in a fresh environment, does the main job from an empty folder."""

import io
import json
import os
import re
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

from benchmarks.compiled import build_wheel, difference, run_in
from rarms_iac.app.install_wheels import own_wheel
from rarms_iac.storage.shipped import SHIPPED, shipped_files
from tests.needs import CHECKOUT


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "build", "--wheel", "--outdir", str(folder), str(CHECKOUT)]
    done = subprocess.run(build, capture_output=True, text=True, encoding="utf-8")
    assert done.returncode == 0, done.stdout + done.stderr
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs of an environment that holds the wheel and what it asks for, nothing else."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False)
    programs = folder / ("Scripts" if sys.platform == "win32" else "bin")
    install = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        str(programs / "python"),
        "install",
        "--quiet",
        "--no-compile",
        str(wheel),
    ]
    done = subprocess.run(install, capture_output=True, text=True, encoding="utf-8")
    assert done.returncode == 0, done.stdout + done.stderr
    return programs


def run(programs: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A command as a user types it, with nothing of this checkout within reach."""
    environment = {"PATH": f"{programs}{os.pathsep}{os.defpath}", "HOME": str(folder.parent), "PYTHONUTF8": "1"}
    command = [str(programs / words[0]), *words[1:]]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, encoding="utf-8", stdin=subprocess.DEVNULL
    )


MAIN_JOB = (
    ("rarms", "init"),
    ("rarms", "validate"),
    ("rarms", "plan", "--out", "robot.plan"),
    ("rarms", "apply", "--auto-approve"),
    ("rarms", "plan"),
)
"""A new manifest, sound, planned, applied, and nothing left to do."""


def failures_of_main_job(programs: Path, folder: Path) -> list[str]:
    """What went wrong, a text for each command that did not end with 0."""
    runs = [(words, run(programs, folder, *words)) for words in MAIN_JOB]
    return [f"{words}: {done.returncode}\n{done.stdout}{done.stderr}" for words, done in runs if done.returncode]


@pytest.mark.needs("network", "venv")
@pytest.mark.sample
def test_wheel_does_main_job_from_empty_folder(installed: Path, tmp_path: Path) -> None:
    assert failures_of_main_job(installed, tmp_path) == []


@pytest.mark.needs("network", "venv")
def test_package_of_fresh_environment_is_wheels(installed: Path, tmp_path: Path) -> None:
    found = run(installed, tmp_path, "python", "-c", "import rarms_iac; print(rarms_iac.__file__)")

    assert Path(found.stdout.strip()).is_relative_to(installed.parent)


@pytest.mark.needs("network", "venv")
def test_pages_and_schemas_are_found_in_installed_wheel(installed: Path, tmp_path: Path) -> None:
    explained = run(installed, tmp_path, "rarms", "explain", "RARMS014")
    schema = run(installed, tmp_path, "rarms", "schema")

    assert explained.returncode == 0, explained.stderr
    assert "Reservations exceed the platform" in explained.stdout
    assert schema.returncode == 0, schema.stderr
    assert "$schema" in json.loads(schema.stdout)


@pytest.mark.needs("network", "venv")
def test_what_lies_beside_package_travels_in_wheel(wheel: Path) -> None:
    travelling = zipfile.ZipFile(wheel)
    assert "rarms_iac/py.typed" in travelling.namelist(), "a program that imports it is checked against its types"
    held = {name: travelling.read(name) for name in travelling.namelist() if "/shipped/" in name}

    for name in SHIPPED:
        path = CHECKOUT / name
        for file in [path] if path.is_file() else sorted(path.rglob("*")):
            hidden = any(part.startswith(".") for part in file.relative_to(CHECKOUT).parts)
            if file.is_file() and not hidden and "__pycache__" not in file.parts:
                travelled = f"rarms_iac/shipped/{file.relative_to(CHECKOUT).as_posix()}"
                assert held.get(travelled) == file.read_bytes(), travelled


def test_wheel_that_rarms_makes_has_same_files(wheel: Path) -> None:
    built, made = zipfile.ZipFile(wheel), zipfile.ZipFile(io.BytesIO(own_wheel().content))
    own = {name for name in built.namelist() if not name.startswith("rarms_iac-")}

    assert {name for name in made.namelist() if not name.startswith("rarms_iac-")} == own
    assert all(made.read(name) == built.read(name) for name in own)


def test_the_editable_install_does_the_main_job_too(tmp_path: Path) -> None:
    assert failures_of_main_job(Path(sys.executable).parent, tmp_path) == []


@pytest.mark.needs("network", "venv", "c-compiler")
def test_compiled_wheel_runs_same_jobs(tmp_path: Path) -> None:
    zipfile.ZipFile(build_wheel(tmp_path)).extractall(tmp_path / "compiled")

    plain, compiled = run_in(CHECKOUT, 5, 2_000), run_in(tmp_path / "compiled", 5, 2_000)

    assert (plain.compiled, compiled.compiled) == (False, True)
    assert min(map(len, plain.jobs.values())) >= 1
    assert difference(plain, compiled) <= 1e-9


def test_compiled_files_stay_out_of_wheel_for_robots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "rarms_iac").mkdir()
    for name in ("__init__.py", "fast.cpython-311-x86_64-linux-gnu.so", "fast.pyd"):
        (tmp_path / "rarms_iac" / name).write_bytes(b"")
    monkeypatch.setattr("rarms_iac.storage.shipped._PACKAGE", tmp_path / "rarms_iac")
    monkeypatch.setattr("rarms_iac.storage.shipped.SHIPPED", ())

    assert [name for name, _ in shipped_files()] == ["rarms_iac/__init__.py"]


@pytest.mark.needs("network", "venv")
def test_documented_program_passes_strict_types(installed: Path, tmp_path: Path) -> None:
    page = (CHECKOUT / "docs" / "library.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    (tmp_path / "program.py").write_text("\n".join(blocks), encoding="utf-8")
    python = ("--python-executable", str(installed / "python"))
    check = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", "cache", *python, "program.py"]

    done = subprocess.run(check, cwd=tmp_path, capture_output=True, text=True, encoding="utf-8")

    assert len(blocks) >= 4
    assert done.returncode == 0, done.stdout + done.stderr
