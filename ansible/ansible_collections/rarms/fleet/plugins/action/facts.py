# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""Looks at a robot: how its application stands, and what the host looks like."""

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
    from rarms_iac.app.hosts import record_host
    from rarms_iac.app.status import overview_of
    from rarms_iac.app.use_case_errors import Outcome, UseCaseError


class ActionModule(RobotAction):
    """`rarms.fleet.facts`."""

    def act(self, robot: Robot, arguments: Mapping[str, Any]) -> Result:  # noqa: ARG002 - it takes none of its own
        overview = overview_of(robot.hosts)
        problems = [problem for host in overview.hosts for problem in host.problems]
        if problems:
            raise UseCaseError(Outcome.FAILED, problems)
        snapshot = record_host(robot.hosts.open(robot.host)).decode("utf-8")
        status = json_value(overview)
        return {"changed": False, "ansible_facts": {"rarms": {"status": status, "snapshot": snapshot}}}
