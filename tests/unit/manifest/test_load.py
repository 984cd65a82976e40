"""The whole route on small manifests."""

from datetime import date
from fractions import Fraction
from pathlib import Path

import pytest

from rarms_iac.manifest.load import Loaded, load_system, manifest_path
from rarms_iac.model.diagnostics import Severity
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.loads import LOADS_WITHOUT_ENTRY
from rarms_iac.model.system import AtMost, Measured
from tests.unit.manifest.examples import no_checks

SMALL = """\
schema: rarms/v1
application: {name: robot}
hosts:
  onboard: {logical_processors: 2, memory: 4 GiB}
components:
  vision:
    criticality: 40
    apt: {mean_response_time: {at_most: 100 ms}}
    run: {command: [python3, vision.py]}
"""


def write(folder: Path, text: str, name: str = "rarms.yaml") -> str:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8", newline="\n")
    return str(path)


def loaded(folder: Path, text: str, *overlays: str) -> Loaded:
    files = [write(folder, overlay, f"overlay-{number}.yaml") for number, overlay in enumerate(overlays)]
    return load_system(write(folder, text), files, today=date(2026, 1, 1), checks=no_checks)


def test_small_manifest_becomes_system_with_every_default(tmp_path: Path) -> None:
    system = loaded(tmp_path, SMALL).system

    assert system is not None
    assert system.hosts["onboard"].provider is ProviderKind.SIMULATED
    assert system.hosts["onboard"].platform == "onboard"
    vision = system.components["vision"]
    assert vision.apt == {"mean_response_time": AtMost(value=Fraction(100))}
    assert vision.cpu.reserve is Measured.MEASURED
    assert vision.run is not None
    assert vision.run.until is None
    assert system.interference == LOADS_WITHOUT_ENTRY


def test_a_folder_means_the_manifest_in_it(tmp_path: Path) -> None:
    write(tmp_path, SMALL)

    assert manifest_path(str(tmp_path)) == str(tmp_path / "rarms.yaml")


def test_the_digest_changes_with_the_text_alone(tmp_path: Path) -> None:
    first = loaded(tmp_path / "a", SMALL)
    same = loaded(tmp_path / "b", SMALL.replace("\n", "\r\n"))  # as git may write it on Windows
    other = loaded(tmp_path / "c", SMALL + "# a comment\n")

    assert first.digest == same.digest
    assert first.texts_without_secrets()[0].lines == same.texts_without_secrets()[0].lines
    assert first.digest != other.digest


def test_lines_of_sources_are_there_to_be_shown(tmp_path: Path) -> None:
    read = loaded(tmp_path, SMALL)

    (lines,) = read.sources.values()

    assert lines[1] == "application: {name: robot}"


def test_a_flood_of_errors_is_counted(tmp_path: Path) -> None:
    flood = "".join(f"key-{number}: x\n" for number in range(1500))

    codes = [diagnostic.code for diagnostic in loaded(tmp_path, SMALL + flood).diagnostics]

    assert (len(codes), codes.count("RARMS015")) == (1001, 1001)


def test_flood_that_cannot_be_listed_is_counted_too(tmp_path: Path) -> None:
    flood = "".join(f"  C{number}: x\n" for number in range(50_000))

    read = loaded(tmp_path, SMALL + flood)

    assert len(read.diagnostics) == 1001
    assert any("99,000 more errors" in each.detail for each in read.diagnostics)
    assert "RARMS016" not in {diagnostic.code for diagnostic in read.diagnostics}


def test_keeping_the_whole_host_is_refused(tmp_path: Path) -> None:
    kept = "memory: 4 GiB, keep_for_host: {processor: 110 %}}"

    [found] = loaded(tmp_path, SMALL.replace("memory: 4 GiB}", kept)).diagnostics

    assert (found.code, found.place.path if found.place else "") == (
        "RARMS017",
        "hosts.onboard.keep_for_host.processor",
    )
    assert found.detail == 'hosts.onboard.keep_for_host.processor is "110 %". It must be at most 100 %.'


@pytest.mark.parametrize(
    ("before", "after", "advice"),
    [
        ("40", '"40"', "Remove the quotes: 40."),
        ("mean_response_time", "p100_response_time", "Did you mean maximum_response_time?"),
        ("mean_response_time", "mean", "Did you mean mean_response_time?"),
        ("mean_response_time", "p90", "Did you mean p90_response_time?"),
        ("mean_response_time", "p99.0_response_time", "Did you mean p99_response_time?"),
        ("mean_response_time", "p99.90_response_time", "Did you mean p99.9_response_time?"),
        ("[python3, vision.py]", "[a], arrival: 40 ms", "Write {every: 40 ms}."),
        (
            "[python3, vision.py]",
            "[a], arrival: often",
            "Write closed or a map with the key every.",
        ),
        ("[python3, vision.py]", "[a], until: 60 s", "Write {elapsed: 60 s}."),
        ("[python3, vision.py]", "[a], until: 60", "Write {samples: 60}."),
        ("[python3, vision.py]", "[a], samples: per_run", "Write {from: per_run}."),
        ("criticality: 40", "cpu: 40 %\n    criticality: 40", "Write {reserve: 40 %} or {limit: 40 %}."),
    ],
)
def test_misspelt_value_gets_the_meant_one(tmp_path: Path, before: str, after: str, advice: str) -> None:
    [found] = loaded(tmp_path, SMALL.replace(before, after)).diagnostics

    assert str(found.advice) == advice


def test_a_misspelt_key_is_not_missing_too(tmp_path: Path) -> None:
    misspelt = loaded(tmp_path, SMALL.replace("criticality:", "criticallity:")).diagnostics
    both = loaded(tmp_path, SMALL.replace("criticality: 40", "rank: 40")).diagnostics

    assert [diagnostic.code for diagnostic in misspelt] == ["RARMS015"]
    assert "criticality" in str(misspelt[0].advice)
    assert sorted(diagnostic.code for diagnostic in both) == ["RARMS015", "RARMS016"]


def test_missing_overlay_is_not_to_become_manifest(tmp_path: Path) -> None:
    manifest, comment = write(tmp_path, SMALL), write(tmp_path, "# nothing yet\n", "comment.yaml")

    for overlay in (comment, write(tmp_path, "\n", "empty.yaml"), str(tmp_path / "missing.yaml")):
        read = load_system(manifest, [overlay], today=date(2026, 11, 21), checks=no_checks)
        (told,) = [diagnostic for diagnostic in read.diagnostics if diagnostic.severity is Severity.ERROR]
        assert "differ" in str(told.advice)
        assert "rarms init" not in str(told.advice)


@pytest.mark.parametrize(("until", "holds"), [("2026-11-21", True), ("2026-11-20", False)])
def test_a_system_has_no_acceptance_that_has_expired(tmp_path: Path, until: str, *, holds: bool) -> None:
    accepted = f'policy: {{ accept: {{ RARMS159: {{ at: [host/onboard], reason: a bench, until: "{until}" }} }} }}\n'

    read = load_system(write(tmp_path, SMALL + accepted), today=date(2026, 11, 21), checks=no_checks)

    assert read.system is not None
    assert ("RARMS159" in read.system.policy.accept) is holds
