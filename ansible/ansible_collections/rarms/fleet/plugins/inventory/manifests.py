# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""The robots of a fleet from a rarms manifest: one an overlay, or one a host of the manifest."""

from __future__ import annotations

DOCUMENTATION = """
name: manifests
author: The rarms authors (@rarms)
short_description: Robots of a rarms manifest and its overlays
version_added: 0.1.0
description:
  - Creates one inventory host for each overlay of a manifest, named after the overlay's file. Without overlays, creates
    an inventory host for each host of the manifest.
  - Reads files named C(*fleet.yml) or C(*fleet.yaml).
  - A robot with an invalid overlay gets a warning and is in the group C(rarms_invalid). Only its own rarms tasks fail.
    The same applies to a robot with the name of a group or of another robot. Its name is then the path of its overlay.
extends_documentation_fragment: constructed
requirements: [rarms-iac]
options:
  plugin:
    description: Must be V(rarms.fleet.manifests).
    required: true
    choices: [rarms.fleet.manifests]
  manifest:
    description: The manifest, or the folder of a manifest, relative to this file.
    type: str
    default: rarms.yaml
  overlays:
    description: Patterns of overlay files, relative to this file; each file is a robot.
    type: list
    elements: str
    default: []
  common:
    description: Overlays that are applied before each robot's own, relative to this file.
    type: list
    elements: str
    default: []
"""

EXAMPLES = """
# robots.fleet.yml: rarms.yaml for all robots, robots/r-001.yaml and so on for the differences of one.
plugin: rarms.fleet.manifests
manifest: rarms.yaml
overlays: [robots/*.yaml]
keyed_groups:
  - key: rarms_platform
    prefix: platform
"""

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os.path import relpath
from pathlib import Path
from typing import Any

from ansible.errors import AnsibleParserError
from ansible.inventory.data import InventoryData
from ansible.plugins.inventory import BaseInventoryPlugin, Constructable
from ansible.template import trust_as_template

try:
    from rarms_iac.app.hosts import load
    from rarms_iac.app.use_case_errors import RequestError, UseCaseError
    from rarms_iac.model.diagnostics import Severity
    from rarms_iac.model.host import Host, ProviderKind, WinRmConnect
except ImportError as error:
    RARMS_MISSING = str(error)
else:
    RARMS_MISSING = ""


INVALID = "rarms_invalid"
"""The group of robots that fail their rarms tasks, and their variable with the reason."""


@dataclass(frozen=True)
class FoundRobot:
    """A robot as its overlay has it."""

    name: str
    source: str  # the path of its overlay, or of the manifest and the name of its host
    variables: Mapping[str, Any]
    groups: tuple[str, ...] = ()
    reason: str = ""  # why it fails its rarms tasks; empty: it does not

    def failing(self, reason: str) -> FoundRobot:
        """Return the robot that fails its rarms tasks.

        Args:
            reason: whole sentences.
        """
        variables = {key: value for key, value in self.variables.items() if key in KEPT_VARIABLES}
        return replace(self, variables={**variables, INVALID: reason}, groups=(INVALID,), reason=reason)


KEPT_VARIABLES = frozenset({"rarms_robot", "rarms_manifest", "rarms_overlays"})
"""Variables of a robot that fails its rarms tasks."""


class _GroupNames(InventoryData):
    """An inventory that has the names of groups, and nothing in them."""

    def add_child(self, group: str, child: str) -> bool:  # noqa: ARG002 - the inventory's
        return False


class InventoryModule(BaseInventoryPlugin, Constructable):
    """`rarms.fleet.manifests`."""

    NAME = "rarms.fleet.manifests"

    def verify_file(self, path: str) -> bool:
        """Whether a file can be an inventory of this plugin, by its name."""
        return super().verify_file(path) and path.endswith(("fleet.yml", "fleet.yaml"))

    def parse(self, inventory: Any, loader: Any, path: str, cache: bool = True) -> None:
        """Add the robots of one inventory file.

        Args:
            inventory: to which they are added.
            loader: reads files.
            path: of the inventory file.
            cache: not used: reading an overlay takes milliseconds.
        """
        super().parse(inventory, loader, path, cache)
        if RARMS_MISSING:
            raise AnsibleParserError(
                f"rarms.fleet needs the Python package rarms-iac in the environment of ansible-core: {RARMS_MISSING}"
            )
        self._read_config_data(path)
        folder = Path(path).resolve().parent
        manifest = str(folder / self.get_option("manifest"))
        common = [str(folder / overlay) for overlay in self.get_option("common")]
        files = sorted({str(file) for pattern in self.get_option("overlays") for file in folder.glob(pattern)})
        if self.get_option("overlays") and not files:
            raise AnsibleParserError(f"{path}: no overlay matches {', '.join(self.get_option('overlays'))}")
        robots = [robot for file in files or [""] for robot in self._robots(manifest, common, file)]
        for robot in self._with_names_of_their_own(robots, folder):
            if robot.reason:
                self.display.warning(f"{robot.name} fails its rarms tasks: {robot.reason}")
            self._add_robot(robot)

    def _robots(self, manifest: str, common: Sequence[str], file: str) -> list[FoundRobot]:
        """Return the robots of one overlay, or of the manifest; a robot that is one host of many has both names."""
        overlays, robot = [*common, *([file] if file else [])], Path(file).stem
        common_variables = {"rarms_manifest": manifest, "rarms_overlays": overlays}
        try:
            hosts = load(manifest, overlays=overlays)
        except (UseCaseError, RequestError, OSError) as error:
            if not file:
                raise AnsibleParserError(f"{manifest}: {_reason(error)}") from error
            return [FoundRobot(robot, file, {"rarms_robot": robot, **common_variables}).failing(_reason(error))]
        robots = []
        for name, host in sorted(hosts.system.hosts.items()):
            variables = {
                **common_variables,
                "rarms_host": name,
                "rarms_robot": hosts.system.application.robot or name,
                "rarms_platform": host.platform,
                "rarms_provider": host.provider.value,
                "rarms_application": hosts.system.application.name,
                **_connection(host),
            }
            robot_name = name if not file else robot if len(hosts.system.hosts) == 1 else f"{robot}-{name}"
            groups = tuple(
                f"rarms_{kind}_{variables[f'rarms_{kind}']}" for kind in ("platform", "provider", "application")
            )
            source = file if file and len(hosts.system.hosts) == 1 else f"{file or manifest}/{name}"
            robots.append(FoundRobot(robot_name, source, variables, groups))
        return robots

    def _with_names_of_their_own(self, robots: Sequence[FoundRobot], folder: Path) -> list[FoundRobot]:
        """Return the robots; one that has the name of a group or another robot fails, under the name of its file."""
        known, self.inventory = self.inventory, _GroupNames()
        try:
            for robot in robots:
                self._add_robot(robot)
            groups = {INVALID, *known.groups, *self.inventory.groups}
        finally:
            self.inventory = known
        counts = Counter(robot.name for robot in robots)
        named = []
        for robot in robots:
            source = relpath(robot.source, folder)
            if robot.name in groups:
                reason = f"{robot.name} is the name of a group of the inventory. Give {source} another name."
            elif counts[robot.name] > 1:
                reason = f"{counts[robot.name]} robots have the name {robot.name}. Give {source} another name."
            else:
                named.append(robot)
                continue
            while source in groups or source in counts:
                source += "/"
            named.append(replace(robot.failing(reason), name=source))
        return named

    def _add_robot(self, robot: FoundRobot) -> None:
        strict = self.get_option("strict") and not robot.reason  # a robot that cannot be read lacks variables
        self.inventory.add_host(robot.name)
        for key, value in robot.variables.items():
            self.inventory.set_variable(robot.name, key, value)
        for group in robot.groups:
            self.inventory.add_child(self.inventory.add_group(self._sanitize_group_name(group)), robot.name)
        self._set_composite_vars(self.get_option("compose"), robot.variables, robot.name, strict=strict)
        self._add_host_to_composed_groups(self.get_option("groups"), robot.variables, robot.name, strict=strict)
        self._add_host_to_keyed_groups(self.get_option("keyed_groups"), robot.variables, robot.name, strict=strict)


def _connection(host: Host) -> dict[str, Any]:
    """How Ansible reaches the host, by what the manifest says; a simulated one is a file next to the manifest."""
    if host.connect is None or host.provider is ProviderKind.SIMULATED:
        return {"ansible_connection": "local"}
    connect = host.connect
    if isinstance(connect, WinRmConnect):
        return _winrm(connect)
    user, address = connect.ssh.rpartition("@")[::2]
    common = {"ProxyJump": connect.jump, "ControlPath": connect.control_path}
    options = " ".join(shlex.quote(f"-o{name}={value}") for name, value in common.items() if value)
    variables = {
        "ansible_host": address,
        "ansible_user": user,
        "ansible_port": connect.port,
        "ansible_ssh_private_key_file": connect.key,
        "ansible_ssh_common_args": options,
        "ansible_shell_type": "powershell" if host.provider is ProviderKind.HYPERV else "",
        "rarms_folder": connect.folder,
    }
    return {name: value for name, value in variables.items() if value}


def _reason(error: UseCaseError | RequestError | OSError) -> str:
    if not isinstance(error, UseCaseError):
        return str(error)
    first = next((each for each in error.findings if each.severity is Severity.ERROR), error.findings[0])
    return f"{f'{first.place}: ' if first.place else ''}{first.summary} ({first.code}): {first.detail}"


def _winrm(connect: WinRmConnect) -> dict[str, Any]:
    """Ansible's `psrp`, by pypsrp as rarms itself; the password is looked up when a task runs, as rarms does."""
    variables = {
        "ansible_connection": "psrp",
        "ansible_host": connect.winrm,
        "ansible_port": connect.port or 5986,
        "ansible_psrp_protocol": "https",
        "ansible_psrp_auth": "negotiate" if connect.user else "kerberos",
        "ansible_user": connect.user,
    }
    if connect.password is not None:
        lookup = f"{{{{ lookup('ansible.builtin.env', '{connect.password.name}') }}}}"
        variables["ansible_password"] = trust_as_template(lookup)
    return {name: value for name, value in variables.items() if value}
