# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""What the action plugins share: a robot of the inventory as rarms sees it, and what they return of it.

In come a task's arguments and the robot's variables; out go `Hosts` of rarms with Ansible's connection as their
channel, and results as plain values. rarms runs in Ansible's own process. Begin at `RobotAction`.
"""

from __future__ import annotations

import importlib
import json
import resource
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ansible.errors import AnsibleActionFail, AnsibleConnectionFailure
from ansible.plugins.action import ActionBase

try:
    from rarms_iac.app.applying import apply
    from rarms_iac.app.hosts import Hosts, host_errors, load
    from rarms_iac.app.planning import plan
    from rarms_iac.app.use_case_errors import RequestError, UseCaseError
    from rarms_iac.model.diagnostics import Findings
    from rarms_iac.model.host import Connect, ProviderKind
    from rarms_iac.providers.channel import CommandChannel, CommandResult
    from rarms_iac.providers.hyperv.winrm import ServiceChannel
    from rarms_iac.providers.interface import HostFailed, HostUnreachable
    from rarms_iac.storage.reading import STATE_LIMIT
    from rarms_iac.views.json_output import json_of
except ImportError as error:
    RARMS_MISSING = str(error)
else:
    RARMS_MISSING = ""

Result = dict[str, Any]

LAST_CHARACTERS = 2_000  # of a command's standard error
COPIES = 8  # bytes, text and lines of an answer, each while it grows
MOST_REASONS = 3  # findings that the one line of a failed task names; the result has all
PLAY_ADVICE = {
    "RARMS100": "To measure, play the role rarms.fleet.measure.",
    "RARMS115": "To stop its partitions while it measures, set `rarms_measure_stop_partitions: true` for the role, or "
    "`stop_partitions: true` for the task.",
    "RARMS182": "To write a new plan, use `state: planned`.",
    "RARMS410": "To install it on the robot, play the role rarms.fleet.install.",
}
"""What a play does about a finding, whose own advice is for the command line."""
ROBOT_ARGUMENTS = {
    "manifest": {"type": "path"},
    "overlays": {"type": "list", "elements": "path"},
    "host": {"type": "str"},
    "unreachable": {"type": "str", "choices": ["failed", "unreachable"], "default": "failed"},
}


WARM_UP_MANIFEST = """
schema: rarms/v1
application: { name: warm-up }
hosts: { onboard: { provider: simulated, logical_processors: 1, memory: 1 GiB } }
components: { one: { criticality: 1, memory: 64 MiB, cpu: { reserve: 0.1 LP } } }
"""


@dataclass(frozen=True)
class Robot:
    """A host of the inventory: its manifest with overlays, and the host of the manifest that it is."""

    name: str
    hosts: Hosts
    host: str

    @property
    def provider(self) -> ProviderKind:
        """What enforces reservations there."""
        return self.hosts.system.hosts[self.host].provider

    @property
    def connect(self) -> Connect | None:
        """How the manifest says that the robot is reached; None: it is this machine."""
        return self.hosts.system.hosts[self.host].connect

    @property
    def platform(self) -> str:
        """What its data logs are kept under."""
        return self.hosts.system.hosts[self.host].platform


class ConnectionChannel:
    """A `CommandChannel` of rarms: Ansible's own connection to the robot, with its `become`."""

    def __init__(self, action: ActionBase, host: str) -> None:
        self._action = action
        self._host = host
        self._was_reached = False

    @property
    def target(self) -> str:
        """The robot as Ansible reaches it."""
        play = self._action._play_context
        address = play.remote_addr or "this machine"
        return f"{play.remote_user}@{address}" if play.remote_user else address

    def run(self, command: str, data: bytes, silence_s: float) -> CommandResult:  # noqa: ARG002 - the protocol's
        """Run one command there; Ansible waits for it as long as the task's own `timeout` says."""
        try:
            # NOTE: never without input: Ansible's ssh would ask for a terminal, and that joins error and output.
            with _bounded_memory():
                result = self._action._low_level_execute_command(command, in_data=data or b"\n")
        except MemoryError:
            raise self._too_much() from None
        except AnsibleConnectionFailure as failure:
            advice = "Test the connection: `ansible ROBOT -m ansible.builtin.raw -a true`."
            if self._was_reached:
                raise HostFailed(self._host, f"the connection to {self.target} broke: {failure}", advice) from failure
            raise HostUnreachable(self._host, f"{self.target} cannot be reached: {failure}", advice) from failure
        self._was_reached = True
        if len(result["stdout"]) > STATE_LIMIT:
            raise self._too_much()
        return CommandResult(code=result["rc"], output=result["stdout"], error=result["stderr"][-LAST_CHARACTERS:])

    def _too_much(self) -> HostFailed:
        message = f"{self.target} answered with more than {STATE_LIMIT:,} characters"
        return HostFailed(self._host, message, "Check the output of its login scripts and programs.")


@contextmanager
def _bounded_memory() -> Iterator[None]:
    """Bound the memory of this process, which has one task on one robot: Ansible keeps all that the robot answers.

    Raises:
        MemoryError: it needs more than an answer of `STATE_LIMIT`, of which Ansible makes copies.
    """
    before = resource.getrlimit(resource.RLIMIT_AS)
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    except OSError:  # not Linux: the length of the answer is looked at when all of it is there
        yield
        return
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + COPIES * STATE_LIMIT, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


class RobotAction(ActionBase):
    """An action on one robot: its arguments are checked, its manifest is read, and its errors become a result."""

    _supports_check_mode = True
    _supports_diff = True
    _requires_connection = True
    ARGUMENTS: Mapping[str, Any] = {}
    """The arguments of the action besides `ROBOT_ARGUMENTS`, as Ansible describes arguments."""
    has_changed = False
    """Whether the robot was changed already, should the rest fail."""

    def run(self, tmp: str | None = None, task_vars: Mapping[str, Any] | None = None) -> Result:
        """Do the action; a robot that cannot be reached fails, unless the task says `unreachable: unreachable`."""
        super().run(tmp, task_vars)
        if RARMS_MISSING:
            raise AnsibleActionFail(
                f"rarms.fleet needs the Python package rarms-iac in the environment of ansible-core: {RARMS_MISSING}"
            )
        arguments = self.validate_argument_spec(argument_spec={**ROBOT_ARGUMENTS, **self.ARGUMENTS})[1]
        variables = task_vars or {}
        try:
            with host_errors():
                result = self.act(self._robot(arguments, variables), arguments)
        except RequestError as error:
            result = failure(str(error))
        except UseCaseError as error:
            result = failure(findings=json_value(Findings(findings=tuple(error.findings)))["findings"])
        except OSError as error:
            result = failure(str(error))
        if result.get("failed"):
            self.remove_stale(arguments, variables)
            result = {**result, "changed": result["changed"] or self.has_changed}
        if result.get("rarms_unreachable") and arguments["unreachable"] == "unreachable":
            raise AnsibleConnectionFailure(result["msg"])
        return {"robot": variables["inventory_hostname"], **result}

    def remove_stale(self, arguments: Mapping[str, Any], variables: Mapping[str, Any]) -> None:
        """Remove what an earlier task left and this one, which failed, could not make again.

        Args:
            arguments: the task's, checked.
            variables: the robot's.
        """

    @abstractmethod
    def act(self, robot: Robot, arguments: Mapping[str, Any]) -> Result:
        """Do what the action is for.

        Args:
            robot: the robot; it was not reached yet.
            arguments: the task's, checked.

        Returns:
            A result of Ansible; `failed` where it did not end well.

        Raises:
            UseCaseError: rarms ended without an answer.
        """

    def _robot(self, arguments: Mapping[str, Any], variables: Mapping[str, Any]) -> Robot:
        if invalid := variables.get("rarms_invalid"):
            raise RequestError(f"The robot cannot be read: {invalid}")
        manifest = arguments["manifest"] or variables.get("rarms_manifest")
        if not manifest:
            raise RequestError("No manifest is set. Use the inventory plugin rarms.fleet.manifests, or set `manifest`.")
        overlays = arguments["overlays"] or variables.get("rarms_overlays") or ()
        hosts = load(self._below(manifest), overlays=[self._below(overlay) for overlay in overlays])
        host = arguments["host"] or variables.get("rarms_host") or _only_host(hosts)
        if host not in hosts.system.hosts:
            raise RequestError(f"The manifest has no host {host}. It has: {', '.join(sorted(hosts.system.hosts))}.")
        robot = Robot(name=variables["inventory_hostname"], hosts=hosts.only(host), host=host)
        if robot.provider is ProviderKind.SIMULATED:
            return robot
        return replace(robot, hosts=replace(robot.hosts, channels={host: self.channel(robot)}))

    def channel(self, robot: Robot) -> CommandChannel:
        """Return Ansible's connection to the robot.

        Args:
            robot: the task's.

        Raises:
            RequestError: it is Ansible's `winrm`.
        """
        if self._connection.transport == "winrm":
            raise RequestError(
                "Ansible's `winrm` does not pass standard input to a command. Set `ansible_connection: psrp`, which "
                "uses the same service of the robot."
            )
        ansible = ConnectionChannel(self, robot.host)
        if self._connection.transport == "psrp":
            return ServiceChannel(host=robot.host, target=ansible.target, reach=self._service)
        return ansible

    def _service(self) -> Any:
        """Pypsrp's way to the robot, which Ansible's `psrp` has opened."""
        try:
            self._connection._connect()
        except AnsibleConnectionFailure as failure:
            raise ConnectionError(str(failure)) from failure
        return self._connection.runspace.connection

    def _below(self, path: str) -> str:
        """Return a path as Ansible's users mean it: relative to the playbook."""
        return self._loader.path_dwim(path)


def warm_up() -> None:
    """Plan and apply once in a folder of its own, on a simulated host.

    Ansible imports an action before it forks a process for each robot. What rarms imports and works out when it is
    first needed is then there for all of them: it takes 0.2 s once instead of 40 ms a robot.
    """
    importlib.import_module("rarms_iac.providers.robot")
    with TemporaryDirectory(prefix="rarms-") as folder:
        manifest = Path(folder) / "rarms.yaml"
        manifest.write_text(WARM_UP_MANIFEST, encoding="utf-8")
        hosts = load(str(manifest))
        apply(plan(hosts), folder=folder)
        json_value(plan(hosts))


def failure(message: str = "", findings: Sequence[Result] = ()) -> Result:
    """Make a failed result.

    Args:
        message: for people; empty: the findings say it.
        findings: the reasons, as rarms writes them in JSON.
    """
    errors = [each for each in findings if each["severity"] == "error"] or findings
    reasons = [f"{each['summary']} ({each['code']}): {each['detail']}" for each in errors[:MOST_REASONS]]
    if len(errors) > MOST_REASONS:
        reasons.append(f"and {len(errors) - MOST_REASONS} more.")
    advice = dict.fromkeys(PLAY_ADVICE[each["code"]] for each in errors if each["code"] in PLAY_ADVICE)
    return {
        "failed": True,
        "changed": False,
        "msg": message or " ".join(["; ".join(reasons), *advice]),
        "findings": list(findings),
        "rarms_unreachable": any(each["values"].get("unreachable", False) for each in findings),
    }


def json_value(answer: Any) -> Result:
    """Return an answer of rarms as `rarms --json` writes it.

    Args:
        answer: what a use case returned.
    """
    return json.loads(json_of(answer))


def _only_host(hosts: Hosts) -> str:
    names = sorted(hosts.system.hosts)
    if len(names) != 1:
        raise RequestError(f"The manifest has the hosts {', '.join(names)}. Set `host` to the host of this robot.")
    return names[0]


if not RARMS_MISSING:
    warm_up()
