# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""The robots of a fleet from a rarms manifest: one an overlay, or one a host of the manifest."""

from __future__ import annotations

DOCUMENTATION = """
name: manifests
author: The rarms authors (@rarms)
short_description: Robots of a rarms manifest and its overlays
version_added: 0.1.0
description:
  - Makes one host of the inventory for each overlay of a manifest, named after the overlay's file, or one for each host
    of the manifest where no overlays are named.
  - Reads files that are called C(*fleet.yml) or C(*fleet.yaml).
  - A robot whose overlay is broken comes with a warning, in the group C(rarms_invalid), and fails its own rarms tasks
    alone.
extends_documentation_fragment: constructed
requirements: [rarms-iac]
options:
  plugin:
    description: Must be V(rarms.fleet.manifests).
    required: true
    choices: [rarms.fleet.manifests]
  manifest:
    description: The manifest, or the folder of one, relative to this file.
    type: str
    default: rarms.yaml
  overlays:
    description: Patterns of overlay files, relative to this file; each file is a robot.
    type: list
    elements: str
    default: []
  common:
    description: Overlays that lie below each robot's own, relative to this file.
    type: list
    elements: str
    default: []
"""

EXAMPLES = """
# robots.fleet.yml: rarms.yaml for all, robots/r-001.yaml and so on for what is particular to one.
plugin: rarms.fleet.manifests
manifest: rarms.yaml
overlays: [robots/*.yaml]
keyed_groups:
  - key: rarms_platform
    prefix: platform
"""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ansible.errors import AnsibleParserError
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
                f"rarms.fleet needs the Python package rarms-iac beside ansible-core: {RARMS_MISSING}"
            )
        self._read_config_data(path)
        folder = Path(path).resolve().parent
        manifest = str(folder / self.get_option("manifest"))
        common = [str(folder / overlay) for overlay in self.get_option("common")]
        files = sorted({str(file) for pattern in self.get_option("overlays") for file in folder.glob(pattern)})
        if self.get_option("overlays") and not files:
            raise AnsibleParserError(f"{path}: no overlay matches {', '.join(self.get_option('overlays'))}")
        if not files:
            self._add_hosts(manifest, common, "")
        named: dict[str, str] = {}
        for file in files:
            if (other := named.setdefault(Path(file).stem, file)) != file:
                raise AnsibleParserError(f"{path}: {other} and {file} describe robots of one name; rename one.")
            self._add_hosts(manifest, [*common, file], Path(file).stem)

    def _add_hosts(self, manifest: str, overlays: Sequence[str], robot: str) -> None:
        """Add the hosts of one manifest with its overlays; a robot of one host has the robot's name."""
        try:
            hosts = load(manifest, overlays=overlays)
        except (UseCaseError, RequestError) as error:
            if not robot:
                raise AnsibleParserError(f"{manifest}: {_reason(error)}") from error
            self.display.warning(f"{robot} fails its rarms tasks, since it cannot be read: {_reason(error)}")
            variables = {
                "rarms_invalid": _reason(error),
                "rarms_robot": robot,
                "rarms_manifest": manifest,
                "rarms_overlays": list(overlays),
            }
            self._add_robot(robot, variables, ["rarms_invalid"], strict=False)
            return
        names = sorted(hosts.system.hosts)
        for name in names:
            robot_name = name if not robot else robot if len(names) == 1 else f"{robot}-{name}"
            host = hosts.system.hosts[name]
            variables = {
                "rarms_manifest": manifest,
                "rarms_overlays": list(overlays),
                "rarms_host": name,
                "rarms_robot": hosts.system.application.robot or name,
                "rarms_platform": host.platform,
                "rarms_provider": host.provider.value,
                "rarms_application": hosts.system.application.name,
                **_connection(host),
            }
            kinds = ("platform", "provider", "application")
            groups = [f"rarms_{kind}_{variables[f'rarms_{kind}']}" for kind in kinds]
            self._add_robot(robot_name, variables, groups, strict=self.get_option("strict"))

    def _add_robot(self, name: str, variables: dict[str, Any], groups: Sequence[str], *, strict: bool) -> None:
        self.inventory.add_host(name)
        for key, value in variables.items():
            self.inventory.set_variable(name, key, value)
        for group in groups:
            self.inventory.add_child(self.inventory.add_group(self._sanitize_group_name(group)), name)
        self._set_composite_vars(self.get_option("compose"), variables, name, strict=strict)
        self._add_host_to_composed_groups(self.get_option("groups"), variables, name, strict=strict)
        self._add_host_to_keyed_groups(self.get_option("keyed_groups"), variables, name, strict=strict)


def _connection(host: Host) -> dict[str, Any]:
    """How Ansible reaches the host, by what the manifest says; a simulated one is a file beside the manifest."""
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


def _reason(error: UseCaseError | RequestError) -> str:
    if isinstance(error, RequestError):
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
