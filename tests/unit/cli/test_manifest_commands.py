import json
from pathlib import Path

import pytest

from tests.unit.cli.running import rarms
from tests.unit.views.test_json import check


@pytest.fixture
def here(tmp_path: Path) -> Path:
    """A folder with a manifest that `init` wrote."""
    assert rarms("init", str(tmp_path)).code == 0
    return tmp_path


def spoil(here: Path) -> None:
    """A misspelt key in the manifest."""
    file = here / "rarms.yaml"
    file.write_text(file.read_text(encoding="utf-8").replace("criticality: 20", "criticalty: 20"), encoding="utf-8")


def test_init_writes_a_valid_named_manifest(tmp_path: Path) -> None:
    answer = rarms("init", str(tmp_path), "--name", "robot-7")

    assert answer.code == 0
    assert "rarms validate" in answer.err
    assert "name: robot-7" in (tmp_path / "rarms.yaml").read_text(encoding="utf-8")
    assert rarms("validate", str(tmp_path)).code == 0
    assert rarms("fmt", "--check", str(tmp_path)).code == 0


def test_init_overwrites_nothing(here: Path) -> None:
    before = (here / "rarms.yaml").read_bytes()

    answer = rarms("init", str(here))

    assert answer.code == 1
    assert "error[RARMS177]" in answer.err
    assert (here / "rarms.yaml").read_bytes() == before


def test_init_refuses_what_cannot_be_a_name(tmp_path: Path) -> None:
    assert rarms("init", str(tmp_path), "--name", "My Robot").code == 64
    assert list(tmp_path.iterdir()) == []


def test_init_makes_a_folder_that_is_not_there(tmp_path: Path) -> None:
    answer = rarms("init", str(tmp_path / "cells" / "north"))

    assert answer.code == 0
    assert f"cd {(tmp_path / 'cells' / 'north').as_posix()}, rarms validate" in " ".join(answer.err.split())
    assert rarms("validate", "-f", str(tmp_path / "cells" / "north")).code == 0


def test_init_here_advises_no_other_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)

    assert "then: rarms validate" in rarms("init").err


def test_init_says_where_no_folder_can_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")

    answer = rarms("init", str(tmp_path / "file" / "below"))

    assert answer.code == 1
    assert "error[RARMS177]" in answer.err


def test_validate_errors_are_data_with_code_2(here: Path) -> None:
    spoil(here)

    answer = rarms("validate", "-f", str(here))

    assert answer.code == 2
    assert answer.err == ""
    assert "criticalty" in answer.out
    assert "^" in answer.out
    assert "Did you mean" in answer.out


def test_validate_recommends_measure_then_plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert rarms("init").code == 0
    manifest = tmp_path / "rarms.yaml"
    fixed = manifest.read_text(encoding="utf-8")

    assert rarms("validate").err == "Next: `rarms plan`\n"
    assert rarms("validate", "rarms.yaml").err == "", "other files may belong to another manifest"
    manifest.write_text(fixed.replace("reserve: 30 %", "reserve: measured"), encoding="utf-8")
    assert rarms("validate").err == "Next: `rarms measure`\n"


def test_validate_reads_standard_input(here: Path) -> None:
    text = (here / "rarms.yaml").read_text(encoding="utf-8")

    assert rarms("validate", "-", stdin=text).code == 0
    assert rarms("validate", "-", stdin="").code == 2


def test_validate_writes_several_forms_in_one_run(here: Path) -> None:
    spoil(here)
    sarif = here / "out.sarif"

    answer = rarms("validate", str(here), "--output", "github", "--output", f"sarif={sarif}")

    assert answer.code == 2
    assert answer.out.startswith("::error ")
    assert json.loads(sarif.read_text(encoding="utf-8"))["version"] == "2.1.0"


def test_validate_for_programs_is_as_the_schema_says(here: Path) -> None:
    spoil(here)

    answer = rarms("validate", str(here), "--json")

    check(answer.out)
    assert json.loads(answer.out)["counts"]["errors"] >= 1


@pytest.mark.needs("posix", "not-root")
def test_a_file_without_rights_is_a_finding(here: Path) -> None:
    (here / "rarms.yaml").chmod(0)

    assert "does not let rarms read" in rarms("validate", str(here)).out


def test_fmt_writes_the_canonical_form_once(here: Path) -> None:
    file = here / "rarms.yaml"
    canonical = file.read_bytes()
    file.write_bytes(canonical.replace(b"criticality: 20", b"criticality:     20"))

    check_only = rarms("fmt", "--check", str(here))
    shown = rarms("fmt", "--diff", str(here))
    done = rarms("fmt", str(here))

    assert (check_only.code, shown.code, done.code) == (2, 0, 0)
    assert "would be formatted" in check_only.err
    assert "+    criticality: 20" in shown.out
    assert file.read_bytes() == canonical
    assert rarms("fmt", "--check", str(here)).code == 0


def test_fmt_of_standard_input_goes_to_standard_output(here: Path) -> None:
    text = (here / "rarms.yaml").read_text(encoding="utf-8")

    assert rarms("fmt", "-", stdin=text).out == text


def test_fmt_of_no_manifest_changes_nothing(here: Path) -> None:
    good, bad = here / "rarms.yaml", here / "bad.yaml"
    good.write_bytes(good.read_bytes() + b"\n\n\n")
    before = good.read_bytes()
    bad.write_text("a: [", encoding="utf-8")

    answer = rarms("fmt", str(good), str(bad))

    assert answer.code == 4
    assert "bad.yaml:" in answer.err
    assert good.read_bytes() == before


@pytest.mark.needs("posix")
def test_fmt_keeps_a_files_rights(here: Path) -> None:
    file = here / "rarms.yaml"
    file.write_bytes(file.read_bytes() + b"\n\n")
    file.chmod(0o600)

    assert rarms("fmt", str(file)).code == 0
    assert file.stat().st_mode & 0o777 == 0o600


def test_fmt_for_programs(here: Path) -> None:
    answer = rarms("fmt", "--check", "--json", str(here))

    check(answer.out)
    assert json.loads(answer.out)["files"][0]["changed"] is False


@pytest.mark.parametrize("name", ["manifest", "plan", "snapshot", "output", "datalog"])
def test_schema_prints_what_is_shipped(name: str) -> None:
    assert json.loads(rarms("schema", name).out)["$schema"].startswith("https://json-schema.org/")


def test_explain_shows_a_findings_page_in_any_case() -> None:
    answer = rarms("explain", "rarms199")

    assert answer.lines[0] == "RARMS199: This is a bug in rarms"
    check(rarms("explain", "RARMS199", "--json").out)


@pytest.mark.parametrize("word", ["14", "014", "rarms14", "rarms014", "RARMS014"])
def test_explain_takes_a_findings_number_alone(word: str) -> None:
    assert rarms("explain", word).lines[0] == "RARMS014: Reservations exceed the platform"


@pytest.mark.parametrize("code", ["RARMS999", "RARMS1999", "999"])
def test_explain_of_unknown_id_guesses_none(code: str) -> None:
    answer = rarms("explain", code)

    assert answer.code == 64
    assert "Did you mean" not in answer.err
    assert "docs/diagnostics.md" in answer.err
