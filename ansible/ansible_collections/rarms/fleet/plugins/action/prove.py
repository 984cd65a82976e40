# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""Runs all components of a robot's applied layout, and holds each against its thresholds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ansible_collections.rarms.fleet.plugins.plugin_utils.robot import (
    RARMS_MISSING,
    Result,
    Robot,
    RobotAction,
    failure,
    json_value,
)

if not RARMS_MISSING:
    from rarms_iac.app.use_case_errors import RequestError
    from rarms_iac.measuring.prove import prove_layout


class ActionModule(RobotAction):
    """`rarms.fleet.prove`."""

    _supports_check_mode = False
    ARGUMENTS = {"load_host": {"type": "bool", "default": False}}

    def act(self, robot: Robot, arguments: Mapping[str, Any]) -> Result:
        if not arguments["load_host"]:
            raise RequestError("A proof uses all idle time of the robot. To allow this, set `load_host: true`.")
        self._display.display(f"{robot.name}: the proof uses all idle time of {robot.host} until it ends.")
        outcome = prove_layout(robot.hosts)
        answer = json_value(outcome)
        if outcome.met:
            return {"changed": False, "proof": answer}
        return {**failure("" if outcome.findings else "The proof did not end.", answer["findings"]), "proof": answer}
