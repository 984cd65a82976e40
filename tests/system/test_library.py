"""docs/library.md: its lines run as they stand, in a folder with its manifest."""

import json
import re
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest

import rarms_iac
from tests.unit.cli.running import rarms

PAGE = (Path(__file__).parents[2] / "docs" / "library.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


def test_lines_of_page_run_one_after_another(tmp_path: Path) -> None:
    (manifest,) = blocks("yaml")
    (tmp_path / "rarms.yaml").write_text(manifest, encoding="utf-8")
    program = "".join(blocks("python")) + "print(rarms.plan(robot).has_changes)\n"

    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300
    )

    assert done.returncode == 0, done.stderr
    *measured, applied, proven, removed, outcome, missing, unknown, changes = done.stdout.splitlines()
    assert measured
    assert all(line.startswith("vision Sufficient(") for line in measured), "one a load"
    assert applied.endswith(" done")
    assert proven == "[]"
    assert removed == "onboard delete partition/vision"
    assert outcome.startswith("False [")
    assert missing == "A file cannot be read True ['RARMS001']"
    assert unknown.startswith('The manifest does not have the host "elsewhere".')
    assert changes == "False"


def test_paths_are_accepted_and_plan_names_changes(tmp_path: Path) -> None:
    (manifest,) = blocks("yaml")
    (tmp_path / "rarms.yaml").write_text(manifest.replace("reserve: measured", "reserve: 20 %"), encoding="utf-8")
    overlay = tmp_path / "small.yaml"
    overlay.write_text("components: { vision: { memory: 512 MiB } }\n", encoding="utf-8")

    plan = rarms_iac.plan(rarms_iac.load(tmp_path / "rarms.yaml", overlays=[overlay]))
    report = rarms_iac.apply(plan, folder=tmp_path)

    assert [type(change) for part in plan.hosts for change in part.changes] == [rarms_iac.Create]
    assert report.ending is rarms_iac.RunEnding.DONE


def test_text_of_error_begins_with_error(tmp_path: Path) -> None:
    (manifest,) = blocks("yaml")
    unused = "interference: { spare: { kind: busy_loop, threads: 2 } }\n"
    (tmp_path / "rarms.yaml").write_text(
        manifest.replace("criticality: 20", "criticality: 20\n    together: [nowhere]") + unused, encoding="utf-8"
    )

    with pytest.raises(rarms_iac.UseCaseError) as refused:
        rarms_iac.load(tmp_path)

    errors = [finding.summary for finding in refused.value.findings if finding.severity is rarms_iac.Severity.ERROR]
    assert str(refused.value) == errors[0]


def test_each_line_of_run_is_as_schema_says(tmp_path: Path) -> None:
    schema = jsonschema.Draft202012Validator(json.loads(rarms("schema", "output").out))
    assert rarms("init", str(tmp_path), "--name", "robot").code == 0

    for command in ("apply", "stop", "start", "undo", "destroy"):
        lines = rarms(command, "-f", str(tmp_path), "--auto-approve", "--json").lines
        documents = [json.loads(line) for line in lines]
        for document in documents:
            schema.validate(document)
        assert {document["kind"] for document in documents[:-1]} == {"step"}
        assert documents[-1]["kind"] == "run"


def test_every_name_of_the_library_can_be_imported() -> None:
    assert all(getattr(rarms_iac, name) is not None for name in rarms_iac.__all__)


def test_importing_the_package_imports_its_version_alone() -> None:
    program = "import sys, rarms_iac; print(sorted(name for name in sys.modules if name.startswith('rarms_iac.')))"

    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)

    assert ran.stdout == "['rarms_iac.model', 'rarms_iac.model.version']\n"


def test_name_that_is_not_there_is_attribute_error() -> None:
    assert not hasattr(rarms_iac, "anything_else")
    assert callable(rarms_iac.apply)
