"""Makes the environment and the user of a process: variables, files of variables, setup files and groups.

In: a `Process` of the manifest and rarms' own environment. Out: variables, and words before the command that change
the user. Begin at `environment_of` and `user_words`.
"""

import errno
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from hashlib import sha256
from pathlib import Path

from rarms_iac.model.run import Arrival, FromEnvironment, Periodic, Process
from rarms_iac.running.orders import CannotStart, StartContext
from rarms_iac.texts.messages import last_words, reason_of

PERIOD_VARIABLE = "RARMS_PERIOD_MS"
"""The variable with the period of a command that paces itself, as a number of milliseconds."""

_FILE_CHARACTERS = 2**20
_SOURCING_S = 60.0
"""How long setup files may take; those of a large ROS workspace take two seconds."""

_OF_BASH = frozenset({"_", "SHLVL", "PWD", "OLDPWD"})
"""Variables that bash sets by itself."""
_OF_LOADER = frozenset({"GCONV_PATH", "GLIBC_TUNABLES", "LOCPATH", "NLSPATH"})
"""Variables that, as those that begin with LD_, say what a program loads when it starts."""

_SOURCE = 'for file in "$@"; do . "$file" >&2 </dev/null; done; exec env -0'


def environment_of(component: str, process: Process, arrival: Arrival, context: StartContext) -> dict[str, str]:
    """Return rarms' environment with the process' variables, and the period for a command that paces itself.

    Raises:
        CannotStart: a variable that a value is to be read from is not set, or a file with variables cannot be read.
    """
    own = context.environment
    environment = {**own, **_user_variables(component, process), **file_variables(component, process, context.base)}
    if isinstance(arrival, Periodic):
        environment[PERIOD_VARIABLE] = f"{float(arrival.period):.12g}"
    for name, value in process.variables.items():
        if isinstance(value, FromEnvironment):
            if value.name not in own:
                message = f"{name} needs the variable {value.name}, which is not set in the environment of rarms"
                advice = (
                    f"Set {value.name} in the environment of rarms; on a Linux host over ssh, in "
                    "/etc/rarms/environment."
                )
                raise CannotStart(component, message, advice)
            environment[name] = own[value.name]
        else:
            environment[name] = value
    return environment


def file_variables(component: str, process: Process, base: Path) -> dict[str, str]:
    """Return the variables of the file that `environment` names: `NAME=VALUE` lines, and comments that begin with `#`.

    Raises:
        CannotStart: the file cannot be read, or has another line.
    """
    if not process.environment_file:
        return {}
    file, found = base / process.environment_file, {}
    try:
        if not file.is_file():
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
        with file.open(encoding="utf-8", errors="surrogateescape") as opened:
            text = opened.read(_FILE_CHARACTERS)
    except OSError as problem:
        advice = "Its path is relative to the manifest."
        raise CannotStart(component, f"its file of variables {file}: {reason_of(problem)}", advice) from problem
    for number, line in enumerate(text.splitlines(), 1):
        name, equals, value = line.strip().partition("=")
        if not name or name.startswith("#"):
            continue
        if not equals:
            raise CannotStart(component, f"line {number} of {file} is not NAME=VALUE", "Correct that line.")
        found[name] = value
    return found


def with_setup(component: str, process: Process, environment: Mapping[str, str], base: Path) -> dict[str, str]:
    """Return the environment after `bash` sourced the setup files in the process' folder; the same are sourced once.

    Args:
        base: the manifest's folder, to which folder and files are relative.

    Raises:
        CannotStart: a file is not there, or bash does not come to its end.
    """
    if not process.setup:
        return dict(environment)
    files, folder = [base.resolve() / file for file in process.setup], base.resolve() / process.folder
    for file in files:
        if not file.is_file():
            advice = (
                "A path in `run.setup` is absolute, or relative to the manifest. Debian's own ROS packages have no "
                "setup file: remove `setup`."
            )
            raise CannotStart(component, f"its setup file {file} does not exist", advice)
    bash = ("bash", "--noprofile", "--norc", "-c", _SOURCE, "bash")
    before, own = as_user(component, process, environment)
    words = (*before, *bash, *map(str, files))
    try:
        after = _sourced(words, tuple(sorted(own.items())), folder)
    except OSError as problem:
        message = f"its setup files: {reason_of(problem)}"
        raise CannotStart(component, message, "Source the setup files in bash by hand to see the error.") from problem
    kept = {name: environment[name] for name in _OF_BASH if name in environment}
    return {**{name: value for name, value in after if name not in _OF_BASH}, **kept}


@cache
def _sourced(
    words: tuple[str, ...], environment: tuple[tuple[str, str], ...], folder: Path
) -> tuple[tuple[str, str], ...]:
    try:
        done = subprocess.run(
            words, cwd=folder, env=dict(environment), capture_output=True, check=False, timeout=_SOURCING_S
        )
    except subprocess.TimeoutExpired:
        raise TimeoutError(f"they take more than {_SOURCING_S:.0f} s") from None
    entries = os.fsdecode(done.stdout).split("\0")
    if done.returncode or not entries[0]:
        raise OSError(last_words(os.fsdecode(done.stderr), done.returncode))
    return tuple((name, value) for name, _, value in (entry.partition("=") for entry in entries if entry))


def changed_digests(before: Mapping[str, str], after: Mapping[str, str]) -> dict[str, str]:
    """Return a digest of each variable that setup files added, changed or removed, by name.

    The value before counts as `$NAME` at the end of the value after: a longer PATH of another shell changes no digest.
    """
    found = {}
    for name in sorted({*before, *after}):
        old, new = before.get(name, ""), after.get(name, "")
        if old != new:
            at_end = bool(old) and new.endswith(old)
            text = f"{new.removesuffix(old)}${name}" if at_end else new
            found[name] = sha256(text.encode("utf-8", "surrogateescape")).hexdigest()[:16]
    return found


def own_program(name: str) -> str:
    """Return the whole path of a program on rarms' own PATH: root starts none that a component's PATH names."""
    return shutil.which(name) or name


def as_user(
    component: str, process: Process, environment: Mapping[str, str], *, is_below_root: bool = False
) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the words before a command that change its user, and the environment that these words start with.

    Variables of the dynamic loader are set after the change of user: root loads no library that the user names.

    Args:
        is_below_root: other programs of root stand before these words.

    Raises:
        CannotStart: as of `user_words`.
    """
    words = user_words(component, process)
    if not words and not is_below_root:
        return (), dict(environment)
    loader = {name: value for name, value in environment.items() if name.startswith("LD_") or name in _OF_LOADER}
    setting = (own_program("env"), *(f"{name}={value}" for name, value in sorted(loader.items()))) if loader else ()
    return (*words, *setting), {name: value for name, value in environment.items() if name not in loader}


def user_words(component: str, process: Process) -> tuple[str, ...]:
    """Return the words before a command that change its user and groups; none where nothing changes.

    Raises:
        CannotStart: no such user or group here, or rarms is not root.
    """
    if not process.user and not process.groups:
        return ()
    if sys.platform != "linux":
        raise CannotStart(
            component, "users and groups are for Linux only", "Remove `user` and `groups` from its `run`."
        )
    user, group = _ids_of(component, process)
    groups = sorted(
        {group, *_groups_of(process, user, group), *(_group_id(component, name) for name in process.groups)}
    )
    if os.geteuid() != 0:
        if user == os.geteuid() and {*groups} <= {*os.getgroups(), os.getegid()}:
            return ()
        message = f"only root can start it as {process.user or 'a member of other groups'}"
        raise CannotStart(component, message, "Run rarms as root, or remove `user` and `groups` from its `run`.")
    listed = ",".join(map(str, groups))
    return (
        own_program("setpriv"),
        f"--reuid={user}",
        f"--regid={group}",
        f"--groups={listed}",
        "--pdeathsig=keep",
        "--",
    )


def _user_variables(component: str, process: Process) -> dict[str, str]:
    if not process.user or process.container is not None or sys.platform != "linux":
        return {}
    import pwd

    user, _ = _ids_of(component, process)
    try:
        entry = pwd.getpwuid(user)
    except KeyError:  # a number without a name
        return {"HOME": "/"}
    return {"HOME": entry.pw_dir, "USER": entry.pw_name, "LOGNAME": entry.pw_name, "SHELL": entry.pw_shell}


def _ids_of(component: str, process: Process) -> tuple[int, int]:
    """Return the user and its own group."""
    import pwd

    if not process.user:
        return os.geteuid(), os.getegid()
    try:
        entry = pwd.getpwuid(int(process.user)) if process.user.isdecimal() else pwd.getpwnam(process.user)
    except KeyError:
        if process.user.isdecimal():
            return int(process.user), int(process.user)
        advice = "Correct `run.user`, or add the user: useradd."
        raise CannotStart(component, f"the user {process.user} does not exist here", advice) from None
    return entry.pw_uid, entry.pw_gid


def refuse_unknown_user(component: str, process: Process) -> None:
    """Refuse a user or group that this machine does not have.

    Raises:
        CannotStart: one is missing.
    """
    _ids_of(component, process)
    for name in process.groups:
        _group_id(component, name)


def _groups_of(process: Process, user: int, group: int) -> list[int]:
    import pwd

    if not process.user:
        return os.getgroups()
    try:
        return os.getgrouplist(pwd.getpwuid(user).pw_name, group)
    except KeyError:
        return []


def _group_id(component: str, name: str) -> int:
    import grp

    try:
        return int(name) if name.isdecimal() else grp.getgrnam(name).gr_gid
    except KeyError:
        advice = "Correct `run.groups`, or add the group: groupadd."
        raise CannotStart(component, f"the group {name} does not exist here", advice) from None
