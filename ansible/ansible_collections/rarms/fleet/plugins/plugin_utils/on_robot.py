# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""Commands of rarms that have to run on the robot itself, since they run its components; files come back from there."""

from __future__ import annotations

import base64
import binascii
import io
import json
import re
import shlex
import tarfile
from collections.abc import Sequence
from os.path import relpath
from pathlib import Path, PurePath
from typing import Any

from ansible_collections.rarms.fleet.plugins.plugin_utils.robot import RARMS_MISSING, Result, Robot

if not RARMS_MISSING:
    from rarms_iac.app.files import make_folder, write_file
    from rarms_iac.app.use_case_errors import RequestError
    from rarms_iac.model.host import ProviderKind
    from rarms_iac.providers.channel import CommandChannel

SILENCE_S = 3600.0
OVERLAYS_FOLDER = ".rarms/here"
"""Folder of the overlays, in the robot's copy, by which it is reached without `connect`."""
LOG = re.compile(r"[a-z0-9][a-z0-9-]*/[a-z0-9][a-z0-9+-]*(?:\.configuration|/[a-z0-9][a-z0-9-]*)?\.(?:jsonl|json)")
"""A file below `measurements/`, as rarms names them: its platform first."""

RUN_ON_ROBOT = {
    "folder": {"type": "str"},
    "executable": {"type": "str", "default": "rarms"},
}
"""Arguments of an action that runs components."""


def run_on_robot(channel: CommandChannel, robot: Robot, arguments: Any, words: Sequence[str]) -> Result:
    """Run a command of rarms in the robot's own copy of the manifest's folder.

    Args:
        channel: to the robot.
        robot: whose overlays are given to the command, and a last one without `connect`: there the host is the robot.
        arguments: of the action; `folder` is where the robot keeps the manifest with its overlays.
        words: of the command, behind the program's name.

    Returns:
        Its JSON.

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
        return json.loads(answer.output)
    except ValueError as error:
        raise RequestError(f"`{command}` ended with {answer.code} and no answer: {answer.error[-500:]}") from error


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
    """Bring the data logs of the robot's platform back, beside the manifest here.

    Args:
        channel: to the robot.
        robot: whose manifest's folder here gets them.
        folder: the robot's own copy of it.

    Returns:
        Paths of the files that came, below `measurements`, sorted.

    Raises:
        RequestError: what came is no archive of data logs.
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
        raise RequestError(f"The robot's measurements cannot be read ({error}): {answer.error[-500:]}") from error
    for name, content in sorted(contents.items()):
        target = Path(robot.hosts.folder) / "measurements" / name
        make_folder(str(target.parent))
        write_file(str(target), content)
    return sorted(contents)
