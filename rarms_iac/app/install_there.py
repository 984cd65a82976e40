"""The program that `rarms install` runs on a robot, as root; it needs Python's own library alone.

In: a tar on standard input: this file, `request.json`, then wheels. Out: one line, `ANSWER` and an object of facts. The
other side makes the sentences. Begin at `main`.

Each version is a link `<version>` to a virtual environment in `.builds/`, and `current` is a link to the version in
use. A link is switched by one rename, and no file that a link names is changed. So an installation that ends early
leaves the links as they were, and the next one removes the rest.
"""

import contextlib
import errno
import hashlib
import json
import os
import platform
import shutil
import stat
import subprocess
import sys
import sysconfig
import tarfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

if sys.platform != "win32":  # the other side may be Windows, and reads the constants alone
    import fcntl

ANSWER = "rarms-install: "
BOOT_UNIT = "rarms-boot.service"
WATCHER_UNIT, WATCHER_PATH = "rarms-threads.service", "rarms-threads.path"
CHUNK = 2**20
LAST_CHARACTERS = 1_500  # of what a program printed
SEARCH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"

Facts = dict[str, Any]


@dataclass(frozen=True)
class RobotPlaces:
    """Folders and files on the robot."""

    versions: str = "/opt/rarms"
    state: str = "/var/lib/rarms"
    units: str = "/etc/systemd/system"
    systemd: str = "/run/systemd/system"  # exists if systemd is process 1
    cron: str = "/etc/cron.d"

    @property
    def builds(self) -> Path:
        """The folder of all virtual environments."""
        return Path(self.versions, ".builds")

    @property
    def wheels(self) -> Path:
        """The folder of the wheels that came, while they are installed."""
        return Path(self.versions, ".wheels")

    @property
    def has_systemd(self) -> bool:
        """Whether systemd is process 1."""
        return Path(self.systemd).is_dir()

    @property
    def boot_files(self) -> dict[Path, str]:
        """The files that start partitions and the watcher of threads, with their texts.

        The first starts partitions; none: the robot has neither systemd nor cron.
        """
        if self.has_systemd:
            texts = {BOOT_UNIT: BOOT, WATCHER_UNIT: WATCHER, WATCHER_PATH: WATCHED}
            found = {Path(self.units, name): text for name, text in texts.items()}
        else:
            found = {Path(self.cron, "rarms"): CRON} if Path(self.cron).is_dir() else {}
        return {file: text.format(programs=f"{self.versions}/current/bin", places=self) for file, text in found.items()}


class Refused(Exception):
    """The request cannot be done; nothing that a link names was changed."""

    def __init__(self, problem: str, **facts: object) -> None:
        super().__init__(problem)
        self.facts = {"problem": problem, **facts}


def main(archive: tarfile.TarFile, places: RobotPlaces) -> None:
    """Do the request of an archive, and print its result.

    Args:
        archive: open behind its first member, this file.
    """
    os.umask(0o022)  # a user who may not read the environment could not call it
    try:
        request = json.loads(_content(archive))
        do = {"look": look, "install": install, "remove": remove}[request["action"]]
        answer = do(request, archive, places)
    except Refused as refused:
        answer = refused.facts
    except OSError as error:
        full = error.errno in {errno.ENOSPC, errno.EDQUOT}
        answer = {"problem": "full" if full else "system", "said": error.strerror or repr(error)}
        answer["file"] = str(error.filename or "")
    sys.stdout.write(f"{ANSWER}{json.dumps(answer)}\n")


def look(_request: Facts, _archive: tarfile.TarFile, places: RobotPlaces) -> Facts:
    """Return the Python, the C library, the versions and the unfinished runs of the robot."""
    return {
        "python": platform.python_version(),
        "implementation": sys.implementation.name,
        "platform": sysconfig.get_platform(),
        "libc": list(platform.libc_ver()),
        "versions": {name: build.name for name, build in _versions(places).items()},
        "current": _current(places),
        "boots": all(file.is_file() for file in places.boot_files),
        "unfinished": _unfinished(places),
    }


def install(request: Facts, archive: tarfile.TarFile, places: RobotPlaces) -> Facts:
    """Install a version, and switch `current` to it at the end.

    Raises:
        Refused: a run holds the host, the disk is full, a wheel is not what was sent, or a step fails.
    """
    version, root = request["version"], Path(places.versions)
    _refuse_writable(Path(sys.executable).resolve())
    with _held(places, make=True):
        _refuse_running(places)
        finished, still_open = _finish_runs(places, version)
        before, build = _current(places), places.builds / request["build"]
        _remove_rest(places)
        if _versions(places).get(version) != build:
            _build(request, archive, build, places)
            os.sync()
            _point(root / version, f"{places.builds.name}/{build.name}")
        boot = _install_boot(places)
        _point(root / "current", version)
        needed = {version, before, *(run["version"] for run in still_open)}
        removed = [] if before == version else _remove_versions(places, needed)
        _remove_rest(places)
    return {"finished": finished, "still_open": still_open, "boot": boot, "removed": removed}


def remove(_request: Facts, _archive: tarfile.TarFile, places: RobotPlaces) -> Facts:
    """Remove all versions and what starts them with the machine; journals stay.

    Raises:
        Refused: a run holds the host or is not finished, or partitions are there.
    """
    root = Path(places.versions)
    if not root.is_dir():
        return {"removed": []}
    with _held(places, make=False):
        _refuse_running(places)
        if unfinished := _unfinished(places):
            raise Refused("unfinished", runs=unfinished)
        if partitions := sorted({path.parent.name for path in Path(places.state).glob("*/*.json")}):
            raise Refused("partitions", slices=partitions)
        _remove_boot(places)
        (root / "current").unlink(missing_ok=True)
        removed = _remove_versions(places, needed=set())
        _remove_rest(places)
        (root / ".lock").unlink()
    with contextlib.suppress(OSError):  # other files are there
        places.builds.rmdir()
        root.rmdir()
    return {"removed": removed}


def _content(archive: tarfile.TarFile) -> bytes:
    member = archive.next()
    file = member and archive.extractfile(member)
    if not file:
        raise Refused("torn")
    with file:
        return file.read()


@contextlib.contextmanager
def _held(places: RobotPlaces, *, make: bool) -> Iterator[None]:
    """Let only one installation run at a time."""
    root = Path(places.versions)
    if make:
        places.builds.mkdir(mode=0o755, parents=True, exist_ok=True)
    _refuse_writable(root)
    descriptor = os.open(root / ".lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError:
        raise Refused("held", owner="another installation") from None
    finally:
        os.close(descriptor)


def _refuse_writable(path: Path) -> None:
    """Refuse what others than root can replace: root will run it."""
    for each in (path, *path.parents):
        found = each.stat()
        if found.st_uid != 0 or found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            raise Refused("writable", file=str(each))


def _versions(places: RobotPlaces) -> dict[str, Path]:
    """Return the environment of each version."""
    root = Path(places.versions)
    links = [path for path in root.glob("[!.]*") if path.is_symlink() and path.name != "current"]
    return {path.name: places.builds / path.readlink().name for path in sorted(links)}


def _current(places: RobotPlaces) -> str:
    link = Path(places.versions, "current")
    return link.readlink().name if link.is_symlink() else ""


def _point(link: Path, target: str) -> None:
    """Make a link name a target, in one moment."""
    new = link.with_name(f".new-{link.name}")
    new.unlink(missing_ok=True)
    new.symlink_to(target)
    new.replace(link)
    folder = os.open(link.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _remove_rest(places: RobotPlaces) -> None:
    """Remove what no link names: an installation that was killed left it."""
    named = set(_versions(places).values())
    for path in places.builds.glob("*"):
        if path not in named:
            shutil.rmtree(path)
    shutil.rmtree(places.wheels, ignore_errors=True)
    for path in Path(places.versions).glob(".new-*"):
        path.unlink()


def _remove_versions(places: RobotPlaces, needed: set[str]) -> list[str]:
    removed = [name for name in _versions(places) if name not in needed]
    for name in removed:
        Path(places.versions, name).unlink()
    return removed


def _build(request: Facts, archive: tarfile.TarFile, build: Path, places: RobotPlaces) -> None:
    """Make the virtual environment of a version from wheels, and see that it works."""
    free = shutil.disk_usage(places.versions).free
    if free < request["bytes"]:
        raise Refused("full", needed=request["bytes"], free=free, file=places.versions)
    try:
        wheels = _take_wheels(request["wheels"], archive, places.wheels)
        # NOTE: the resolved name, such as python3.11: after an upgrade of the system `python3` would be another one.
        _run("venv", str(Path(sys.executable).resolve()), "-I", "-m", "venv", "--without-pip", "--symlinks", str(build))
        python = str(build / "bin" / "python")
        (pip,) = (wheel for wheel in wheels if Path(wheel).name == request["pip"])
        start = (
            "import sys, runpy; sys.path.insert(0, sys.argv.pop(1)); runpy.run_module('pip', None, '__main__', True)"
        )
        options = ("--isolated", "--quiet", "--no-index", "--no-deps", "--no-cache-dir", "--disable-pip-version-check")
        packages = [wheel for wheel in wheels if wheel != pip]
        _run("pip", python, "-I", "-c", start, pip, "install", *options, "--root-user-action=ignore", *packages)
        shutil.rmtree(places.wheels)
        _run("check", python, "-I", "-m", "rarms_iac", "schema")
    except BaseException:
        shutil.rmtree(build, ignore_errors=True)
        shutil.rmtree(places.wheels, ignore_errors=True)
        raise


def _take_wheels(digests: dict[str, str], archive: tarfile.TarFile, folder: Path) -> list[str]:
    """Write the wheels of the archive into a folder; each is what its SHA-256 says."""
    folder.mkdir(mode=0o700)
    for name, digest in digests.items():
        member = archive.next()
        file = member and archive.extractfile(member)
        if not file or member is None or member.name != name:
            raise Refused("torn")
        found = hashlib.sha256()
        with file, (folder / name).open("wb") as target:
            while data := file.read(CHUNK):
                found.update(data)
                target.write(data)
        if found.hexdigest() != digest:
            raise Refused("digest", file=name, wanted=digest, found=found.hexdigest())
    return [str(folder / name) for name in digests]


def _run(step: str, *words: str) -> str:
    """Run a program; where the disk is full, that is the reason."""
    ended = subprocess.run(
        words,
        check=False,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={"PATH": SEARCH},
    )
    said = ended.stdout.decode("utf-8", "replace")
    if ended.returncode:
        if os.strerror(errno.ENOSPC) in said:
            raise Refused("full", said=os.strerror(errno.ENOSPC), file="")
        raise Refused("step", step=step, code=ended.returncode, said=said[-LAST_CHARACTERS:])
    return said


def _refuse_running(places: RobotPlaces) -> None:
    """Refuse while a run holds the host."""
    for path in sorted(Path(places.state).glob("*/lock")):
        with path.open("rb") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                owner = file.read(CHUNK).decode("utf-8", "replace").strip()
                raise Refused("held", owner=owner or "another run") from None


def _unfinished(places: RobotPlaces) -> list[Facts]:
    """Return the runs that were begun and not closed, each with the version that began it.

    Damage is for rarms to report.
    """
    found = []
    for path in sorted(Path(places.state).glob("*/journal.jsonl")):
        lines = path.read_bytes().splitlines()
        with contextlib.suppress(ValueError, LookupError, TypeError):
            started = json.loads(lines[0])
            try:
                last = json.loads(lines[-1])
            except ValueError:
                last = {}  # a crash tore it
            if last.get("kind") != "run_closed":
                run = {"slice": path.parent.name, "plan": started["plan"], "version": started["rarms"]}
                found.append({**run, "said": ""})
    return found


def _finish_runs(places: RobotPlaces, version: str) -> tuple[list[Facts], list[Facts]]:
    """Have each other version that is here finish the runs that it began; return those, and those that are left."""
    runs, installed, said = [run for run in _unfinished(places) if run["version"] != version], _versions(places), {}
    for name in sorted({run["version"] for run in runs} & installed.keys()):
        try:
            _run("finish", str(Path(places.versions, name, "bin", "python")), "-I", "-m", FINISH)
        except Refused as refused:
            said[name] = str(refused.facts["said"])
    open_now = [(run["slice"], run["plan"]) for run in _unfinished(places)]
    still_open = [run for run in runs if (run["slice"], run["plan"]) in open_now]
    finished = [run for run in runs if run not in still_open]
    return finished, [{**run, "said": said.get(run["version"], "")} for run in still_open]


FINISH = "rarms_iac.robot.finish"
"""The module of each version that finishes the runs which it began on this machine."""


def _install_boot(places: RobotPlaces) -> str:
    """Have partitions start with the machine; return the file that does it, or nothing."""
    files = places.boot_files
    for file, text in files.items():
        if not file.is_file() or file.read_text(encoding="utf-8") != text:
            new = file.with_name(f".{file.name}.new")  # cron reads no name with a point
            new.write_text(text, encoding="utf-8")
            new.chmod(0o644)
            new.replace(file)
    if places.has_systemd:
        _run("boot", "systemctl", "daemon-reload")
        _run("boot", "systemctl", "enable", "--quiet", BOOT_UNIT, WATCHER_PATH)
        _run("boot", "systemctl", "start", WATCHER_PATH)
    return str(next(iter(files), ""))


def _remove_boot(places: RobotPlaces) -> None:
    files = [file for file in places.boot_files if file.is_file()]
    if files and places.has_systemd:
        _run("boot", "systemctl", "disable", "--now", "--quiet", *(file.name for file in files))
    for file in files:
        file.unlink()
    if files and places.has_systemd:
        _run("boot", "systemctl", "daemon-reload")


BOOT = """\
[Unit]
Description=Start the partitions of rarms
ConditionPathExists={programs}/rarms
RequiresMountsFor={places.versions} {places.state}

[Service]
Type=oneshot
ExecStart={programs}/rarms start --boot

[Install]
WantedBy=multi-user.target
"""

WATCHER = """\
[Unit]
Description=Give threads of services the priority of their task class
ConditionPathExists={programs}/python
RequiresMountsFor={places.versions} {places.state}

[Service]
ExecStart={programs}/python -I -m rarms_iac.running.thread_watcher {places.state}
Restart=on-failure
RestartSec=10
"""

WATCHED = """\
[Unit]
Description=Start rarms-threads.service while partitions have priorities of threads

[Path]
PathExistsGlob={places.state}/*.threads

[Install]
WantedBy=multi-user.target
"""

CRON = """\
@reboot root {programs}/rarms start --boot
* * * * * root ls {places.state}/*.threads >/dev/null 2>&1 && flock -n -E 0 {places.state} \
{programs}/python -I -m rarms_iac.running.thread_watcher {places.state} 2>&1 | logger -t rarms-threads
"""
"""Each minute it starts the watcher of threads, unless that runs or has nothing to watch."""
