# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""Installs the controller's version of rarms on a Linux robot, or removes rarms there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ansible_collections.rarms.fleet.plugins.plugin_utils.robot import (
    RARMS_MISSING,
    Result,
    Robot,
    RobotAction,
    json_value,
)

if not RARMS_MISSING:
    from rarms_iac.app.install import InstallRequest, hosts_to_change, install
    from rarms_iac.model.host import ProviderKind


class ActionModule(RobotAction):
    """`rarms.fleet.install`."""

    ARGUMENTS = {
        "state": {"type": "str", "choices": ["present", "absent"], "default": "present"},
        "wheels": {"type": "path"},
    }

    def act(self, robot: Robot, arguments: Mapping[str, Any]) -> Result:
        """Install or remove; a robot that is no Linux host is passed over."""
        if robot.provider is not ProviderKind.LINUX:
            return {"changed": False, "skipped": True, "msg": "rarms is installed on Linux hosts."}
        wheels = arguments["wheels"] and self._below(arguments["wheels"])
        request = InstallRequest(wheels=wheels, removing=arguments["state"] == "absent")
        if self._task.check_mode:
            return {"changed": bool(hosts_to_change(robot.hosts, request))}
        result = json_value(install(robot.hosts, request))
        (host,) = result["hosts"]
        return {"changed": host["changed"], "installed": host, "findings": result["findings"]}
