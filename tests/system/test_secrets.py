"""Values of variables that a manifest only refers to are nowhere but in the environment of the component itself."""

import os
import re
import sys
from pathlib import Path

import pytest

from rarms_iac.views.finding_forms import OutputFormat
from tests.fluid import without_scheduler
from tests.recorded_hosts import recorded_bytes
from tests.robots import CELL
from tests.unit.cli.running import rarms

SECRET = "pl4nted-5ecret"
PROGRAM = f"""\
import json, os, sys
from pathlib import Path
assert os.environ["TOKEN"] == os.environ["VISION_TOKEN"] == {SECRET!r}
lines = [file.read_bytes() for file in Path("/proc").glob("[0-9]*/cmdline") if os.access(file, os.R_OK)]
Path("seen").write_text(str(sum({SECRET!r}.encode() in line for line in lines)))
print(json.dumps({{"ms": 10}}), flush=True)
"""
RUN = """\
    run:
      command: [python3, -c, "exec(open('seen.py').read())"]
      environment: { TOKEN: { from_env: VISION_TOKEN } }
      until: { samples: 60 }
      samples: { from: json_lines, response_time: { field: ms, unit: ms } }
"""
ROUTE = (
    ("validate",),
    ("measure", "--samples", "60"),
    ("tune", "--samples", "60"),
    ("plan", "--json", "--out", "plan.json"),
    ("show", "plan.json", "--json"),
    ("show", "plan.json"),
    ("apply", "plan.json", "--json"),
    ("prove", "--load-host", "--json"),
    ("status", "--json"),
    ("history", "--json"),
    ("snapshot", "--out", "snapshot.json"),
    ("report", "--out", "report.html"),
    ("export", "samples.csv", "--samples"),
    ("explain", "vision", "--json"),
    ("doctor", "--json"),
    ("run", "vision", "--samples", "1", "--json"),
)


IN_CLEAR = "Pl4nted!5ecret+x"


@pytest.mark.parametrize("form", list(OutputFormat))
def test_secret_in_manifest_is_found_unshown(tmp_path: Path, form: OutputFormat) -> None:
    partition = f"partitions: {{ vision: {{ guest: {{ credential: '{IN_CLEAR}' }} }} }}\n"
    variable = f"    run: {{ command: [vision], environment: {{ API_TOKEN: '{IN_CLEAR}' }} }}\n    simulation:"
    Path(tmp_path, "rarms.yaml").write_text(CELL.replace("    simulation:", variable, 1) + partition, "utf-8")

    answer = rarms("validate", str(tmp_path), "--output", form)

    assert {"RARMS090", "RARMS091"} <= set(re.findall(r"RARMS\d{3}", answer.out))
    assert IN_CLEAR not in answer.out + answer.err


GUEST = "partitions: { motion: { guest: { connect: { ssh: pl4nted@gu3st }, credential: cell/pl4nted } } }\n"
ON_HYPERV = f"""\
schema: rarms/v1
application: {{ name: cell }}
hosts: {{ onboard: {{ provider: hyperv, logical_processors: 8, memory: 16 GiB }} }}
components: {{ motion: {{ criticality: 3, memory: 1 GiB, cpu: {{ reserve: 20 % }} }} }}
{GUEST}"""


def test_credential_and_guests_target_stay_in_manifest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("rarms.yaml").write_text(ON_HYPERV, encoding="utf-8")
    Path("host.json").write_bytes(recorded_bytes("empty-host"))

    planned = rarms("plan", "--snapshot", "host.json", "--out", "cell.plan")
    answers = [
        planned,
        rarms("show", "cell.plan", "--json"),
        rarms("show", "cell.plan", "--script", "--out", "scripts"),
    ]

    assert [answer.code for answer in answers] == [0, 0, 0], planned.err
    assert not [answer for answer in answers if re.search("pl4nted|gu3st", answer.out + answer.err)]
    made = [file for file in tmp_path.rglob("*") if file.is_file() and file.name != "rarms.yaml"]
    assert len(made) >= 4
    assert not [file for file in made if re.search(b"pl4nted|gu3st", file.read_bytes())]


@pytest.mark.needs("linux")
def test_variable_reaches_only_its_component(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VISION_TOKEN", SECRET)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    before, after = CELL.split("    simulation:", 1)
    Path("rarms.yaml").write_text(f"{before}{RUN}    simulation:{after}", encoding="utf-8", newline="\n")
    Path("seen.py").write_text(PROGRAM, encoding="utf-8")

    with without_scheduler():
        answers = [rarms(*words) for words in ROUTE]
    Path("seen.py").unlink()

    assert {words[0]: answer.code for words, answer in zip(ROUTE, answers, strict=True) if answer.code} == {}
    assert not [answer for answer in answers if SECRET in answer.out + answer.err]
    files = [file for file in tmp_path.rglob("*") if file.is_file()]
    assert len(files) > 10
    assert not [file for file in files if SECRET.encode() in file.read_bytes()]
    assert Path("seen").read_text(encoding="utf-8") == "0", "no process has it among its words"
