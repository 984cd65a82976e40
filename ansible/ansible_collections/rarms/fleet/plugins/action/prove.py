# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""Runs all components of a robot's applied layout, and holds each against its thresholds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ansible_collections.rarms.fleet.plugins.plugin_utils.on_robot import RUN_ON_ROBOT, fetch_measurements, run_on_robot
from ansible_collections.rarms.fleet.plugins.plugin_utils.robot import (
    RARMS_MISSING,
    Result,
    Robot,
    RobotAction,
    failure,
    json_value,
)

if not RARMS_MISSING:
    from rarms_iac.app.experiments.prove import prove_layout
    from rarms_iac.app.use_case_errors import RequestError
    from rarms_iac.model.host import ProviderKind


class ActionModule(RobotAction):
    """`rarms.fleet.prove`."""

    _supports_check_mode = False
    ARGUMENTS = {**RUN_ON_ROBOT, "load_host": {"type": "bool", "default": False}}

    def act(self, robot: Robot, arguments: Mapping[str, Any]) -> Result:
        if not arguments["load_host"]:
            raise RequestError("A proof uses all idle time of the robot while it lasts: say `load_host: true`.")
        self._display.display(f"{robot.name}: the proof uses all idle time of {robot.host} until it ends.")
        if robot.provider is ProviderKind.SIMULATED:
            answer, code = json_value(prove_layout(robot.hosts)), 0
            logs: list[str] = []
        else:
            channel = robot.hosts.channels[robot.host]
            answer, code = run_on_robot(channel, robot, arguments, ["prove", "--load-host"])
            logs = fetch_measurements(channel, robot, arguments["folder"])
        if code == 0 and answer.get("kind") == "prove" and answer["met"]:
            return {"changed": bool(logs), "proof": answer}
        ended = "" if answer["findings"] else f"The proof did not end: rarms ended with {code}."
        return {**failure(ended, answer["findings"]), "changed": bool(logs), "proof": answer}
