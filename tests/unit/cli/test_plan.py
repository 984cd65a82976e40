"""What a plan says of its choice of hosts: in its text, in its JSON and in its file."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.app.plan_files import read_plan_file
from rarms_iac.storage.shipped import shipped
from tests.files import copy_files
from tests.recorded_hosts import document, recorded_bytes
from tests.unit.cli.running import Ran, rarms
from tests.unit.views.test_json import check

HOST = """\
  {name}:
    provider: simulated
    logical_processors: 1
    memory: 1 GiB
"""
COMPONENT = """\
  {name}:
    criticality: 1
    run: {{ command: [python3, "{name}.py"], samples: {{ from: per_run }}, until: {{ samples: 20 }} }}
    memory: 64 MiB
    cpu: {{ reserve: {reserve} % }}
    processors: 1
"""
OPTIMAL = "The placement is optimal"


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    hosts = "".join(HOST.format(name=name) for name in ("one", "three", "two"))
    reserves = {"a": 60, "b": 50, "c": 40, "d": 30, "e": 20}
    components = "".join(COMPONENT.format(name=name, reserve=share) for name, share in reserves.items())
    text = f"schema: rarms/v1\n\napplication:\n  name: fleet\n\nhosts:\n{hosts}\ncomponents:\n{components}"
    (tmp_path / "rarms.yaml").write_text(text, encoding="utf-8", newline="\n")
    return tmp_path


def test_placement_is_in_json_and_plan_file(fleet: Path) -> None:
    answer = rarms("plan", "--json", "-f", str(fleet), "--out", str(fleet / "plan.json"))

    check(answer.out)
    placement = json.loads(answer.out)["placement"]
    read = read_plan_file(str(fleet / "plan.json")).placement
    assert read is not None
    assert placement == {
        "verdict": "optimal",
        "reserved_lp": read.reserved / 100,
        "reserved_bound_lp": 2.0,
        "moves": 0,
        "moves_bound": 0,
    }


def test_plan_recommends_apply_with_its_options(fleet: Path) -> None:
    chosen = ["--host", "one", "--target", "partition/a", "--max-disruption", "removal"]

    planned = rarms("plan", "-f", str(fleet), *chosen)
    program = rarms("plan", "-f", str(fleet), "--json")

    assert f"Next: `rarms apply {' '.join(chosen)} -f " in " ".join(planned.err.split()), planned
    assert "Next: " not in program.err
    assert rarms("apply", "-f", str(fleet), *chosen, "--auto-approve").code == 0
    assert "Next: " not in rarms("plan", "-f", str(fleet), *chosen).err, "nothing is left to apply"


def test_plan_show_and_explain_say_optimal(fleet: Path) -> None:
    planned = rarms("plan", "-v", "-f", str(fleet), "--out", str(fleet / "plan.json"))
    shown = rarms("show", "-v", str(fleet / "plan.json"))
    explained = rarms("explain", "a", "-f", str(fleet))

    for answer in (planned, shown, explained):
        assert OPTIMAL in " ".join(answer.out.split()), answer.err


CELL = shipped("manifests/hyperv-cell")


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    """The example with its recorded host, to change."""
    return copy_files(CELL, tmp_path / "cell")


def plan(cell: Path, *words: str) -> Ran:
    return rarms("plan", "-f", str(cell), *words)


def bent(cell: Path, **probes: Any) -> str:
    """The recorded host with other values, as a file."""
    answer = json.loads((cell / "host.json").read_bytes())
    for name, value in probes.items():
        answer[name] = value if name == "computer" else {"status": "value", "value": value}
    (cell / "bent.json").write_bytes(json.dumps(answer).encode())
    return str(cell / "bent.json")


def test_the_example_is_planned_from_its_recorded_host(cell: Path) -> None:
    ran = plan(cell, "--snapshot", f"cell={cell / 'host.json'}", "--out", str(cell / "plan"))

    assert ran.code == 0
    assert "+ torch-motion" in ran.out
    assert "31 GiB of its 31.9 GiB)" in " ".join(ran.out.split())
    assert "state file" not in rarms("show", str(cell / "plan")).out, "only a simulated host has one"
    (part,) = read_plan_file(str(cell / "plan")).hosts
    assert sorted(part.scripts) == [
        "cell.guest.seam-tracking.ps1",
        "cell.guest.seam-tracking.undo.ps1",
        "cell.guest.torch-motion.ps1",
        "cell.guest.torch-motion.undo.ps1",
        "cell.ps1",
        "cell.undo.ps1",
    ]
    assert not any(step.address.task for step in part.steps), "what lies in a guest is not a step of the host"
    assert "RARMS160" in ran.out


def test_same_snapshot_gives_same_plan_to_byte(cell: Path) -> None:
    for out in ("one", "two"):
        assert plan(cell, "--snapshot", f"cell={cell / 'host.json'}", "--out", str(cell / out)).code == 0

    assert (cell / "one").read_bytes() == (cell / "two").read_bytes()


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig"])
def test_a_file_that_windows_powershell_redirected_is_read(cell: Path, encoding: str) -> None:
    text = (cell / "host.json").read_text(encoding="utf-8")
    (cell / "host.json").write_bytes((text.strip() + "\r\n").encode(encoding))

    assert plan(cell, "--snapshot", str(cell / "host.json")).code == 0


def test_planted_journal_is_refused(cell: Path) -> None:
    journal = document("server-2022-with-strangers")["journal"]["value"]
    planted = plan(cell, "--snapshot", f"cell={bent(cell, journal=journal | {'owner': 'S-1-5-21-7-7-7-1001'})}")
    lines = journal["text"].splitlines(keepends=True)
    begun = plan(cell, "--snapshot", f"cell={bent(cell, journal=journal | {'text': ''.join(lines[:-1])})}")

    assert (planted.code, "error[RARMS190]" in planted.err) == (4, True)
    assert (begun.code, "error[RARMS183]" in begun.err) == (3, True)
    assert "0123456789ab" in begun.err


def test_unreadable_machine_is_named(cell: Path) -> None:
    lost = {"id": "0" * 36, "name": "database", "error": "InvalidState,GetVMMemory", "message": "Its storage is gone."}
    snapshot = f"cell={bent(cell, unread_machines=[lost])}"

    ran, examined = plan(cell, "--snapshot", snapshot), rarms("doctor", "-f", str(cell), "--snapshot", snapshot)

    assert (ran.code, "error[RARMS189]" in ran.err) == (1, True)
    for text in (ran.err, examined.out + examined.err):
        assert 'machine "database"' in " ".join(text.split())
        assert "Its storage is gone." in " ".join(text.split())


def test_smaller_host_is_named(cell: Path) -> None:
    manifest = cell / "rarms.yaml"
    text = re.sub(r"(?m)^    memory: \d+ GiB", "    memory: 4096 GiB", manifest.read_text(encoding="utf-8"), count=1)
    manifest.write_text(text, encoding="utf-8")

    for command in ("plan", "doctor"):
        ran = rarms(command, "-f", str(cell), "--snapshot", f"cell={cell / 'host.json'}")
        assert "warning[RARMS126]" in ran.out + ran.err


def test_a_guest_whose_records_were_denied_is_refused(cell: Path) -> None:
    answer = document("inside-a-guest")
    answer["records"] = {"status": "denied", "error": "PermissionDenied", "message": "Access is denied."}
    (cell / "inside.json").write_bytes(json.dumps(answer).encode())
    inside = f"cell.guest.torch-motion={cell / 'inside.json'}"

    ran = plan(cell, "--snapshot", f"cell={with_torch(cell)}", "--snapshot", inside)

    assert (ran.code, "error[RARMS001]" in ran.err) == (1, True)
    assert "its records" in ran.err


def test_a_damaged_observation_is_told_with_its_place(cell: Path) -> None:
    ran = plan(cell, "--snapshot", f"cell={bent(cell, elevated='yes')}")

    assert (ran.code, "error[RARMS001]" in ran.err) == (1, True)
    assert "elevated.value" in ran.err


def with_torch(cell: Path) -> str:
    """The host on which torch-motion is there already."""
    machines = document("server-2022-with-strangers")["machines"]["value"]
    torch = machines[3] | {
        "id": "7777aaaa-4e5f-4a6b-8c7d-9e0f1a2b3c44",
        "name": "torch-motion",
        "notes": "rarms/1 welding-cell/torch-motion vm=7777aaaa set=0123456789ab",
    }
    return bent(cell, machines=[*machines[:3], torch])


def test_a_guest_that_was_looked_into_takes_part(cell: Path) -> None:
    (cell / "guest.json").write_bytes(recorded_bytes("inside-a-guest"))
    looked = ("--snapshot", f"cell.guest.torch-motion={cell / 'guest.json'}")

    ran = plan(cell, "--snapshot", f"cell={with_torch(cell)}", *looked, "--out", str(cell / "plan"))

    assert ran.code == 0
    assert "+ torch-motion/task/MotionControl" in ran.out
    (part,) = read_plan_file(str(cell / "plan")).hosts
    assert "Get-TaskClassReading" in part.scripts["cell.guest.torch-motion.ps1"].partition("# --- runtime")[0]
    assert "Get-GuestTaskClassReading" in part.scripts["cell.guest.seam-tracking.ps1"].partition("# --- runtime")[0]
    assert not any("torch-motion/task" in name for name in part.digests), "the host's script does not see it"


@pytest.mark.parametrize(
    ("file", "message"),
    [
        ("server-2022-with-strangers", "was taken on CELL-4, the host itself"),
        ("inside-a-guest", "does not have the partition operator-panel of welding-cell"),
    ],
)
def test_file_of_no_guest_is_refused(cell: Path, file: str, message: str) -> None:
    guest = "torch-motion" if file != "inside-a-guest" else "operator-panel"
    (cell / "guest.json").write_bytes(recorded_bytes(file))

    ran = plan(
        cell, "--snapshot", f"cell={with_torch(cell)}", "--snapshot", f"cell.guest.{guest}={cell / 'guest.json'}"
    )

    assert (ran.code, message in " ".join(ran.err.split())) == (1, True)


def test_rarms_own_snapshot_says_nothing_of_a_guest(cell: Path) -> None:
    (cell / "guest.json").write_bytes(b'{"format_version": "rarms-snapshot/1"}')

    ran = plan(
        cell, "--snapshot", f"cell={cell / 'host.json'}", "--snapshot", f"cell.guest.torch-motion={cell / 'guest.json'}"
    )

    assert (ran.code, "a guest needs the output of observe.ps1" in " ".join(ran.err.split())) == (1, True)


def test_observing_script_needs_no_manifest(tmp_path: Path) -> None:
    ran = rarms("snapshot", "--script", "--out", str(tmp_path))

    written = (tmp_path / "observe.ps1").read_bytes()
    assert ran.code == 0
    assert "-File observe.ps1 > host.json" in ran.err
    assert written.startswith(b"#Requires -Version 5.1\r\n")
    assert rarms("snapshot", "--script").out == written.decode("ascii")
