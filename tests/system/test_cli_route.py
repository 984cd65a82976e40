"""The route of a user, command after command, each in this process; exit codes are those of `cli.ending`."""

import json
import re
from dataclasses import replace
from datetime import date
from pathlib import Path

import pytest

from rarms_iac.app.hosts import Hosts, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.providers.simulated.provider import SimulatedHostProvider
from rarms_iac.storage.shipped import shipped
from tests.unit.cli.running import Ran, rarms
from tests.unit.views.test_json import check


class Robot:
    """A folder with a manifest of two partitions on a simulated host, and the commands run on it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.manifest = folder / "rarms.yaml"
        assert rarms("init", str(folder), "--name", "robot").code == 0

    def run(self, *words: str, stdin: str = "") -> Ran:
        """The command with this manifest."""
        return rarms(words[0], "-f", str(self.manifest), *words[1:], stdin=stdin)

    def applied(self) -> "Robot":
        """This robot, its manifest applied."""
        assert self.run("apply", "--auto-approve").code == 0
        return self

    def edit(self, old: str, new: str) -> None:
        """Change the manifest."""
        text = self.manifest.read_text(encoding="utf-8")
        assert old in text
        self.manifest.write_text(text.replace(old, new), encoding="utf-8", newline="\n")

    def planned(self, *words: str) -> str:
        """A plan file made now."""
        path = str(self.folder / "robot.plan")
        assert self.run("plan", "--out", path, *words).code == 0
        return path

    def hosts(self) -> Hosts:
        """The hosts as the commands see them."""
        source = ManifestSource(manifest=str(self.manifest), today=date(2026, 11, 21))
        return select_hosts(load_manifest(source), HostSelection())

    def host(self) -> SimulatedHostProvider:
        """The live host."""
        host = self.hosts().open("onboard")
        assert isinstance(host, SimulatedHostProvider)
        return host

    def another_tool_sets_a_reserve(self, name: str, reserve: int) -> None:
        """Change the host behind rarms' back."""
        host = self.host()
        content = host.load()
        machines = {
            key: replace(machine, settings=replace(machine.settings, reserve=reserve))
            if machine.settings.name == name
            else machine
            for key, machine in content.machines.items()
        }
        host.save(replace(content, machines=machines))

    def fails_at(self, operation: str) -> None:
        """Ask the host to fail this operation, once."""
        self.edit(
            "provider: simulated",
            "provider: simulated\n    simulated: "
            f'{{ faults: {{ broken: {{ operation: {operation}, at: "*", effect: refuse, times: 1 }} }} }}\n    #',
        )


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    """A fresh one."""
    return Robot(tmp_path)


def test_plan_apply_plan_is_empty(robot: Robot) -> None:
    planned = robot.run("plan")
    applied = robot.run("apply", "--auto-approve")
    again = robot.run("plan")

    assert (planned.code, applied.code, again.code) == (0, 0, 0)
    assert planned.lines[-1] == "Plan: 2 to add, 0 to change, 0 to remove."
    assert "Applied on" in applied.err
    assert again.out == "No changes. The host is as in the manifest.\n"


def test_a_plan_points_at_the_line_that_asks(robot: Robot) -> None:
    line = robot.manifest.read_text(encoding="utf-8").splitlines().index("  control:") + 1

    assert any(f"rarms.yaml:{line})" in shown for shown in robot.run("plan", "--verbose").lines)


def test_failed_step_says_so_and_apply_finishes_it(robot: Robot) -> None:
    robot.fails_at("start_partition")

    failed = robot.run("apply", "--auto-approve")
    refused = robot.run("plan")
    finished = robot.run("apply")

    assert (failed.code, refused.code, finished.code) == (1, 3, 0)
    assert "error[RARMS186]" in failed.err
    assert "error[RARMS183]" in refused.err
    assert "continued from an earlier run" in " ".join(finished.err.split())
    assert robot.run("plan").code == 0


def test_finished_run_is_proven_only_if_asked(robot: Robot) -> None:
    robot.fails_at("start_partition")
    assert robot.run("apply", "--auto-approve").code == 1
    text = robot.manifest.read_text(encoding="utf-8")
    robot.manifest.write_text(text.replace("schema: rarms/v1", "schema: rarms/v1\nnothing: 1"), encoding="utf-8")

    unproven = robot.run("apply", "--prove", "--load-host", "--auto-approve")

    assert unproven.code == 4
    assert "continued from an earlier run" in " ".join(unproven.err.split())


def test_only_its_own_application_takes_an_apply_back(robot: Robot) -> None:
    assert robot.run("apply", "--auto-approve").code == 0
    other = of_another_application(robot)

    refused = rarms("undo", "-f", str(other), "--auto-approve")

    assert refused.code == 3
    assert "error[RARMS340]" in refused.err
    assert '"robot"' in refused.err
    assert robot.run("plan").code == 0
    assert robot.run("undo", "--auto-approve").code == 0


def of_another_application(robot: Robot) -> Path:
    """A manifest beside it that shares its hosts."""
    other = robot.manifest.with_name("two.yaml")
    text = robot.manifest.read_text(encoding="utf-8")
    assert "name: robot" in text
    other.write_text(text.replace("name: robot", "name: two"), encoding="utf-8")
    return other


@pytest.mark.parametrize("command", ["destroy", "stop", "start"])
def test_another_run_is_finished_first(robot: Robot, command: str) -> None:
    robot.fails_at("start_partition")
    assert robot.run("apply", "--auto-approve").code == 1

    asked = robot.run(command, "--auto-approve")
    again = robot.run(command, "--auto-approve")

    assert asked.code == 0
    assert "continued from an earlier run" in " ".join(asked.err.split())
    assert again.out.startswith("No changes.")


def test_unfinished_run_is_finished_despite_manifest_errors(robot: Robot) -> None:
    robot.fails_at("start_partition")
    assert robot.run("apply", "--auto-approve").code == 1
    robot.edit("criticality: 20", "criticalty: 20")

    finished = robot.run("apply")
    nothing_begun = robot.run("apply")

    assert (finished.code, nothing_begun.code) == (0, 4)
    robot.edit("criticalty: 20", "criticality: 20")
    assert robot.run("plan").code == 0


def test_a_plan_takes_no_wishes_beside_it(robot: Robot) -> None:
    answer = rarms("apply", robot.planned(), "--target", "partition/control")

    assert answer.code == 64
    assert "cannot be combined with" in answer.err


def test_foreign_plan_applies_beside_the_named_manifest(robot: Robot, tmp_path: Path) -> None:
    here = robot.planned()
    other = tmp_path / "other"
    other.mkdir()
    other_robot = Robot(other)

    assert other_robot.run("apply", here).code == 0
    assert other_robot.run("plan").code == 0
    assert robot.run("plan").code == 0


def test_two_hosts_are_planned_applied_and_undone_together(tmp_path: Path) -> None:
    source = shipped("manifests/two-hosts/rarms.yaml").read_bytes()
    manifest = tmp_path / "rarms.yaml"
    manifest.write_bytes(source)

    def run(*words: str) -> Ran:
        return rarms(words[0], "-f", str(manifest), *words[1:])

    assert run("plan").code == 0
    assert run("apply", "--auto-approve").code == 0
    assert run("plan").code == 0
    assert run("snapshot").code == 64
    assert run("snapshot", "--out", str(manifest)).code == 64
    assert run("snapshot", "--out", str(tmp_path / "new" / "folder")).code == 0
    assert len(list((tmp_path / "new" / "folder").iterdir())) == 2
    unknown = run("release", "nobody", "--auto-approve")
    assert unknown.code == 64
    assert "On cabinet and camera-box, sorting-line does not have the partition" in unknown.err, "each host is asked"
    assert run("undo", "--auto-approve").code == 0
    assert run("plan").code == 0


def test_another_plan_is_refused_while_run_is_unfinished(robot: Robot) -> None:
    robot.fails_at("start_partition")
    plan = robot.planned("--target", "partition/control")
    assert robot.run("apply", "--auto-approve").code == 1

    answer = rarms("apply", plan)

    assert answer.code == 3
    assert "error[RARMS183]" in answer.err


def test_held_host_names_its_holder(robot: Robot) -> None:
    robot.applied().edit("reserve: 30 %", "reserve: 35 %")
    with robot.host().lock("somebody@elsewhere"):
        answer = robot.run("apply", "--auto-approve")

    assert answer.code == 3
    assert "somebody@elsewhere" in answer.err


REMOVED_CONTROL = r"control +another tool removed it or its mark of rarms +reserve +0.6 LP"


def test_drift_tells_foreign_removal_from_own(robot: Robot) -> None:
    never = robot.run("drift")
    robot.applied()
    host = robot.host()
    content = host.load()
    control = next(key for key, machine in content.machines.items() if machine.settings.name == "control")
    host.save(replace(content, machines={key: machine for key, machine in content.machines.items() if key != control}))
    removed = robot.run("drift")
    host.save(content)
    assert robot.run("destroy", "--auto-approve").code == 0
    destroyed = robot.run("drift")
    robot.applied()
    assert robot.run("undo", "--auto-approve").code == 0
    undone = robot.run("drift")

    assert [answer.code for answer in (never, removed, destroyed, undone)] == [5, 2, 5, 5]
    assert re.search(REMOVED_CONTROL, removed.out)
    assert re.search(r"control +it is not on the host: .* reserve +0.6 LP", destroyed.out)
    assert "not applied yet, or removed by rarms" in " ".join(undone.out.split())


def test_untouched_partition_is_still_known(robot: Robot) -> None:
    robot.applied().edit("reserve: 20 %", "reserve: 25 %")
    robot.applied()
    host = robot.host()
    content = host.load()
    host.save(
        replace(
            content,
            machines={key: machine for key, machine in content.machines.items() if machine.settings.name != "control"},
        )
    )

    assert robot.run("drift").code == 2
    assert robot.run("undo", "--auto-approve").code == 0
    assert re.search(REMOVED_CONTROL, robot.run("drift").out)


def test_undo_takes_the_last_apply_back_once(robot: Robot) -> None:
    robot.applied().edit("reserve: 30 %", "reserve: 35 %")
    robot.applied()

    undone = robot.run("undo", "--auto-approve")
    again = robot.run("undo", "--auto-approve")

    assert undone.code == 0
    assert "note[RARMS174]" in again.err
    assert "0.6 LP -> 0.7 LP" in robot.run("plan").out


@pytest.mark.parametrize("command", ["undo", "apply"])
def test_damaged_host_is_told_before_anything_is_begun(robot: Robot, command: str) -> None:
    robot.applied().edit("reserve: 30 %", "reserve: 35 %")
    file = robot.folder / ".rarms" / "hosts" / "onboard.json"
    whole = file.read_bytes()
    file.write_bytes(whole.replace(b'"reserve":', b'"reserve": '))
    before = robot.host().journal()

    answer = robot.run(command, "--auto-approve")

    assert answer.code == 1
    assert "error[RARMS190]" in answer.err
    assert robot.host().journal() == before
    file.write_bytes(whole)
    assert robot.run("undo", "--auto-approve").code == 0


def test_plan_on_recreated_host_is_refused(robot: Robot) -> None:
    robot.applied().edit("reserve: 30 %", "reserve: 35 %")
    path = robot.planned()
    (robot.folder / ".rarms").rename(robot.folder / "moved-away")

    answer = robot.run("apply", path)

    assert answer.code == 3
    assert "error[RARMS182]" in answer.err
    assert "onboard is not the host of the plan" in answer.err


def test_changes_are_an_exit_code_on_request(robot: Robot) -> None:
    assert [robot.run("plan", *words).code for words in ((), ("--detailed-exitcode",))] == [0, 2]

    robot.applied()

    assert robot.run("plan", "--detailed-exitcode").code == 0


def test_a_snapshot_plans_without_the_host(robot: Robot) -> None:
    robot.applied()
    snapshot = robot.folder / "onboard.json"
    assert robot.run("snapshot", "--out", str(snapshot)).code == 0
    robot.another_tool_sets_a_reserve("display", 11)

    assert robot.run("plan", "--snapshot", str(snapshot)).code == 0
    assert robot.run("plan", "--snapshot", f"onboard={snapshot}").code == 0
    assert robot.run("plan").code == 0
    assert json.loads(robot.run("snapshot").out)["format_version"] == "rarms-snapshot/1"


def test_unknown_host_is_wrong_usage(robot: Robot) -> None:
    answer = robot.run("plan", "--host", "onbord")

    assert answer.code == 64
    assert 'Did you mean "onboard"?' in answer.err


def test_a_linux_host_on_another_machine_needs_ssh(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    robot.edit("provider: simulated", "provider: linux\n    connect: { ssh: robot@cell }")
    monkeypatch.setenv("PATH", str(robot.folder))

    answer = robot.run("plan")
    assert answer.code == 1
    assert "ssh cannot be started" in answer.err


@pytest.mark.needs("posix")
def test_what_ssh_says_cannot_command_the_terminal(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    robot.edit("provider: simulated", "provider: linux\n    connect: { ssh: robot@cell }")
    ssh = robot.folder / "ssh"
    ssh.write_text("#!/bin/sh\nprintf 'no \\033[2J route' >&2\nexit 255\n", encoding="ascii")
    ssh.chmod(0o755)
    monkeypatch.setenv("PATH", str(robot.folder))

    answer = robot.run("plan")

    assert "ssh does not reach robot@cell: no" in " ".join(answer.err.split())
    assert "\x1b" not in answer.err


def test_every_json_answer_is_as_the_schema_says(robot: Robot) -> None:
    plan = robot.planned()
    answers = [
        robot.run("plan", "--json"),
        rarms("show", plan, "--json"),
        rarms("apply", plan, "--json"),
        robot.run("drift", "--json"),
        robot.run("graph", "--json"),
        robot.run("undo", "--auto-approve", "--json"),
        robot.run("validate", "--json"),
    ]

    documents = [answer.out.splitlines() if answer.out.startswith('{"') else [answer.out] for answer in answers]
    for document in (each for several in documents for each in several):
        check(document)
    assert [json.loads(several[-1])["kind"] for several in documents] == [
        "plan",
        "plan",
        "run",
        "drift",
        "graph",
        "run",
        "findings",
    ]
