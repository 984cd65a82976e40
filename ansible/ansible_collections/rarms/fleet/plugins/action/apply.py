# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""Plans a robot, applies that or a reviewed plan, or removes what rarms made there."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
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
    from rarms_iac.app.applying import abandon_runs, apply, finish_runs
    from rarms_iac.app.files import make_folder
    from rarms_iac.app.hosts import refuse_unfinished, unfinished_runs
    from rarms_iac.app.plan_files import read_plan_file, write_plan_file
    from rarms_iac.app.planning import plan as make_plan
    from rarms_iac.app.planning import plan_request
    from rarms_iac.app.requests import PlanLimits, read_time
    from rarms_iac.app.undoing import last_applies, undo_applies
    from rarms_iac.app.use_case_errors import RequestError, UseCaseError
    from rarms_iac.applying.run_report import RunEnding, RunReport
    from rarms_iac.model.plan import Plan, Purpose
    from rarms_iac.model.system import Disruption
    from rarms_iac.providers.interface import WaitLimits
    from rarms_iac.views.changes import attributes_of


class ActionModule(RobotAction):
    """`rarms.fleet.apply`."""

    ARGUMENTS = {
        "state": {"type": "str", "choices": ["planned", "applied", "absent"], "default": "applied"},
        "plan": {"type": "path"},
        "max_disruption": {"type": "str", "choices": ["live", "partition_stop", "host_restart", "removal"]},
        "unfinished": {"type": "str", "choices": ["finish", "undo", "abandon", "fail"], "default": "finish"},
        "lock_timeout": {"type": "str", "default": "0s"},
    }

    def act(self, robot: Robot, arguments: Mapping[str, Any]) -> Result:
        """End what is unfinished, plan, and do it."""
        state = arguments["state"]
        file = arguments["plan"] and self._below(arguments["plan"])
        if state == "absent" and file:
            raise RequestError("`state: absent` makes its own plan. Remove `plan` from the task.")
        waits = _waits(arguments["lock_timeout"])
        is_preview = state == "planned" or self._task.check_mode
        reviewed = _reviewed(robot, file) if state == "applied" and file else None
        if self._task.check_mode and state != "planned" and arguments["unfinished"] != "fail":
            if list(unfinished_runs(robot.hosts)):
                return {"changed": True, "msg": f"rarms ends an unfinished run first (`{arguments['unfinished']}`)."}
        elif is_preview or arguments["unfinished"] == "fail":
            refuse_unfinished(robot.hosts)
        elif (ended_before := _end_unfinished(robot, arguments["unfinished"], waits)) is not None:
            self.has_changed = True
            if ended_before.ending is not RunEnding.DONE:
                return self._ended(ended_before)
        plan = make_plan(robot.hosts, _request(robot, arguments)) if reviewed is None else reviewed
        result = self._planned(plan, robot.name)
        if is_preview:
            if file and state == "planned" and not self._task.check_mode:
                make_folder(str(Path(file).parent))
                write_plan_file(file, plan)
            return {**result, "changed": state != "planned" and plan.has_changes}
        report = apply(plan, folder=robot.hosts.folder, waits=waits, channels=robot.hosts.channels)
        ended = self._ended(report)
        return {**result, **ended, "changed": ended["changed"] or self.has_changed}

    def remove_stale(self, arguments: Mapping[str, Any], variables: Mapping[str, Any]) -> None:
        """Remove this robot's plan of an earlier run: it must not be reviewed as today's. What is no plan stays."""
        if arguments["state"] != "planned" or not arguments["plan"] or self._task.check_mode:
            return
        file = self._below(arguments["plan"])
        with suppress(RequestError, UseCaseError, OSError):
            if read_plan_file(file).robot in {"", variables.get("rarms_robot", "")}:
                Path(file).unlink()

    def _planned(self, plan: Plan, robot: str) -> Result:
        result: Result = {"plan": json_value(plan), "has_changes": plan.has_changes}
        if self._task.diff:
            result["diff"] = [_difference(change, part.facts, robot) for part in plan.hosts for change in part.changes]
        return result

    def _ended(self, report: RunReport) -> Result:
        ended = {"changed": any(host.changed for host in report.hosts), "run": json_value(report)}
        if report.ending in {RunEnding.DONE, RunEnding.NOTHING}:
            return ended
        findings = ended["run"]["findings"]
        return {**failure("" if findings else f"The run was {report.ending.value}.", findings), **ended}


def _request(robot: Robot, arguments: Mapping[str, Any]) -> Any:
    limit = arguments["max_disruption"]
    limits = PlanLimits(max_disruption=Disruption(limit) if limit else None)
    request = plan_request(robot.hosts, limits)
    return replace(request, purpose=Purpose.DESTROY) if arguments["state"] == "absent" else request


def _waits(lock_timeout: str) -> WaitLimits:
    try:
        return WaitLimits(lock_ms=read_time(lock_timeout))
    except ValueError as error:
        raise RequestError(f"`lock_timeout`: {error}") from error


def _end_unfinished(robot: Robot, how: str, waits: WaitLimits) -> RunReport | None:
    """End the run that an earlier task or person left; None: there is none."""
    if not list(unfinished_runs(robot.hosts)):
        return None
    host = robot.hosts.open(robot.host)
    match how:
        case "finish":
            needs_key = robot.hosts.system.policy.signed_plans
            return finish_runs([host], waits=waits, needs_key=needs_key)
        case "undo":
            return undo_applies(last_applies(robot.hosts), waits=waits)
        case _:
            return next(iter(abandon_runs([host], waits=waits).values()))


def _reviewed(robot: Robot, file: str) -> Plan:
    plan = read_plan_file(file)
    names = [part.host.name for part in plan.hosts]
    own = robot.hosts.system.application
    if names != [robot.host] or (plan.application, plan.robot) != (own.name, own.robot):
        whose = f"{plan.application} on {', '.join(names)}" + (f" of {plan.robot}" if plan.robot else "")
        raise RequestError(f"{file} is a plan of {whose}, not of this robot.")
    return plan


def _difference(change: Any, facts: Any, robot: str) -> Result:
    """Return a change in the words of `rarms plan`."""
    header = f"{robot} {change.address}"
    texts = attributes_of(change, facts)
    before, after = (
        "".join(f"{text.name}: {value}\n" for text in texts if (value := getattr(text, side)) is not None)
        for side in ("before", "after")
    )
    return {"before_header": header, "after_header": header, "before": before, "after": after}
