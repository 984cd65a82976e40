"""The wheels that a robot needs: those of the lock for its own Python and processor, and rarms itself.

In: what a robot says of its Python. Out: paths of wheels, each with its SHA-256. The lock (`locked-requirements.txt`)
has the versions and the hashes; which index pip asks is pip's own configuration.
"""

import hashlib
import io
import re
import subprocess
import sys
import zipfile
from base64 import urlsafe_b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.model.commands import Wording
from rarms_iac.model.version import __version__
from rarms_iac.storage.reading import read_file
from rarms_iac.storage.shipped import shipped_files, shipped_text
from rarms_iac.storage.writing import hold, owner
from rarms_iac.texts.findings import Finding

LOCK = "locked-requirements.txt"
MOST_WHEEL_BYTES = 256 * 2**20
PIP = "pip"
WAIT_MS = 1_800_000
"""How long to wait for another process that downloads into the same folder: Ansible installs on robots side by side."""
_BUILDS = "# To build rarms\n"
_OLDEST_GLIBC = {"x86_64": 5, "aarch64": 17}
"""The minor version of glibc with which wheels for a processor begin."""
_OLD_NAMES = {5: "manylinux1", 12: "manylinux2010", 17: "manylinux2014"}
_LAST_LINES = 4  # of pip

INCOMPLETE = Finding.error("RARMS415", "The wheels for a robot are not complete")


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotPython:
    """The Python of a robot, which runs rarms there."""

    version: str  # 3.11.2
    machine: str  # x86_64 or aarch64
    glibc: tuple[int, int]

    @property
    def short_version(self) -> str:
        """The part of the version that wheels know: `3.11`."""
        return ".".join(self.version.split(".")[:2])

    @property
    def platforms(self) -> tuple[str, ...]:
        """The platform tags of wheels that run there, the newest first."""
        names = []
        for minor in range(self.glibc[1], _OLDEST_GLIBC[self.machine] - 1, -1):
            names += [f"manylinux_2_{minor}", *filter(None, [_OLD_NAMES.get(minor)])]
        return tuple(f"{name}_{self.machine}" for name in names)

    @property
    def environment(self) -> dict[str, str]:
        """The values of its environment markers."""
        return {
            "implementation_name": "cpython",
            "implementation_version": self.version,
            "os_name": "posix",
            "platform_machine": self.machine,
            "platform_python_implementation": "CPython",
            "platform_release": "",
            "platform_system": "Linux",
            "platform_version": "",
            "python_full_version": self.version,
            "python_version": self.short_version,
            "sys_platform": "linux",
            "extra": "",
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Pin:
    """A version of the lock, with the SHA-256 of each file that may be it."""

    name: str  # canonical
    version: str
    digests: tuple[str, ...]

    @property
    def requirement(self) -> str:
        """Its line for pip."""
        return " ".join([f"{self.name}=={self.version}", *(f"--hash=sha256:{digest}" for digest in self.digests)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Wheel:
    """A file to install."""

    name: str
    digest: str  # SHA-256
    content: bytes

    @property
    def installed_bytes(self) -> int:
        """Bytes of its files once they are installed."""
        with zipfile.ZipFile(io.BytesIO(self.content)) as archive:
            return sum(file.file_size for file in archive.infolist())


def pins_for(lock: str, robot: RobotPython) -> tuple[Pin, ...]:
    """Return the lock's pins for a robot: with pip, and without the packages that build rarms.

    Args:
        robot: its markers are compared with the robot's Python.
    """
    from packaging.requirements import Requirement

    pins = []
    for line in lock.partition(_BUILDS)[0].replace("\\\n", "").splitlines():
        requirement = Requirement(line.partition(" --hash")[0])
        if requirement.marker is None or requirement.marker.evaluate(robot.environment):
            (version,) = requirement.specifier
            digests = tuple(re.findall(r"--hash=sha256:([0-9a-f]{64})", line))
            pins.append(Pin(name=requirement.name, version=version.version, digests=digests))
    return tuple(pins)


def build_name(robot: RobotPython) -> str:
    """Return the name of the environment on a robot: the version, and a digest of all that makes it what it is."""
    parts = (own_wheel().digest, robot.short_version, *robot.platforms)
    lines = [*parts, *(pin.requirement for pin in pins_for(shipped_text(LOCK), robot))]
    digest = hashlib.sha256("\n".join(lines).encode("ascii")).hexdigest()
    return f"{__version__}-{digest[:12]}"


def wheels_for(robot: RobotPython, folder: Path) -> tuple[Wheel, ...]:
    """Return the wheels for a robot, rarms' own included.

    Args:
        folder: wheels are taken from it; pip downloads into it what it lacks.

    Returns:
        Each with a hash of the lock, sorted by name; rarms is made of the running installation.

    Raises:
        UseCaseError: a wheel does not have a hash of the lock, or pip cannot get one (failed).
    """
    pins = pins_for(shipped_text(LOCK), robot)
    with hold(folder / ".lock", owner(), WAIT_MS):
        found = _wheels_in(folder, pins, robot)
        if missing := [pin for pin in pins if pin.name not in found]:
            _download(missing, robot, folder)
            found = _wheels_in(folder, pins, robot)
    if lacking := sorted({pin.name for pin in pins} - found.keys()):
        advice = "Check which wheels the package index has, or build them and give their folder with --wheels."
        raise _incomplete(f"{folder} does not have wheels for {_described(robot)}: {', '.join(lacking)}.", advice)
    return tuple(sorted((*found.values(), own_wheel()), key=lambda wheel: wheel.name))


def _wheels_in(folder: Path, pins: Sequence[Pin], robot: RobotPython) -> Mapping[str, Wheel]:
    """Return the best wheel of each pin that the folder has, by name."""
    from packaging.tags import compatible_tags, cpython_tags
    from packaging.utils import InvalidWheelFilename, parse_wheel_filename

    python, platforms = tuple(map(int, robot.short_version.split("."))), list(robot.platforms)
    tags = [*cpython_tags(python, platforms=platforms), *compatible_tags(python, platforms=platforms)]
    ranks = {tag: rank for rank, tag in enumerate(tags)}
    wanted = {pin.name: pin for pin in pins}
    best: dict[str, tuple[int, Path]] = {}
    for path in sorted(folder.glob("*.whl")):
        try:
            name, version, _, fits = parse_wheel_filename(path.name)
        except InvalidWheelFilename:
            continue
        rank = min((ranks[tag] for tag in fits if tag in ranks), default=None)
        if rank is None or name not in wanted or str(version) != wanted[name].version:
            continue
        if name not in best or rank < best[name][0]:
            best[name] = rank, path
    return {name: _checked(path, wanted[name]) for name, (_, path) in best.items()}


def _checked(path: Path, pin: Pin) -> Wheel:
    """Read a wheel; it is one that the lock knows."""
    content = read_file(path, MOST_WHEEL_BYTES)
    digest = hashlib.sha256(content).hexdigest()
    if digest not in pin.digests:
        message = f"The SHA-256 of {path} is {digest}. {LOCK} does not list it."
        raise _incomplete(message, "The file is damaged or was replaced. Delete it, then run the same command again.")
    return Wheel(name=path.name, digest=digest, content=content)


def _download(pins: Sequence[Pin], robot: RobotPython, folder: Path) -> None:
    """Have pip put wheels into a folder, each compared with the lock's hashes."""
    requirements = folder / "requirements.txt"
    requirements.write_text("".join(f"{pin.requirement}\n" for pin in pins), encoding="ascii")
    words = ("--requirement", str(requirements), "--dest", str(folder))
    try:
        ended = subprocess.run(
            [sys.executable, "-m", "pip", "download", *_pip_options(robot), *words],
            check=False,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
    finally:
        requirements.unlink()
    if ended.returncode:
        said = [line for line in ended.stdout.decode("utf-8", "replace").splitlines() if line.strip()]
        message = f"pip cannot get the wheels for {_described(robot)}: {' '.join(said[-_LAST_LINES:])}"
        raise _incomplete(
            message[:1_000],
            (
                f"Check that `{sys.executable} -m pip` reaches its index. Without an index, give a folder of "
                "wheels with --wheels."
            ),
        )


def _pip_options(robot: RobotPython) -> tuple[str, ...]:
    """Return the options by which pip takes only wheels that the robot's Python can use, and asks nothing."""
    quiet = ("--quiet", "--disable-pip-version-check", "--no-input")
    wheels_only = ("--no-deps", "--only-binary", ":all:", "--require-hashes")
    python = ("--implementation", "cp", "--python-version", robot.short_version)
    platforms = (word for platform in robot.platforms for word in ("--platform", platform))
    return (*quiet, *wheels_only, *python, *platforms)


def _described(robot: RobotPython) -> str:
    return f"Python {robot.short_version} on {robot.machine}"


def _incomplete(message: str, advice: Wording) -> UseCaseError:
    return UseCaseError(Outcome.FAILED, [INCOMPLETE.at(None, "{reason}", advice, reason=message)])


@cache
def own_wheel() -> Wheel:
    """Make a wheel of the running rarms, from its own files: equal files, equal bytes.

    It need not have been installed from a wheel: from a checkout, the shipped folders come from there.
    """
    name = f"rarms_iac-{__version__}"
    files = {**dict(shipped_files()), **_metadata(f"{name}.dist-info")}
    record = "".join(f"{path},sha256={_base64_digest(data)},{len(data)}\n" for path, data in sorted(files.items()))
    files[f"{name}.dist-info/RECORD"] = f"{record}{name}.dist-info/RECORD,,\n".encode()
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, data in sorted(files.items()):
            archive.writestr(zipfile.ZipInfo(path), data, zipfile.ZIP_DEFLATED)
    content = target.getvalue()
    digest = hashlib.sha256(content).hexdigest()
    return Wheel(name=f"{name}-py3-none-any.whl", digest=digest, content=content)


def _metadata(folder: str) -> Mapping[str, bytes]:
    """Return the metadata of a wheel; its dependencies are the lock's."""
    texts = {
        "METADATA": f"Metadata-Version: 2.1\nName: rarms-iac\nVersion: {__version__}\nLicense: Apache-2.0\n",
        "WHEEL": "Wheel-Version: 1.0\nGenerator: rarms\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        "entry_points.txt": "[console_scripts]\nrarms = rarms_iac.cli.main:main\n",
    }
    return {f"{folder}/{name}": text.encode("ascii") for name, text in texts.items()}


def _base64_digest(data: bytes) -> str:
    return urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode("ascii")
