# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""Commands of rarms that have to run on the robot itself, since they run its components; files come back from there."""

from __future__ import annotations

import base64
import binascii
import fcntl
import io
import json
import os
import re
import shlex
import tarfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from os.path import relpath
from pathlib import Path, PurePath
from typing import Any

from ansible_collections.rarms.fleet.plugins.plugin_utils.robot import LAST_CHARACTERS, RARMS_MISSING, Result, Robot

if not RARMS_MISSING:
    from rarms_iac.app.files import make_folder, write_file
    from rarms_iac.app.use_case_errors import RequestError
    from rarms_iac.model.host import ProviderKind
    from rarms_iac.providers.channel import CommandChannel

SILENCE_S = 3600.0
OVERLAYS_FOLDER = ".rarms/local"
"""Folder of the overlays, in the robot's copy, by which it is reached without `connect`."""
LOG = re.compile(r"[a-z0-9][a-z0-9-]*/[a-z0-9][a-z0-9+-]*(?:\.configuration|/[a-z0-9][a-z0-9+-]*)?\.jsonl")
"""A file below `measurements/`, as rarms names them: its platform first."""

RUN_ON_ROBOT = {
    "folder": {"type": "str"},
    "executable": {"type": "str", "default": "rarms"},
}
"""Arguments of an action that runs components."""


def run_on_robot(channel: CommandChannel, robot: Robot, arguments: Any, words: Sequence[str]) -> tuple[Result, int]:
    """Run a command of rarms in the robot's own copy of the manifest's folder.

    Args:
        channel: to the robot.
        robot: whose overlays are given to the command, and a last one without `connect`: there the host is the robot.
        arguments: of the action; `folder` is where the robot keeps the manifest with its overlays.
        words: of the command, behind the program's name.

    Returns:
        Its JSON, which has a `kind` and `findings`, and its exit code.

    Raises:
        RequestError: the robot runs Hyper-V, no folder is named, `connect` stands in no overlay, or the command gave
            no JSON.
    """
    if robot.provider is ProviderKind.HYPERV:
        raise RequestError(
            "Running components on Hyper-V is a talk with the host, and Ansible's connection runs one command at a "
            "time: use `rarms measure` and `rarms prove` on the controller."
        )
    if not arguments["folder"]:
        raise RequestError(
            "The components run on the robot: say with `folder` where it keeps the manifest, and have rarms there."
        )
    command = shlex.join([arguments["executable"], *words, *_manifest_words(robot), "--json"])
    if robot.connect is not None:
        overlay = shlex.join(["printf", "%s\n", f"hosts: {{ {robot.host}: {{ connect: null }} }}"])
        command = (
            f"mkdir -p {shlex.quote(OVERLAYS_FOLDER)} && {overlay} > {shlex.quote(_local_overlay(robot))} && {command}"
        )
    answer = channel.run(f"cd {shlex.quote(arguments['folder'])} && {command}", b"", SILENCE_S)
    try:
        result = json.loads(answer.output)
    except ValueError:
        result = None
    if not isinstance(result, dict) or not isinstance(result.get("findings"), list):
        error = answer.error[-LAST_CHARACTERS:].strip()
        raise RequestError(f"`{command}` ended with {answer.code} and no answer of rarms: {error}")
    return result, answer.code


def _manifest_words(robot: Robot) -> list[str]:
    """The manifest and overlays as a command in their folder names them."""
    source = robot.hosts.manifest.source
    manifest, *overlays = (
        PurePath(relpath(path, robot.hosts.folder)).as_posix() for path in (source.manifest, *source.overlays)
    )
    if robot.connect is not None:
        if not overlays:
            raise RequestError("Write `connect` in an overlay of the robot's own: on the robot it is left out.")
        overlays.append(_local_overlay(robot))
    return ["-f", manifest, *(word for overlay in overlays for word in ("--overlay", overlay))]


def _local_overlay(robot: Robot) -> str:
    """The last overlay, which keeps the robot's name."""
    return f"{OVERLAYS_FOLDER}/{PurePath(robot.hosts.manifest.source.overlays[-1]).stem}.yaml"


def fetch_measurements(channel: CommandChannel, robot: Robot, folder: str) -> list[str]:
    """Add what the data logs of the robot's platform say to those beside the manifest here.

    Args:
        channel: to the robot.
        robot: whose manifest's folder here gets the records that it lacks.
        folder: the robot's own copy of it.

    Returns:
        Paths of the files that changed here, below `measurements`, sorted.

    Raises:
        RequestError: what came is no archive of data logs, or a log here is of something else.
        UseCaseError: a file cannot be written.
    """
    command = f"cd {shlex.quote(folder)} && tar -cf - measurements | base64"
    answer = channel.run(command, b"", SILENCE_S)
    try:
        data = base64.b64decode(answer.output)
        with tarfile.open(fileobj=io.BytesIO(data)) as archive:
            files = {member.name.removeprefix("measurements/"): member for member in archive if member.isfile()}
            own = f"{robot.platform}/"
            logs = {name: member for name, member in files.items() if LOG.fullmatch(name) and name.startswith(own)}
            contents = {name: archive.extractfile(member).read() for name, member in logs.items()}
    except (binascii.Error, tarfile.TarError) as error:
        said = answer.error[-LAST_CHARACTERS:].strip()
        raise RequestError(f"The robot's measurements cannot be read ({error}): {said}") from error
    root = Path(robot.hosts.folder) / "measurements"
    make_folder(str(root / robot.platform))
    with _held(root / robot.platform):
        return [name for name, content in sorted(contents.items()) if _add_records(root / name, content)]


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    """One process at a time: robots of one platform end side by side."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _add_records(path: Path, came: bytes) -> bool:
    """Add the records that a log lacks; each stands on a line of its own. True: there were some."""
    own = path.read_bytes() if path.exists() else b""
    lines, new = own.splitlines(keepends=True), came.splitlines(keepends=True)
    if lines and new and lines[0].rstrip() != new[0].rstrip():
        raise RequestError(
            f"{path} here is not of what the robot measured: copy the manifest's folder to the robot, then repeat this."
        )
    known = {line.rstrip() for line in lines}  # git may have changed line ends
    missing = [line for line in new if line.endswith(b"\n") and line.rstrip() not in known]
    if missing:
        make_folder(str(path.parent))
        write_file(str(path), b"".join([*(line for line in lines if line.endswith(b"\n")), *missing]))
    return bool(missing)
