"""A plan file holds what its plan is made of; reading makes the same plan again, or refuses."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.app.plan_files import plan_in
from rarms_iac.planner import problem
from rarms_iac.storage.codec import encode
from rarms_iac.storage.plan_file import write_plan
from tests.builders_plan import partition, settings
from tests.measuring import leave_logs
from tests.unit.cli.running import Ran, rarms

MANIFEST = """\
schema: rarms/v1
application: { name: fleet }
hosts:
  one: { platform: arm, logical_processors: 1, memory: 1 GiB }
  three: { platform: arm, logical_processors: 1, memory: 1 GiB }
  two: { platform: arm, logical_processors: 1, memory: 1 GiB }
components:
  a:
    criticality: 5
    memory: 64 MiB
    processors: 1
    apt: { mean_response_time: { at_most: 50 ms } }
    run: { command: [python3, a.py], environment: { A_TOKEN: "cl34r \\" text" } }
    simulation: { work: 10 ms }
    cpu: { reserve: measured }
  b: { criticality: 4, memory: 64 MiB, processors: 1, cpu: { reserve: 50 % } }
  c: { criticality: 3, memory: 64 MiB, processors: 1, cpu: { reserve: 40 % } }
  d: { criticality: 2, memory: 64 MiB, processors: 1, cpu: { reserve: 30 % } }
"""
Change = Callable[[dict[str, Any]], object]


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan of three hosts among which the solver chose, with a measured reservation."""
    folder = tmp_path_factory.mktemp("fleet")
    (folder / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    leave_logs(folder, {"a": 60})
    made = rarms("plan", "-f", str(folder), "--out", str(folder / "fleet.plan"), "--json", "--verbose")
    assert made.code == 0, made.err
    (folder / "made.json").write_text(made.out, encoding="utf-8")
    return folder


def changed(fleet: Path, tmp_path: Path, change: Change) -> Path:
    document = json.loads((fleet / "fleet.plan").read_bytes())
    change(document)
    path = tmp_path / "changed.plan"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def refusal(ran: Ran) -> str:
    assert ran.code == 3, ran
    return " ".join(ran.err.split())


def test_show_gives_whole_plan_as_it_was_made(fleet: Path) -> None:
    for words in (("--json",), ()):
        shown = rarms("show", str(fleet / "fleet.plan"), *words)
        planned = rarms("plan", "-f", str(fleet), *words)
        assert (shown.code, shown.out) == (0, planned.out)


def test_plan_file_is_written_again_as_it_was(fleet: Path) -> None:
    data = (fleet / "fleet.plan").read_bytes()

    assert write_plan(plan_in("fleet.plan", data)) == data


def test_reading_does_not_solve(fleet: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(problem, "pack", None)

    assert rarms("show", str(fleet / "fleet.plan")).code == 0


def test_a_measured_reservation_needs_no_data_log(fleet: Path, tmp_path: Path) -> None:
    elsewhere = changed(fleet, tmp_path, lambda _: None)

    assert json.loads(rarms("show", str(elsewhere), "--json").out) == json.loads((fleet / "made.json").read_text())


def test_another_highspy_reads_the_same_bytes(fleet: Path, tmp_path: Path) -> None:
    package = tmp_path / "highspy-99.9.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: highspy\nVersion: 99.9\n", encoding="utf-8")
    moved = changed(fleet, tmp_path, lambda document: document["inputs"]["layout"]["hosts"].update(a="two"))

    def shown(plan: Path) -> subprocess.CompletedProcess[bytes]:
        words = [sys.executable, "-m", "rarms_iac", "show", str(plan), "--json"]
        environment = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{Path.cwd()}"}
        return subprocess.run(words, env=environment, capture_output=True, check=False)

    same, other = shown(fleet / "fleet.plan"), shown(moved)

    assert (same.returncode, same.stdout) == (0, rarms("show", str(fleet / "fleet.plan"), "--json").out.encode())
    assert other.returncode == 3
    assert 'here: "99.9"' in " ".join(other.stderr.decode().split())


def a_remark(document: dict[str, Any]) -> None:
    document["inputs"]["texts"][0]["lines"][-1] += "# checked"


def a_stricter_threshold(document: dict[str, Any]) -> None:
    """The layout and the reservations stay, so that the plan does the same."""
    lines = document["inputs"]["texts"][0]["lines"]
    lines[:] = [line.replace("at_most: 50 ms", "at_most: 40 ms") for line in lines]


def a_full_host(document: dict[str, Any]) -> None:
    hosts = document["inputs"]["layout"]["hosts"]
    hosts.update(dict.fromkeys(hosts, "one"))


def swapped(document: dict[str, Any]) -> None:
    """A layout that fits as well, and that the solver did not choose."""
    hosts = document["inputs"]["layout"]["hosts"]
    other = {"one": "two", "two": "three", "three": "one"}
    hosts.update({name: other[host] for name, host in hosts.items()})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (a_full_host, "its layout does not fit its hosts"),
        (lambda document: document["inputs"]["layout"]["hosts"].pop("a"), "its layout does not fit its hosts"),
        (lambda document: document["inputs"]["layout"].update(reserved_bound=10**6), "its layout does not fit"),
        (lambda document: document["inputs"].update(layout=None), "its layout does not fit its hosts"),
        (swapped, "it was written for plan"),
        (a_remark, "it was written for plan"),
        (a_stricter_threshold, "it was written for plan"),
        (lambda document: document["inputs"].update(today="2020-01-01"), "it was written for plan"),
        (lambda document: document["inputs"].update(purpose="destroy"), "it was written for plan"),
        (lambda document: document["inputs"]["texts"][0]["lines"].pop(-2), "its layout does not fit"),
        (lambda document: document["inputs"]["texts"][0]["lines"].insert(0, ""), "it was written for plan"),
        (lambda document: document["inputs"]["texts"][0]["lines"].insert(0, "x"), "no plan can be made of it"),
        (lambda document: document["inputs"]["texts"].clear(), "no plan can be made of it"),
        (lambda document: document["inputs"]["observed"].update(four=document["inputs"]["observed"]["one"]), "no plan"),
        (lambda document: document["inputs"]["observed"]["one"]["serials"].update(fleet=3), "it was written for"),
        (
            lambda document: document["inputs"]["reservations"][0]["answer"].update(reservation="11/10"),
            "its layout does not",
        ),
        (lambda document: document.update(id="0" * 12), "it was written for plan"),
    ],
)
@pytest.mark.parametrize("command", ["show", "apply"])
def test_a_changed_input_is_refused(fleet: Path, tmp_path: Path, change: Change, message: str, command: str) -> None:
    said = refusal(rarms(command, str(changed(fleet, tmp_path, change))))

    assert "error[RARMS180]" in said
    assert message in said
    assert "it was edited" in said


def test_versions_that_differ_are_named(fleet: Path, tmp_path: Path) -> None:
    def other(document: dict[str, Any]) -> None:
        document["inputs"]["versions"].update(highspy="1.0", networkx="2.0")
        swapped(document)

    said = refusal(rarms("show", str(changed(fleet, tmp_path, other))))

    assert 'made with highspy "1.0"' in said
    assert 'networkx "2.0"' in said


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda document: document["inputs"]["versions"].update(rarms="0.0.9"), 'it was made by rarms "0.0.9"'),
        (lambda document: document.update(format_version="rarms-plan/2"), 'its format is "rarms-plan/2"'),
        (lambda document: document.update(certificate={}), "this field is unknown"),
    ],
)
def test_another_version_or_format_is_refused(fleet: Path, tmp_path: Path, change: Change, message: str) -> None:
    said = refusal(rarms("show", str(changed(fleet, tmp_path, change))))

    assert "error[RARMS188]" in said
    assert message in said
    assert "Make the plan again with this version of rarms" in said


def test_values_of_variables_stay_out_of_the_file(fleet: Path) -> None:
    lines = json.loads((fleet / "fleet.plan").read_bytes())["inputs"]["texts"][0]["lines"]

    assert [len(line) for line in lines] == [len(line) for line in MANIFEST.split("\n")]
    assert not [line for line in lines if "cl34r" in line or " text" in line]


def test_name_that_no_manifest_can_give_is_refused(fleet: Path, tmp_path: Path) -> None:
    machine = replace(partition(settings("old"), application="fleet"), id="1")
    assert machine.mark is not None
    machine = replace(machine, mark=replace(machine.mark, name="../../old"))
    observed = encode(machine)

    said = refusal(
        rarms(
            "show",
            str(
                changed(fleet, tmp_path, lambda file: file["inputs"]["observed"]["one"]["partitions"].append(observed))
            ),
            "--script",
        )
    )

    assert "error[RARMS180]" in said
    assert '"../../old" is not a valid name in a manifest' in said
