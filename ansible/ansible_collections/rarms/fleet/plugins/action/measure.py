# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""Measures components on one robot, and brings the data logs back to the manifest's folder."""

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
    from rarms_iac.app.control import Control, always_consents, never_consents
    from rarms_iac.measuring.measure import measure_components
    from rarms_iac.measuring.measure_request import MeasureRequest


class ActionModule(RobotAction):
    """`rarms.fleet.measure`."""

    _supports_check_mode = False
    ARGUMENTS = {
        "components": {"type": "list", "elements": "str", "default": []},
        "stop_partitions": {"type": "bool", "default": False},
    }

    def act(self, robot: Robot, arguments: Mapping[str, Any]) -> Result:
        request = MeasureRequest(components=tuple(arguments["components"]))
        control = Control(consents=always_consents if arguments["stop_partitions"] else never_consents)
        outcome = measure_components(robot.hosts, request, control)
        new = sum(result.new for result in outcome.experiments)
        answer = json_value(outcome)
        logs = sorted({result.log for result in outcome.experiments})
        result = {"changed": new > 0, "measured": answer, "logs": logs, "new_settings": new}
        if any(finding["severity"] == "error" for finding in answer["findings"]):
            return {**result, **failure(findings=answer["findings"]), "changed": new > 0}
        return result
