"""The collection rarms.fleet under a real ansible-core: simulated robots, broken ones, the brake, and real slices."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.model.version import __version__
from tests.contracts.benches import forget_host, slice_of
from tests.contracts.test_measuring_contract import JOBS
from tests.needs import CHECKOUT
from tests.remote import WINRM_PASSWORD, a_remote, a_server, by_winrm
from tests.robot_install import on_robot, robot_rarms
from tests.system.test_remote_host import an_empty_host
from tests.unit.cli.running import rarms

__all__ = ["robot_rarms"]

pytestmark = [pytest.mark.needs("ansible", "posix")]

MANIFEST = """\
schema: rarms/v1
application: { name: robot }
policy: { interference: busy-loop }
hosts:
  onboard: { provider: simulated, logical_processors: 2, memory: 4 GiB, platform: cell }
components:
  vision:
    criticality: 20
    memory: 1 GiB
    processors: 1
    cpu: { reserve: 0.5 LP }
    apt: { mean_response_time: { at_most: 60 ms } }
    interference: busy-loop
    run: { command: [vision], until: { samples: 20 } }
    simulation: { work: 10 ms, blocked: 20 ms }
"""
LINUX = """\
schema: rarms/v1
application: { name: robot }
policy: { interference: busy-loop }
hosts:
  onboard: { provider: linux, logical_processors: 2, memory: 4 GiB, connect: { ssh: cell } }
components:
  vision: { criticality: 20, memory: 64 MiB, processors: 1, cpu: { reserve: 0.2 LP } }
"""
REFUSES = "hosts: { onboard: { simulated: { faults: { cpu: { operation: set_cpu, at: '*', effect: refuse } } } } }\n"
OUT_OF_REACH = "hosts: { onboard: { provider: linux, connect: { ssh: rarms@127.0.0.1 } } }\n"
"""An overlay whose robot answers at no port."""
Task = Mapping[str, Any]
APPLY: Task = {"rarms.fleet.apply": {}}
ANSIBLE = Path(sys.executable).parent


@dataclass(frozen=True, slots=True, kw_only=True)
class Played:
    """How a playbook ended, with the last result of each robot."""

    code: int
    results: Mapping[str, Mapping[str, Any]]
    statuses: Mapping[str, str]
    out: str

    def with_status(self, status: str) -> list[str]:
        """The robots whose last task ended so."""
        return sorted(name for name, found in self.statuses.items() if found == status)

    @property
    def changed(self) -> list[str]:
        """The robots whose last task changed something."""
        return sorted(name for name, result in self.results.items() if result.get("changed"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Fleet:
    """A folder with a manifest, overlays and an inventory."""

    folder: Path
    path: str = os.environ["PATH"]
    packages: str = str(CHECKOUT)
    wrap: Callable[[list[str]], list[str]] = list  # makes of the words of a program those that start it elsewhere

    def add(self, robot: str, overlay: str = "{}\n") -> None:
        """Add a robot with the text of its overlay."""
        (self.folder / "robots").mkdir(exist_ok=True)
        (self.folder / "robots" / f"{robot}.yaml").write_text(overlay, encoding="utf-8")

    def play(self, *tasks: Task, options: tuple[str, ...] = (), **play: object) -> Played:
        """Play these tasks on all robots with ansible-playbook."""
        book = [{"hosts": "all", "gather_facts": False, **play, "tasks": list(tasks)}]
        (self.folder / "site.yml").write_text(json.dumps(book), encoding="utf-8")
        return self.play_site(options)

    def play_site(self, options: tuple[str, ...]) -> Played:
        """Play the playbook of the folder."""
        results = self.folder / "results.jsonl"
        results.unlink(missing_ok=True)
        words = [str(ANSIBLE / "ansible-playbook"), "-i", "robots.fleet.yml", "site.yml", "-f", "4", *options]
        ran = self.run(words, results)
        rows = [json.loads(line) for line in results.read_text().splitlines()] if results.exists() else []
        return Played(
            code=ran.returncode,
            results={row["robot"]: row["result"] for row in rows},
            statuses={row["robot"]: row["status"] for row in rows},
            out=ran.stdout.decode() + ran.stderr.decode(),
        )

    def run(self, words: list[str], results: Path) -> subprocess.CompletedProcess[bytes]:
        """Run a program of Ansible with this checkout's collection and no configuration of this user's own."""
        environment = {
            **os.environ,
            "PATH": f"{ANSIBLE}{os.pathsep}{self.path}",
            "ANSIBLE_COLLECTIONS_PATH": str(CHECKOUT / "ansible"),
            "ANSIBLE_HOME": str(self.folder / ".ansible"),
            "ANSIBLE_CONFIG": str(self.folder / "ansible.cfg"),
            "ANSIBLE_NOCOLOR": "1",
            "ANSIBLE_CALLBACKS_ENABLED": "results",
            "ANSIBLE_CALLBACK_PLUGINS": str(CHECKOUT / "tests" / "ansible_callback"),
            "RARMS_TEST_RESULTS": str(results),
            "PYTHONPATH": self.packages,
            "LC_ALL": "C.UTF-8",
        }
        return subprocess.run(
            self.wrap(words),
            cwd=self.folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=600,
        )


def a_fleet(folder: Path, manifest: str, path: str = os.environ["PATH"], packages: str = str(CHECKOUT)) -> Fleet:
    """A fleet without robots; programs and Python packages are looked for in `path` and `packages`."""
    (folder / "rarms.yaml").write_text(manifest, encoding="utf-8")
    (folder / "ansible.cfg").touch()
    (folder / "robots.fleet.yml").write_text(
        "plugin: rarms.fleet.manifests\noverlays: [robots/*.yaml]\n", encoding="utf-8"
    )
    return Fleet(folder=folder, path=path, packages=packages)


@pytest.fixture
def fleet(tmp_path: Path) -> Fleet:
    return a_fleet(tmp_path, MANIFEST)


def test_twenty_robots_apply_and_broken_ones_fail_alone(fleet: Fleet) -> None:
    whole = [f"r-{number:02}" for number in range(16)]
    for robot in whole:
        fleet.add(robot)
    fleet.add("w-key", "componets: {}\n")
    fleet.add("w-full", "components: { vision: { cpu: { reserve: 3 LP } } }\n")
    fleet.add("w-damaged")
    fleet.add("w-fault", REFUSES)
    assert fleet.play(APPLY, options=("--limit", "w-damaged")).code == 0
    (state,) = (fleet.folder / ".rarms" / "hosts").glob("w-damaged+*/onboard.json")
    state.write_text("{", encoding="utf-8")

    checked = fleet.play(APPLY, options=("--check", "--diff"))
    assert checked.with_status("failed") == ["w-damaged", "w-full", "w-key"]
    assert checked.changed == [*whole, "w-fault"]
    assert [entry["before_header"] for entry in checked.results["r-00"]["diff"]] == ["r-00 partition/vision"]
    assert "reserve: 0.5 LP\n" in checked.results["r-00"]["diff"][0]["after"]

    applied = fleet.play(APPLY)
    assert applied.with_status("failed") == ["w-damaged", "w-fault", "w-full", "w-key"]
    assert applied.changed == [*whole, "w-fault"], "it made the partition, and says so"
    planned = {name: checked.results[name]["plan"]["id"] for name in whole}
    assert {name: applied.results[name]["plan"]["id"] for name in whole} == planned, "check is what apply does"
    assert "w-full" not in planned
    assert "RARMS060" in applied.results["w-full"]["msg"]

    again = fleet.play(APPLY, options=("--limit", "r-*"))
    assert (again.code, again.with_status("ok"), again.changed) == (0, whole, [])


def test_bad_name_or_overlay_fails_its_own_robot(fleet: Fleet) -> None:
    (fleet.folder / "robots.fleet.yml").write_text(
        "plugin: rarms.fleet.manifests\noverlays: [robots/*.yaml, more/*.yaml]\n"
        "keyed_groups: [{ key: rarms_platform, prefix: line }]\n",
        encoding="utf-8",
    )
    of_groups = ["all", "line_cell", "rarms_invalid", "rarms_platform_cell", "ungrouped"]
    for robot in (*of_groups, "r-1", "r-2", "r-3"):
        fleet.add(robot)
    fleet.add("two", "hosts: { other: { logical_processors: 2, memory: 4 GiB } }\n")
    fleet.add("two-other")
    (fleet.folder / "more").mkdir()
    (fleet.folder / "more" / "r-2.yaml").write_text("{}\n", encoding="utf-8")
    (fleet.folder / "robots" / "folder.yaml").mkdir()
    (fleet.folder / "robots" / "link.yaml").symlink_to("nothing")
    fleet.add("bytes", "\N{LATIN SMALL LETTER E WITH ACUTE}: [\n")

    checked = fleet.play(APPLY, options=("--check",))

    assert checked.changed == ["r-1", "r-3", "two-onboard"], checked.out
    assert checked.with_status("failed") == sorted(
        [
            *(f"robots/{name}.yaml" for name in of_groups),
            *("more/r-2.yaml", "robots/r-2.yaml", "robots/two-other.yaml", "robots/two.yaml/other"),
            *("bytes", "folder", "link"),
        ]
    )
    assert "all is the name of a group" in checked.results["robots/all.yaml"]["msg"]
    assert "Give robots/r-2.yaml another name" in checked.results["robots/r-2.yaml"]["msg"]


def test_reviewed_plan_is_applied_once(fleet: Fleet) -> None:
    fleet.add("r-1")
    plan: Task = {"rarms.fleet.apply": {"state": "planned", "plan": "plans/{{ inventory_hostname }}.json"}}
    reviewed: Task = {"rarms.fleet.apply": {"plan": "plans/{{ inventory_hostname }}.json"}}
    file = fleet.folder / "plans" / "r-1.json"

    assert fleet.play(plan).changed == []
    assert fleet.play(reviewed).changed == ["r-1"]
    used = fleet.play(reviewed).results["r-1"]["msg"]
    assert "RARMS182" in used, "a plan is used once"
    assert "use `state: planned`" in used

    fleet.add("r-1", "components: { vision: { cpu: { reserve: 3 LP } } }\n")
    assert fleet.play(plan).with_status("failed") == ["r-1"]
    assert not file.exists()


def test_run_that_did_not_end_is_finished_first(fleet: Fleet) -> None:
    fleet.add("r-1", REFUSES)
    assert fleet.play(APPLY).with_status("failed") == ["r-1"]
    fleet.add("r-1")

    finished = fleet.play(APPLY)

    assert (finished.code, finished.changed) == (0, ["r-1"]), finished.out
    assert fleet.play(APPLY).changed == []


def test_plan_of_another_robot_is_refused(fleet: Fleet) -> None:
    fleet.add("r-1")
    fleet.add("r-2")
    plan: Task = {"rarms.fleet.apply": {"state": "planned", "plan": "plan.json"}}
    assert fleet.play(plan, options=("--limit", "r-1")).code == 0

    refused = fleet.play({"rarms.fleet.apply": {"plan": "plan.json"}}, options=("--limit", "r-2"))
    assert "is a plan of robot on onboard of r-1, not of this robot" in refused.results["r-2"]["msg"]

    fleet.add("r-1", "components: { vision: { cpu: { reserve: 3 LP } } }\n")
    assert fleet.play(plan, options=("--limit", "r-1", "--check")).with_status("failed") == ["r-1"]
    assert (fleet.folder / "plan.json").exists()
    other: Task = {"rarms.fleet.apply": {"state": "planned", "plan": "rarms.yaml", "lock_timeout": "soon"}}
    assert fleet.play(other, options=("--limit", "r-2")).with_status("failed") == ["r-2"]
    assert (fleet.folder / "rarms.yaml").exists()


@pytest.mark.sample
def test_what_was_applied_in_terminal_is_absent_afterwards(fleet: Fleet) -> None:
    fleet.add("r-1")
    overlay = str(fleet.folder / "robots" / "r-1.yaml")
    assert rarms("apply", "--auto-approve", "-f", str(fleet.folder), "--overlay", overlay).code == 0

    absent: Task = {"rarms.fleet.apply": {"state": "absent"}}
    assert fleet.play(absent).changed == ["r-1"]
    assert fleet.play(absent).changed == []
    facts = fleet.play({"rarms.fleet.facts": {}}).results["r-1"]["ansible_facts"]["rarms"]
    assert facts["status"]["hosts"][0]["partitions"] == []
    assert json.loads(facts["snapshot"])["state"]["partitions"] == []


def test_brake_counts_robot_that_is_out_of_reach(fleet: Fleet) -> None:
    for number in range(20):
        fleet.add(f"r-{number:02}")
    for robot in ("r-03", "r-04"):
        fleet.add(robot, REFUSES)
    fleet.add("r-05", OUT_OF_REACH)
    ssh = ("--ssh-common-args", "-o BatchMode=yes -o StrictHostKeyChecking=no -p 1")

    played = fleet.play(APPLY, options=ssh, serial=10, max_fail_percentage=20)

    assert played.with_status("failed") == ["r-03", "r-04", "r-05"]
    assert played.results["r-05"]["rarms_unreachable"] is True
    assert sorted(played.results) == [f"r-{number:02}" for number in range(10)], played.out


def test_a_robot_measures_and_proves(fleet: Fleet) -> None:
    fleet.add("r-1", "components: { vision: { cpu: { reserve: measured } } }\n")
    fleet.add("r-2", "components: { vision: { cpu: { reserve: measured } } }\n")
    role: Task = {"ansible.builtin.import_role": {"name": "rarms.fleet.measure"}}

    assert "play the role rarms.fleet.measure" in fleet.play(APPLY).results["r-1"]["msg"]
    measured = fleet.play(role)
    assert measured.code == 0, measured.out
    assert measured.changed == ["r-1"], "one robot of the platform"
    assert list((fleet.folder / "measurements" / "cell").rglob("*.jsonl"))

    assert fleet.play(APPLY, options=("--limit", "r-1")).changed == ["r-1"]
    shutil.rmtree(fleet.folder / "measurements")
    assert fleet.play(role).changed == ["r-2"], "the first that is idle"
    shutil.rmtree(fleet.folder / "measurements")
    busy = fleet.play(role, options=("--limit", "r-1"))
    assert "RARMS115" in busy.results["r-1"]["msg"]
    assert "rarms_measure_stop_partitions: true" in busy.results["r-1"]["msg"]
    assert fleet.play(role, options=("--limit", "r-1", "-e", "rarms_measure_stop_partitions=true")).changed == ["r-1"]

    refused = fleet.play(APPLY, {"rarms.fleet.prove": {}})
    assert "load_host: true" in refused.results["r-1"]["msg"]
    proven = fleet.play({"rarms.fleet.prove": {"load_host": True}})
    assert (proven.code, proven.results["r-2"]["proof"]["met"]) == (0, True)


def test_an_answer_without_end_fails_its_own_robot(tmp_path: Path) -> None:
    fleet = a_fleet(tmp_path, LINUX)
    fleet.add("r-1")
    fleet.add("r-2", "hosts: { onboard: { provider: simulated } }\n")
    ssh = tmp_path / "ssh"
    ssh.write_text('#!/bin/sh\ncase "$*" in *rarms*) exec yes ;; esac\n', encoding="utf-8")
    ssh.chmod(0o755)

    played = fleet.play(APPLY, vars={"ansible_ssh_executable": str(ssh)})

    assert "answered with more than 67,108,864 characters" in played.results["r-1"]["msg"]
    assert played.changed == ["r-2"]


def test_the_shipped_sample_runs_whole(tmp_path: Path) -> None:
    shutil.copytree(CHECKOUT / "manifests" / "fleet", tmp_path / "fleet")
    (tmp_path / "fleet" / "ansible.cfg").touch()
    fleet = Fleet(folder=tmp_path / "fleet")

    summaries = []
    for state in ("measured", "applied", "proven"):
        played = fleet.play_site(("-e", f"state={state}"))
        assert (played.code, played.with_status("failed")) == (0, []), played.out
        summaries.append([played.results[robot]["msg"] for robot in ("robot-1", "robot-7")])

    applied = [
        "robot-1: 2 partitions, 1.3 LP reserved, 0.3 LP free",
        "robot-7: 4 partitions, 3.0 LP reserved, 0.6 LP free",
    ]
    assert list((fleet.folder / "measurements").glob("*/*/busy-loop.jsonl")), "its components were measured"
    assert summaries[1] == [f"{line}; not proven" for line in applied]
    assert summaries[2] == [f"{applied[0]}; 2 of 2 thresholds proven", f"{applied[1]}; 4 of 4 thresholds proven"]


def test_foreign_plan_is_refused_before_ending_a_run(fleet: Fleet) -> None:
    plan: Task = {"rarms.fleet.apply": {"state": "planned", "plan": "plans/{{ inventory_hostname }}.json"}}
    fleet.add("r-1")
    fleet.add("r-2")
    assert fleet.play(plan).code == 0
    shutil.copy(fleet.folder / "plans" / "r-2.json", fleet.folder / "plans" / "r-1.json")
    fleet.add("r-1", REFUSES)
    only = ("--limit", "r-1")
    assert fleet.play(APPLY, options=only).with_status("failed") == ["r-1"]
    fleet.add("r-1")
    (state,) = (fleet.folder / ".rarms" / "hosts").glob("r-1+*/onboard.json")
    before = state.read_bytes()

    checked = fleet.play(APPLY, options=(*only, "--check"))
    assert (checked.code, checked.changed) == (0, ["r-1"])
    refused = fleet.play({"rarms.fleet.apply": {"plan": "plans/{{ inventory_hostname }}.json"}}, options=only)

    assert "is a plan of robot on onboard of r-2" in refused.results["r-1"]["msg"]
    assert (refused.results["r-1"]["changed"], state.read_bytes()) == (False, before)


def test_unreachable_robot_fails_and_is_not_chosen(fleet: Fleet) -> None:
    measured = "components: { vision: { cpu: { reserve: measured } } }\n"
    fleet.add("r-1", OUT_OF_REACH.replace("127.0.0.1", "127.0.0.1, folder: /x") + measured)
    fleet.add("r-2", measured)
    ssh = ("--ssh-common-args", "-o BatchMode=yes -o StrictHostKeyChecking=no -p 1")

    for module in ("measure", "prove"):
        task: Task = {f"rarms.fleet.{module}": {"load_host": True} if module == "prove" else {}}
        played = fleet.play(task, options=(*ssh, "--limit", "r-1"))
        assert played.with_status("failed") == ["r-1"], played.out
        assert played.results["r-1"]["rarms_unreachable"] is True

    role: Task = {"ansible.builtin.import_role": {"name": "rarms.fleet.measure"}}
    assert fleet.play(role, options=ssh).changed == ["r-2"]
    named = ("-e", '{"rarms_measure_robots": {"cell": "r-9"}}')
    wrong = fleet.play(role, options=(*ssh, *named))
    assert wrong.with_status("failed") == ["r-1", "r-2"]
    assert "In this play, that platform has: r-1, r-2." in wrong.results["r-2"]["msg"]


@pytest.fixture
def slices(robot_rarms: Path, tmp_path: Path) -> Iterator[Fleet]:
    """Three robots that are slices of this machine, behind a real sshd."""
    with a_server(tmp_path, partial(on_robot, robot_rarms)) as remote:
        fleet = a_fleet(tmp_path, LINUX, remote.environment["PATH"])
        for number in (1, 2, 3):
            slice_name = slice_of(tmp_path / str(number))
            fleet.add(f"l-{number}", f"hosts: {{ onboard: {{ linux: {{ slice: {slice_name} }} }} }}\n")
        yield fleet
        fleet.play({"rarms.fleet.apply": {"state": "absent"}})
        for number in (1, 2, 3):
            forget_host(tmp_path / str(number))


@pytest.mark.alone
@pytest.mark.needs("ssh", "control-groups", "mounts")
def test_three_slices_are_reached_by_ansibles_own_ssh(slices: Fleet) -> None:
    applied = slices.play(APPLY)
    assert applied.code == 0, applied.out
    assert applied.changed == ["l-1", "l-2", "l-3"]

    assert slices.play(APPLY).changed == []
    facts = slices.play({"rarms.fleet.facts": {}}).results["l-2"]["ansible_facts"]["rarms"]["status"]
    assert [partition["name"] for partition in facts["hosts"][0]["partitions"]] == ["vision"]
    assert slices.play({"rarms.fleet.apply": {"state": "absent"}}).changed == ["l-1", "l-2", "l-3"]


INSTALLED_ELSEWHERE = """\
from rarms_iac.app import install
from rarms_iac.app.install_there import RobotPlaces
from rarms_iac.model.version import __version__
from tests.robot_wheels import wheels_of
names = ("versions", "state", "units", "systemd", "cron")
install.PLACES = RobotPlaces(**{{name: "{root}/" + name for name in names}})
install.wheels_for = lambda _python, _folder: wheels_of(__version__, install.PLACES.state, extra_bytes=40_000_000)
"""
"""What Ansible's process runs first: rarms is a small one with a large file, and lies elsewhere."""


@pytest.mark.needs("ssh", "root", "linux")
def test_role_installs_rarms_and_removes_it(tmp_path: Path) -> None:
    with tempfile.TemporaryDirectory(prefix="rarms-test-", dir="/opt") as root, a_server(tmp_path) as remote:
        (tmp_path / "first").mkdir()
        (tmp_path / "first" / "sitecustomize.py").write_text(INSTALLED_ELSEWHERE.format(root=root), encoding="utf-8")
        fleet = a_fleet(tmp_path, LINUX, remote.environment["PATH"], f"{tmp_path / 'first'}{os.pathsep}{CHECKOUT}")
        fleet.add("l-1")
        fleet.add("simulated", "hosts: { onboard: { provider: simulated, connect: null } }\n")
        role: Task = {"ansible.builtin.import_role": {"name": "rarms.fleet.install"}}
        current = Path(root, "versions", "current")

        expected = fleet.play(role, options=("--check",))
        assert (expected.code, expected.changed, current.exists()) == (0, ["l-1"], False), expected.out
        installed = fleet.play(role)
        assert (installed.code, installed.changed) == (0, ["l-1"]), installed.out
        assert installed.results["l-1"]["installed"]["sent_bytes"] > 40_000_000
        assert current.readlink() == Path(__version__)
        assert fleet.play(role).changed == []
        removed = fleet.play(role, options=("-e", "rarms_install_state=absent"))

        assert (removed.code, removed.changed) == (0, ["l-1"]), removed.out
        assert not current.parent.exists()


HYPERV = """\
schema: rarms/v1
application: { name: robot }
hosts:
  onboard: { provider: hyperv, connect: { ssh: cell, shell: pwsh }, logical_processors: 8, memory: 16 GiB }
components:
  vision:
    criticality: 50
    apt: { mean_response_time: { at_most: 100 ms } }
    memory: 1 GiB
    processors: 2
    cpu: { reserve: 0.4 LP }
"""


@pytest.mark.needs("ssh", "linux")
def test_hyperv_robot_changes_through_ansibles_connection(tmp_path: Path) -> None:
    """As far as a stand-in of PowerShell behind a real sshd goes."""
    with a_remote(tmp_path, an_empty_host()) as remote:
        (tmp_path / "fleet").mkdir()
        fleet = a_fleet(tmp_path / "fleet", HYPERV, remote.environment["PATH"])
        fleet.add("w-1")

        applied = fleet.play(APPLY)
        assert (applied.code, applied.changed) == (0, ["w-1"]), applied.out
        assert [(vm.name, vm.state) for vm in remote.host.vms.values()] == [("vision", "Running")]
        again = fleet.play(APPLY)
        assert (again.code, again.changed) == (0, []), again.out

        measured = fleet.play({"rarms.fleet.measure": {}})
        assert "one command at a time" in measured.results["w-1"]["msg"]
        assert fleet.play({"rarms.fleet.apply": {"state": "absent"}}).changed == ["w-1"]
        assert not remote.host.vms


BY_WINRM = "hosts: { onboard: { connect: { winrm: cell, shell: pwsh, user: ops, password: { from_env: NAME } } } }\n"


@pytest.mark.needs("linux")
def test_hyper_v_robot_is_changed_through_ansibles_psrp(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As far as stand-ins of pypsrp and PowerShell go."""
    remote = by_winrm(tmp_path, an_empty_host())
    monkeypatch.setenv("NAME", WINRM_PASSWORD)
    (tmp_path / "fleet").mkdir()
    manifest = HYPERV.replace(" connect: { ssh: cell, shell: pwsh },", "")
    fleet = a_fleet(tmp_path / "fleet", manifest, remote.variables["PATH"], remote.variables["PYTHONPATH"])
    fleet.add("w-1", BY_WINRM)

    applied = fleet.play(APPLY)
    assert (applied.code, applied.changed) == (0, ["w-1"]), applied.out
    assert [(vm.name, vm.state) for vm in remote.host.vms.values()] == [("vision", "Running")]
    assert fleet.play(APPLY).changed == []

    other = fleet.play(APPLY, options=("-e", "ansible_connection=winrm"))
    assert "Set `ansible_connection: psrp`" in other.results["w-1"]["msg"]
    monkeypatch.setenv("NAME", "another")
    refused = fleet.play(APPLY).results["w-1"]
    assert (refused["rarms_unreachable"], "another" in json.dumps(refused)) == (True, False), refused
    assert "Failed to authenticate the user" in refused["msg"]


def test_robot_behind_winrm_has_no_password_in_file(fleet: Fleet) -> None:
    fleet.add("w-1", "hosts: { onboard: { provider: hyperv } }\n")
    fleet.add("w-2", BY_WINRM.replace("onboard: {", "onboard: { provider: hyperv,"))
    words = [str(ANSIBLE / "ansible-inventory"), "-i", "robots.fleet.yml", "--host", "w-2"]

    listed = json.loads(fleet.run(words, fleet.folder / "none").stdout)

    assert (listed["ansible_connection"], listed["ansible_psrp_protocol"]) == ("psrp", "https")
    assert (listed["ansible_host"], listed["ansible_port"]) == ("cell", 5986)
    assert "lookup('ansible.builtin.env', 'NAME')" in listed["ansible_password"]


MEASURED = """\
schema: rarms/v1
application: { name: robot }
policy: { interference: busy-loop, measuring: { setting: 4 s, proof: 15 s, precision: 20 % } }
hosts:
  onboard: { provider: linux, memory: 1 GiB, keep_for_host: { processor: 50 %, memory: 256 MiB }, platform: bench }
components:
  eyes:
    criticality: 20
    memory: 64 MiB
    processors: 1
    cpu: { reserve: measured }
    apt: { mean_response_time: { at_most: 50 ms } }
    interference: busy-loop
    run:
      command: [python3, jobs.py, '0.02', '0', '1']
      until: { elapsed: 1 s }
      samples: { from: json_lines, response_time: { field: ms, unit: ms } }
"""
"""Most of the processors is kept for the host: a load that never pauses takes the rest."""


@pytest.mark.alone
@pytest.mark.needs("ssh", "control-groups", "mounts")
def test_a_robot_behind_ssh_measures_and_proves_itself(robot_rarms: Path, tmp_path: Path) -> None:
    with a_server(tmp_path, partial(on_robot, robot_rarms)) as remote:
        (tmp_path / "fleet").mkdir()
        fleet = a_fleet(tmp_path / "fleet", MEASURED, remote.environment["PATH"])
        (fleet.folder / "jobs.py").write_text(JOBS, encoding="utf-8")
        processors = len(os.sched_getaffinity(0))
        connect = f"{{ ssh: cell, folder: {tmp_path}/robot }}"
        reached = f"logical_processors: {processors}, connect: {connect}, linux: {{ slice: {slice_of(tmp_path)} }}"
        fleet.add("m-1", f"hosts: {{ onboard: {{ {reached} }} }}\n")
        try:
            measured = fleet.play(
                {"ansible.builtin.import_role": {"name": "rarms.fleet.measure"}},
                vars={"ansible_python_interpreter": sys.executable},
            )
            assert measured.changed == ["m-1"], measured.out
            assert list((fleet.folder / "measurements" / "bench" / "eyes").glob("busy-loop.jsonl"))
            fixed = "components: { eyes: { cpu: { reserve: 0.2 LP } } }\n"  # four seconds may not show what is enough
            fleet.add("m-1", f"hosts: {{ onboard: {{ {reached} }} }}\n{fixed}")
            applied = fleet.play(APPLY)
            assert applied.changed == ["m-1"], applied.out
            proven = fleet.play({"rarms.fleet.prove": {"load_host": True}})
            assert proven.results["m-1"]["proof"]["kind"] == "prove", proven.out
            proofs = [path for path in (fleet.folder / "measurements").rglob("*") if '"robot":"m-1"' in _text(path)]
            assert proofs, "the proof came back, and names the robot"
        finally:
            fleet.play({"rarms.fleet.apply": {"state": "absent"}})
            forget_host(tmp_path)


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8").replace('": "', '":"') if path.is_file() else ""


def pulled(fleet: Fleet, checkout: Path) -> Mapping[str, Any]:
    """Commit the fleet's folder, and have the robot r-1 pull it; return its result of rarms.fleet.apply."""
    book = [{"hosts": "r-1", "gather_facts": False, "tasks": [APPLY]}]
    (fleet.folder / "local.yml").write_text(json.dumps(book), encoding="utf-8")
    (fleet.folder / ".gitignore").write_text("checkout/\n.ansible/\n.rarms/\n*.jsonl\n", encoding="utf-8")
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-C", str(fleet.folder)]
    for words in (["init", "-q"], ["add", "."], ["commit", "-qm", "A robot", "--allow-empty"]):
        subprocess.run([*git, *words], check=True)
    pull = [str(ANSIBLE / "ansible-pull"), "-U", f"file://{fleet.folder}", "-d", str(checkout)]
    results = fleet.folder / "pulled.jsonl"
    results.unlink(missing_ok=True)

    inventories = ["-i", "localhost,", "-i", str(checkout / "robots.fleet.yml")]
    python = ["-e", f"ansible_python_interpreter={sys.executable}"]
    ran = fleet.run([*pull, *inventories, *python, "-l", "r-1", "local.yml"], results)

    assert ran.returncode == 0, ran.stdout.decode()
    rows = [json.loads(line) for line in results.read_text().splitlines()]
    (result,) = (row["result"] for row in rows if row["robot"] == "r-1" and "has_changes" in row["result"])
    applied: Mapping[str, Any] = result
    return applied


def test_a_robot_pulls_its_own_configuration(fleet: Fleet, tmp_path: Path) -> None:
    fleet.add("r-1")

    assert pulled(fleet, tmp_path / "checkout")["changed"] is True
    assert pulled(fleet, tmp_path / "checkout")["changed"] is False


@pytest.mark.alone
@pytest.mark.needs("control-groups", "mounts")
def test_a_linux_robot_pulls_its_own_configuration(robot_rarms: Path, tmp_path: Path) -> None:
    fleet = a_fleet(tmp_path, LINUX.replace(", connect: { ssh: cell }", ""))
    fleet = replace(fleet, wrap=partial(on_robot, robot_rarms))
    fleet.add("r-1", f"hosts: {{ onboard: {{ linux: {{ slice: {slice_of(tmp_path)} }} }} }}\n")
    try:
        assert pulled(fleet, tmp_path / "checkout")["changed"] is True
        assert pulled(fleet, tmp_path / "checkout")["changed"] is False
    finally:
        fleet.play({"rarms.fleet.apply": {"state": "absent"}})
        forget_host(tmp_path)
