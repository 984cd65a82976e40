"""What `rarms validate` finds without a host."""

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path

import pytest

from rarms_iac.app.declared_hosts import LOOKED_AT
from rarms_iac.app.manifests import Validation, load_manifest, sources_in, validate
from rarms_iac.app.requests import ManifestSource
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.manifest.acceptance import apply_acceptances
from rarms_iac.model.diagnostics import Diagnostic, Severity
from rarms_iac.model.system import Acceptance, Policy
from rarms_iac.texts.findings import MOST_OF_A_KIND, Finding, first_of_each_kind
from tests.builders import PathPlaces

HEAD = "schema: rarms/v1\napplication: { name: cell }\n"
HOST = "hosts:\n  onboard: { logical_processors: 2, memory: 4 GiB, keep_for_host: { processor: 5 %, memory: 1 GiB } }\n"
SOURCE = ManifestSource(today=date(2026, 1, 1))


def component(name: str, reserve: str = "60 %", memory: str = "512 MiB", more: str = "") -> str:
    return f"  {name}: {{ criticality: 3, memory: {memory}, cpu: {{ reserve: {reserve} }}{more} }}\n"


def measured(name: str) -> str:
    apt = "apt: { mean_response_time: { at_most: 100 ms } }"
    return f"  {name}: {{ criticality: 3, memory: 512 MiB, {apt}, run: {{ command: [vision] }} }}\n"


def manifest(folder: Path, *components: str, hosts: str = HOST) -> Path:
    file = folder / "rarms.yaml"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(f"{HEAD}{hosts}components:\n{''.join(components)}", encoding="utf-8", newline="\n")
    return file


def validated(*paths: Path) -> Validation:
    return validate(sources_in(tuple(map(str, paths)), SOURCE))


def codes(findings: Sequence[Diagnostic]) -> list[str]:
    return [finding.code for finding in findings]


def test_two_reserves_of_60_percent_do_not_fit(tmp_path: Path) -> None:
    found = validated(manifest(tmp_path, component("a"), component("b")))

    assert codes(found.findings) == ["RARMS014"]
    assert "a 1.2 LP and b 1.2 LP need 2.4 LP; onboard has 1.9 LP for partitions." in found.findings[0].detail
    assert found.fails()


def test_memory_counts_even_if_unmeasured(tmp_path: Path) -> None:
    found = validated(
        manifest(tmp_path, component("a", "10 %", "2 GiB"), component("b", "10 %", "1 GiB"), measured("c"))
    )

    assert codes(found.findings) == ["RARMS101", "RARMS120"]
    assert "3.5 GiB" in found.findings[1].detail


def test_what_fits_has_no_findings(tmp_path: Path) -> None:
    assert validated(manifest(tmp_path, component("a", "50 %"), component("b", "45 %"))).findings == ()


def test_partition_too_large_for_any_host_is_told(tmp_path: Path) -> None:
    hosts = "hosts:\n" + "".join(
        f"  {name}: {{ logical_processors: 2, memory: 4 GiB, keep_for_host: {{ processor: 10 % }} }}\n"
        for name in ("north", "south")
    )

    both = component("a", "50 %", more=", together: [b]"), component("b", "45 %")

    found = validated(manifest(tmp_path, *both, hosts=hosts))

    assert codes(found.findings) == ["RARMS014"]
    assert "north and south" in found.findings[0].detail


def test_virtual_processors_without_a_place_are_told(tmp_path: Path) -> None:
    three = [component(name, "1.2 LP", more=", processors: 2") for name in ("a", "b")]
    hosts = "hosts:\n  onboard: { logical_processors: 3, memory: 4 GiB }\n"

    found = validated(manifest(tmp_path, *three, hosts=hosts))

    assert codes(found.findings) == ["RARMS121"]


def test_of_very_many_the_sum_is_still_told(tmp_path: Path) -> None:
    hosts = "hosts:\n" + "".join(f"  h{at}: {{ logical_processors: 1, memory: 64 GiB }}\n" for at in range(20))
    many = [component(f"c{at}", "0.2 LP", "32 MiB") for at in range(LOOKED_AT // 20 + 1)]

    found = validated(manifest(tmp_path, *many, hosts=hosts))

    assert codes(found.findings) == ["RARMS014"]


def test_unmeasured_reserve_is_a_note(tmp_path: Path) -> None:
    file = manifest(tmp_path, measured("vision"))

    before = validated(file)
    log = tmp_path / "measurements" / "onboard" / "vision" / "busy-loop.jsonl"
    log.parent.mkdir(parents=True)
    log.write_text("{}\n{}\n", encoding="utf-8", newline="\n")
    after = validated(file)

    assert (codes(before.findings), before.fails(strict=True)) == (["RARMS101"], False)
    assert "so each component needs `simulation: { work: 20 ms }`" in str(before.findings[0].advice)
    assert codes(after.findings) == ["RARMS107"]


def test_unmeasured_reserves_of_a_platform_are_one_note(tmp_path: Path) -> None:
    (note,) = validated(manifest(tmp_path, measured("vision"), measured("speech"))).findings

    assert (note.code, note.address) == ("RARMS101", "host/onboard")
    assert note.detail == "Not measured on onboard yet: speech and vision."


@pytest.mark.parametrize(
    ("policy", "own"),
    [("gone", ""), ("[busy-loop, gone]", ""), ("busy-loop", ", interference: gone")],
)
def test_unknown_load_is_an_unknown_name(tmp_path: Path, policy: str, own: str) -> None:
    file = manifest(tmp_path, measured("vision").replace(", run:", f"{own}, run:"))
    file.write_text(f"{file.read_text(encoding='utf-8')}policy: {{ interference: {policy} }}\n", encoding="utf-8")

    found = validated(file)

    errors = [finding for finding in found.findings if finding.severity is Severity.ERROR]
    assert [(error.code, error.detail) for error in errors] == [("RARMS042", 'The interference "gone" does not exist.')]


def test_meaning_is_judged_once_the_structure_is_right(tmp_path: Path) -> None:
    parts = component("a", more=", together: [nobody, c]"), component("b"), component("c", memory="512")
    wrong = validated(manifest(tmp_path, *parts))
    right = validated(manifest(tmp_path, *parts[:2], component("c")))

    assert codes(wrong.findings) == ["RARMS017"]
    assert codes(right.findings) == ["RARMS042"]


def test_an_error_of_a_host_leaves_sums_open(tmp_path: Path) -> None:
    hosts = HOST.replace("memory: 4 GiB", "memory: 4")

    assert codes(validated(manifest(tmp_path, component("a"), component("b"), hosts=hosts)).findings) == ["RARMS017"]


def test_folder_is_walked_with_overlays(tmp_path: Path) -> None:
    manifest(tmp_path / "north", component("a"))
    manifest(tmp_path / "south", component("a", "10 %"))
    manifest(tmp_path / ".hidden", component("a"), component("b"))
    overlays = tmp_path / "north" / "robots"
    overlays.mkdir()
    (overlays / "robot-7.yaml").write_text(
        "components:\n" + component("arm", more=", new: true"), encoding="utf-8", newline="\n"
    )
    (tmp_path / "compose.yaml").write_text("services:\n  web: { image: x }\n", encoding="utf-8", newline="\n")

    found = validated(tmp_path)

    assert codes(found.findings) == ["RARMS014"]
    assert "a 1.2 LP and arm 1.2 LP" in found.findings[0].detail
    assert sorted(Path(file).name for file in found.sources) == ["rarms.yaml", "rarms.yaml", "robot-7.yaml"]


@pytest.mark.parametrize(
    ("text", "is_found"),
    [
        ("componets:\n  a: { criticality: 2 }\n", True),
        ("host:\n  onboard: { memory: 2 GiB }\ncomponents: {}\n", True),
        ("host: db.example\n", False),
        ("services:\n  web: { image: x }\ncomponents: {}\n", False),
    ],
)
def test_mistyped_overlay_section_is_found(tmp_path: Path, text: str, is_found: bool) -> None:
    manifest(tmp_path, component("a"))
    (tmp_path / "robot-7.yaml").write_text(text, encoding="utf-8", newline="\n")

    found = validated(tmp_path).findings

    assert codes(found) == (["RARMS015"] if is_found else [])


def test_an_overlay_alone_finds_the_manifest_above_it(tmp_path: Path) -> None:
    manifest(tmp_path, component("a"))
    overlay = tmp_path / "robots" / "robot-7.yaml"
    overlay.parent.mkdir()
    overlay.write_text("components:\n  a: { criticalty: 2 }\n", encoding="utf-8", newline="\n")

    (finding,) = validated(overlay).findings

    assert (finding.place and Path(finding.place.file).name, "criticalty" in finding.detail) == ("robot-7.yaml", True)


def test_the_solver_is_not_imported(tmp_path: Path) -> None:
    hosts = HOST + HOST.removeprefix("hosts:\n").replace("onboard", "two")
    file = manifest(tmp_path, component("a"), component("b"), hosts=hosts)
    program = (
        "import sys; from rarms_iac.cli.main import main; code = main(['validate', sys.argv[1]]); "
        "sys.exit(100 if 'highspy' in sys.modules else code)"
    )

    done = subprocess.run(
        [sys.executable, "-c", program, str(file)], env=dict(os.environ), capture_output=True, text=True, check=False
    )

    assert (done.returncode, done.stdout) == (0, "No findings.\n")


def test_many_findings_are_counted(tmp_path: Path) -> None:
    names = ", ".join(f"nobody-{number:05}" for number in range(MOST_OF_A_KIND + 234))
    file = manifest(tmp_path, component("vision", more=f", apart: [{names}]"))
    source = replace(SOURCE, manifest=str(file))

    validated_findings = validated(file).findings
    with pytest.raises(UseCaseError) as refused:
        load_manifest(source)

    for findings in (validated_findings, refused.value.findings):
        unknown = [finding for finding in findings if finding.code == "RARMS042"]
        assert len(unknown) == MOST_OF_A_KIND + 1
        assert [finding.detail for finding in unknown if finding.place is None] == ["234 more of this kind follow."]
        assert first_of_each_kind(findings) == findings


def test_variables_of_processes_are_looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = "{ command: [a], environment: { TOKEN: { from_env: RARMS_TEST_TOKEN }, CAMERA_PASSWORD: qz7!xyz } }"
    samples = "{ from: per_run, process: one }"
    run = f", run: {{ processes: {{ one: {one}, two: {{ command: [b] }} }}, samples: {samples} }}"
    file = manifest(tmp_path, component("a", "50 %", more=run), component("b", "45 %"))
    monkeypatch.setenv("RARMS_TEST_TOKEN", "qz7!x")

    found = {finding.code: finding for finding in validated(file).findings}

    assert found.keys() == {"RARMS091", "RARMS345"}
    assert found["RARMS091"].values["variable"] == "CAMERA_PASSWORD"
    assert all(finding.place is not None and finding.place.line > 1 for finding in found.values())


def test_acceptance_sees_all_findings() -> None:
    kind = Finding(code="RARMS159", severity=Severity.WARNING, summary="A warning")
    hosts = [f"host/{number:05}" for number in range(2 * MOST_OF_A_KIND)]
    policy = Policy(accept={"RARMS159": Acceptance(code="RARMS159", at=(hosts[-1],), reason="known", until=None)})

    shown, accepted = apply_acceptances(
        [kind.at(None, "", "", address=host) for host in hosts], policy, PathPlaces(), SOURCE.today
    )

    assert [finding.address for finding in accepted] == [hosts[-1]]
    assert {finding.code for finding in shown} == {"RARMS159"}
    assert [finding.detail for finding in shown if not finding.address] == ["999 more of this kind follow."]


@pytest.mark.parametrize(("value", "is_named"), [(None, False), ("", False), ("qz7!x", True), ("qz7!xy", False)])
def test_short_secret_is_named_without_value(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, value: str | None, is_named: bool
) -> None:
    run = ", run: { command: [a], environment: { TOKEN: { from_env: RARMS_TEST_TOKEN }, MODE: fast } }"
    file = manifest(tmp_path, component("a", "50 %", more=run), component("b", "45 %"))
    monkeypatch.delenv("RARMS_TEST_TOKEN", raising=False)
    if value is not None:
        monkeypatch.setenv("RARMS_TEST_TOKEN", value)

    found = validated(file)

    named = [(finding.code, finding.severity, finding.address, finding.values) for finding in found.findings]
    facts = {"component": "a", "variable": "RARMS_TEST_TOKEN", "least": 6}
    assert named == ([("RARMS345", Severity.WARNING, "component/a", facts)] if is_named else [])
    assert not any(value and value in str(finding) for finding in found.findings)
    with file.open("a", encoding="utf-8") as manifest_file:
        manifest_file.write("policy: { accept: { RARMS345: { at: [component/a], reason: no secret } } }\n")
    assert validated(file).findings == ()
