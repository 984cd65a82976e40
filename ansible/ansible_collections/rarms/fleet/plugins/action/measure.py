# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""Measures components on one robot, and brings the data logs back beside the manifest."""

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
    from rarms_iac.app.control import Control, always_consents, never_consents
    from rarms_iac.app.experiments.measure import measure_components
    from rarms_iac.app.experiments.measure_request import MeasureRequest
    from rarms_iac.model.host import ProviderKind


class ActionModule(RobotAction):
    """`rarms.fleet.measure`."""

    _supports_check_mode = False
    ARGUMENTS = {
        **RUN_ON_ROBOT,
        "components": {"type": "list", "elements": "str", "default": []},
        "stop_partitions": {"type": "bool", "default": False},
    }

    def act(self, robot: Robot, arguments: Mapping[str, Any]) -> Result:
        if robot.provider is ProviderKind.SIMULATED:
            request = MeasureRequest(components=tuple(arguments["components"]))
            control = Control(consents=always_consents if arguments["stop_partitions"] else never_consents)
            outcome = measure_components(robot.hosts, request, control)
            answer, code = json_value(outcome), 0
            logs = sorted({result.log for result in outcome.experiments})
        else:
            channel = robot.hosts.channels[robot.host]
            stop = ["--stop-partitions"] if arguments["stop_partitions"] else []
            answer, code = run_on_robot(channel, robot, arguments, ["measure", *arguments["components"], *stop])
            logs = fetch_measurements(channel, robot, arguments["folder"])
        new = sum(experiment["new"] for experiment in answer.get("experiments", ()))
        result = {"changed": new > 0, "measured": answer, "logs": logs, "new_settings": new}
        errors = [finding for finding in answer["findings"] if finding["severity"] == "error"]
        if errors or code:
            ended = "" if errors else f"rarms ended with {code} on the robot."
            return {**result, **failure(ended, answer["findings"]), "changed": new > 0}
        return result
