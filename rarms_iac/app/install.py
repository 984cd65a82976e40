"""Installing rarms on Linux hosts, and removing it: `rarms install`.

A host is asked first which Python it has. Then the wheels for it are sent over the same kind of connection to the
program `install_there`, which installs them and switches one link. The host needs Python, and no internet.
"""

import io
import json
import tarfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, TypeVar

from rarms_iac.app import install_there
from rarms_iac.app.control import UNATTENDED, Control
from rarms_iac.app.files import make_folder
from rarms_iac.app.hosts import Hosts, host_errors
from rarms_iac.app.install_there import RobotPlaces
from rarms_iac.app.install_wheels import PIP, RobotPython, Wheel, build_name, wheels_for
from rarms_iac.app.requests import flag, option
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.model.commands import APPLY_ABANDON, Wording, command, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import Connect, ProviderKind
from rarms_iac.model.version import __version__
from rarms_iac.providers.channel import SSH_FAILED, CommandChannel, ProgramChannel, last_of, not_reached, ssh_channel
from rarms_iac.providers.interface import HostError, HostFailed, HostLocked, HostRefused
from rarms_iac.storage.codec import NotDecodable, decode
from rarms_iac.storage.json_text import parse_json
from rarms_iac.storage.shipped import shipped_module
from rarms_iac.texts.findings import Finding

T = TypeVar("T")

PLACES = RobotPlaces()
STILL_OPEN = Finding.warning("RARMS417", "The host has an unfinished run of another version")
SILENCE_S = 1_800.0
"""Seconds that a host may take to install."""

_NO_PYTHON = 69  # exit code of the command where the host has no Python that is new enough
_MACHINES = {"linux-x86_64": "x86_64", "linux-aarch64": "aarch64"}
_LOAD = (
    "import sys, tarfile; "
    'archive = tarfile.open(fileobj=sys.stdin.buffer, mode=\\"r|\\"); '
    "exec(archive.extractfile(archive.next()).read())"
)
COMMAND = (
    f"""sh -c 'PATH={install_there.SEARCH}; for name in python3 python3.14 python3.13 python3.12 python3.11; do """
    """python=$(command -v $name) && $python -I -c "import sys; sys.exit(sys.version_info < (3, 11))" && """
    """if [ "$(id -u)" = 0 ]; then sudo=; else sudo="sudo -n"; fi && """
    f"""exec $sudo env -i PATH=$PATH $python -I -c "{_LOAD}"; done; exit {_NO_PYTHON}'"""
)
"""What every host is asked: a program that runs the first file of the archive on its standard input, as root."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InstallRequest:
    """The request of `rarms install`."""

    wheels: str | None = option(
        "--wheels",
        metavar="FOLDER",
        help="Use the wheels in this folder; pip downloads missing ones into it. [default: download all]",
    )
    removing: bool = flag("--remove", help="Remove all versions of rarms from the hosts; keep the journals.")


@dataclass(frozen=True, slots=True, kw_only=True)
class BegunRun:
    """A run of a host, and the version that began it."""

    slice: str
    plan: str
    version: str
    said: str = ""  # by that version, where it did not finish the run


@dataclass(frozen=True, slots=True, kw_only=True)
class HostInstallation:
    """The result of installing rarms on one host."""

    host: str
    before: str  # the version that was in use; empty: none
    version: str  # the version that is in use; empty: it was removed
    changed: bool
    python: str
    machine: str
    boot: str = ""  # the file that starts partitions with the machine; empty: there is neither systemd nor cron
    sent_bytes: int = 0
    finished: tuple[BegunRun, ...] = ()
    still_open: tuple[BegunRun, ...] = ()  # not finished by the version that began each
    removed: tuple[str, ...] = ()  # versions


@dataclass(frozen=True, slots=True, kw_only=True)
class Installation:
    """The results of installing rarms on the hosts, in the order in which they were asked."""

    hosts: tuple[HostInstallation, ...]
    findings: tuple[Diagnostic, ...] = ()
    kind: Literal["installation"] = "installation"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Look:
    """A host's own words on what it is and has."""

    python: str
    implementation: str
    platform: str
    libc: tuple[str, str]
    versions: Mapping[str, str]  # the environment of each
    current: str
    boots: bool
    unfinished: tuple[BegunRun, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Done:
    """A host's own words on what it did."""

    boot: str = ""
    finished: tuple[BegunRun, ...] = ()
    still_open: tuple[BegunRun, ...] = ()
    removed: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Refusal:
    """A host's own words on why it did nothing; each problem has some of the facts."""

    problem: str
    said: str = ""
    file: str = ""
    owner: str = ""
    step: str = ""
    needed: int = 0
    free: int = 0
    wanted: str = ""
    found: str = ""
    code: int = 0
    runs: tuple[BegunRun, ...] = ()
    slices: tuple[str, ...] = ()


@dataclass(slots=True)
class _Wheels:
    """The wheels for the hosts of one command: each kind of Python gets them once."""

    folder: Path
    by_python: dict[RobotPython, tuple[Wheel, ...]] = field(default_factory=dict)

    def of(self, python: RobotPython) -> tuple[Wheel, ...]:
        if python not in self.by_python:
            self.by_python[python] = wheels_for(python, self.folder)
        return self.by_python[python]


def install(hosts: Hosts, request: InstallRequest, control: Control = UNATTENDED) -> Installation:
    """Install this version of rarms on Linux hosts, or remove all versions.

    A host that has this version in use is left as it is. The hosts go in name order, and a failure ends the work.

    Args:
        hosts: the chosen ones, of which each is a Linux host.
        control: hears what is downloaded and sent.

    Returns:
        What became of each host.

    Raises:
        RequestError: a chosen host is not a Linux host.
        UseCaseError: a host cannot be reached, lacks something or refuses (failed), a run holds it (refused), or a
            wheel is missing or not the one of the lock (failed).
    """
    names = _linux_hosts(hosts)
    with ExitStack() as stack:
        if request.wheels is None:
            folder = stack.enter_context(TemporaryDirectory(prefix="rarms-wheels-"))
        else:
            folder = request.wheels
            make_folder(folder)
        wheels = _Wheels(Path(folder))
        done = []
        for name in names:
            host = _RobotSetup(name, _channel(hosts, name))
            with host_errors():
                done.append(_remove(host) if request.removing else _install(host, wheels, control))
    return Installation(
        hosts=tuple(done), findings=tuple(_still_open(host.host, run) for host in done for run in host.still_open)
    )


def hosts_to_change(hosts: Hosts, request: InstallRequest) -> tuple[str, ...]:
    """Find the chosen hosts that `install` would change, without changing them.

    Returns:
        Their names, in natural order.

    Raises:
        RequestError: a chosen host is not a Linux host.
        UseCaseError: a host cannot be reached, or lacks something (failed).
    """
    found = []
    for name in _linux_hosts(hosts):
        with host_errors():
            look = _RobotSetup(name, _channel(hosts, name)).look()
            done = not look.versions if request.removing else _is_done(look, build_name(_python_of(name, look)))
        if not done:
            found.append(name)
    return tuple(found)


def _still_open(host: str, run: BegunRun) -> Diagnostic:
    reason = _last_line(run.said) if run.said else f"rarms {run.version} is not installed there."
    return STILL_OPEN.of_host(
        host,
        "{host}: rarms {began} began the run of plan {plan} and did not finish it. {reason}",
        prose(
            f"Correct the cause, or install rarms {run.version} there, then run ",
            command("install", host=host),
            ". To close the run and leave the host as it is, run ",
            APPLY_ABANDON,
            ".",
        ),
        plan=run.plan,
        began=run.version,
        version=__version__,
        reason=reason,
    )


def _linux_hosts(hosts: Hosts) -> tuple[str, ...]:
    """Return the chosen hosts; without a choice, all Linux hosts of the manifest."""
    is_linux = {name: hosts.system.hosts[name].provider is ProviderKind.LINUX for name in hosts.chosen}
    others = [name for name in hosts.chosen if not is_linux[name]]
    if others and (hosts.selection.hosts or len(others) == len(is_linux)):
        raise RequestError(f"rarms can be installed on Linux hosts only. Not a Linux host: {', '.join(others)}.")
    return tuple(name for name in hosts.chosen if is_linux[name])


def _channel(hosts: Hosts, name: str) -> CommandChannel:
    host = hosts.system.hosts[name]
    if name in hosts.channels:
        return hosts.channels[name]
    if isinstance(host.connect, Connect):
        return ssh_channel(name, host.connect)
    return ProgramChannel(host=name, target="this machine", words=("sh", "-c"))


def _install(host: "_RobotSetup", wheels: _Wheels, control: Control) -> HostInstallation:
    look = host.look()
    python = _python_of(host.name, look)
    build = build_name(python)
    installation = HostInstallation(
        host=host.name,
        before=look.current,
        version=__version__,
        changed=False,
        python=look.python,
        machine=python.machine,
    )
    if _is_done(look, build):
        return installation
    has_build = look.versions.get(__version__) == build
    tell = control.reporter.message
    if not has_build:
        tell(f"{host.name}: Python {look.python}, {python.machine}. Collecting its wheels.")
    sent = () if has_build else wheels.of(python)
    size = sum(len(wheel.content) for wheel in sent)
    if sent:
        tell(f"{host.name}: sending {len(sent)} wheels, {size / 1e6:.0f} MB, and installing them there.")
    done = host.ask(_install_job(build, sent), sent)
    return replace(
        installation,
        changed=bool(sent or done.finished) or look.current != __version__ or not look.boots,
        boot=done.boot,
        sent_bytes=size,
        finished=done.finished,
        still_open=done.still_open,
        removed=done.removed,
    )


def _install_job(build: str, sent: Sequence[Wheel]) -> dict[str, object]:
    """Return the robot's job for the wheels that are sent to it."""
    unpacked = sum(wheel.installed_bytes for wheel in sent) * 3 // 2  # with the bytecode
    return {
        "action": "install",
        "version": __version__,
        "build": build,
        "pip": next((wheel.name for wheel in sent if wheel.name.startswith(f"{PIP}-")), ""),
        "bytes": sum(len(wheel.content) for wheel in sent) + unpacked,
        "wheels": {wheel.name: wheel.digest for wheel in sent},
    }


def _is_done(look: _Look, build: str) -> bool:
    """Return whether this build is in use, starts partitions at boot, and no run of another version is open."""
    is_current = look.versions.get(__version__) == build and look.current == __version__
    return is_current and look.boots and all(run.version == __version__ for run in look.unfinished)


def _remove(host: "_RobotSetup") -> HostInstallation:
    look = host.look()
    done = host.ask({"action": "remove"}, ())
    return HostInstallation(
        host=host.name,
        before=look.current,
        version="",
        changed=bool(done.removed),
        python=look.python,
        machine=_MACHINES.get(look.platform, look.platform),
        removed=done.removed,
    )


def _python_of(host: str, look: _Look) -> RobotPython:
    machine = _MACHINES.get(look.platform)
    kind, version = look.libc
    if machine is None or kind != "glibc" or look.implementation != "cpython":
        message = (
            f"rarms has wheels for CPython with glibc on x86_64 and aarch64; the host has {look.implementation} on "
            f"{look.platform} with {kind or 'another C library'}"
        )
        raise HostRefused(host, message, "Install the Python of the distribution on the host, such as python3.")
    major, minor = (int(part) for part in version.split(".")[:2])
    return RobotPython(version=look.python, machine=machine, glibc=(major, minor))


class _RobotSetup:
    """The program on a host, by one command for each question."""

    def __init__(self, name: str, channel: CommandChannel) -> None:
        self.name = name
        self._channel = channel

    def look(self) -> _Look:
        return self._decoded(_Look, self._answer({"action": "look"}, ()))

    def ask(self, request: Mapping[str, Any], wheels: Sequence[Wheel]) -> _Done:
        return self._decoded(_Done, self._answer(request, wheels))

    def _answer(self, request: Mapping[str, Any], wheels: Sequence[Wheel]) -> Mapping[str, Any]:
        result = self._channel.run(COMMAND, _archive(request, wheels), SILENCE_S)
        error = last_of([line for line in result.error.splitlines() if line.strip()]).rstrip(".")
        target = self._channel.target
        for line in result.output.splitlines():
            if line.startswith(install_there.ANSWER):
                answer = self._parsed(line)
                if "problem" in answer:
                    raise _error_of(self.name, self._decoded(_Refusal, answer))
                return answer
        if result.code == SSH_FAILED:
            raise not_reached(self.name, target, error)
        if result.code == _NO_PYTHON:
            message = f"{target} has no Python 3.11 or newer in {install_there.SEARCH}"
            raise HostRefused(
                self.name,
                message,
                "Install Python 3.11 or newer on the host, such as python3 of Debian 12 or Ubuntu 24.04.",
            )
        message = f"the answer of {target} is not from rarms: exit code {result.code}, {error}"
        raise HostFailed(self.name, message, "Connect as root, or let this user run `sudo -n python3` there.")

    def _parsed(self, line: str) -> Mapping[str, Any]:
        try:
            answer = parse_json(line[len(install_there.ANSWER) :])
        except NotDecodable as problem:
            raise self._garbled(problem) from None
        if not isinstance(answer, dict):
            raise self._garbled(NotDecodable("answer", "it is not an object"))
        return answer

    def _decoded(self, kind: type[T], answer: Mapping[str, Any]) -> T:
        try:
            decoded: T = decode(kind, answer)
        except NotDecodable as problem:
            raise self._garbled(problem) from None
        return decoded

    def _garbled(self, problem: NotDecodable) -> HostFailed:
        message = f"the answer of {self._channel.target} cannot be read: {problem}"
        return HostFailed(
            self.name, message, "Check the login scripts of this user on the host: they must not print text."
        )


def _archive(request: Mapping[str, Any], wheels: Sequence[Wheel]) -> bytes:
    """Return the standard input of `COMMAND`: the program, the request, and the wheels."""
    program = f"{shipped_module('app/install_there.py')}\n\nmain(archive, {PLACES!r})\n"
    target = io.BytesIO()
    with tarfile.TarFile(fileobj=target, mode="w", format=tarfile.GNU_FORMAT) as archive:
        for name, content in (
            ("install.py", program.encode("utf-8")),
            ("request.json", json.dumps(request).encode("ascii")),
            *((wheel.name, wheel.content) for wheel in wheels),
        ):
            member = tarfile.TarInfo(name)
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))
    return target.getvalue()


def _error_of(host: str, refusal: _Refusal) -> HostError:
    """Return the error of a host that refused, in words."""
    if refusal.problem == "held":
        return HostLocked(host, refusal.owner)
    message, advice = _words(host, refusal)
    return HostRefused(host, message, advice)


def _words(host: str, refusal: _Refusal) -> tuple[str, Wording]:
    again = command("install", host=host)
    match refusal.problem:
        case "full":
            room = (
                f" {refusal.needed / 1e6:.0f} MB are needed, {refusal.free / 1e6:.0f} MB are free."
                if refusal.needed
                else ""
            )
            message = f"the disk of {refusal.file or PLACES.versions} is full.{room} The version in use was not changed"
            return message, prose("Free space there, then run ", again, ".")
        case "digest":
            message = f"{refusal.file} was sent with SHA-256 {refusal.wanted} and arrived with {refusal.found}"
            return message, prose("The connection or the disk corrupts data. Check both, then run ", again, ".")
        case "writable":
            message = f"users other than root can change {refusal.file}, which root would run"
            return message, f"Run on the host: `chown root:root {refusal.file} && chmod go-w {refusal.file}`."
        case "unfinished":
            runs = ", ".join(f"plan {run.plan} of rarms {run.version}" for run in refusal.runs)
            message = f"a run is unfinished there: {runs}. {_last_line(refusal.said)}".rstrip(". ")
            return message, prose("Finish the run: ", command("apply"), ", or ", command("apply", abandon=True), ".")
        case "partitions":
            message = f"the host still has partitions of rarms, in {', '.join(refusal.slices)}"
            return message, prose("Remove the partitions first: ", command("destroy", host=host), ".")
        case "step":
            message = f"the step {refusal.step} ended with exit code {refusal.code}: {_last_line(refusal.said)}"
            return (
                message,
                "The version in use was not changed. Check the Python on the host: it needs the module `venv`.",
            )
        case _:
            message = f"{refusal.file} {refusal.said}".strip() or f"the installation ended early: {refusal.problem}"
            return message, prose("The version in use was not changed. Run ", again, " again.")


def _last_line(text: str) -> str:
    return last_of([line.strip() for line in text.splitlines() if line.strip()]) if text else ""
