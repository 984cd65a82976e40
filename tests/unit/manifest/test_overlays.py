"""Overlays: what merges, what replaces, what is removed, and who said it."""

import os
from datetime import date
from pathlib import Path

import pytest

from rarms_iac.manifest.load import Loaded, load_system
from rarms_iac.manifest.overlays import UNKNOWN_NAME, moved_path
from rarms_iac.model.loads import DEFAULT_LOADS
from rarms_iac.model.run import Command, Elapsed, Run
from rarms_iac.model.system import AtMost, Component
from tests.unit.manifest.examples import no_checks
from tests.unit.manifest.test_load import SMALL, loaded, write


def vision(read: Loaded) -> Component:
    assert read.system is not None, read.diagnostics
    return read.system.components["vision"]


def run(read: Loaded) -> Run:
    found = vision(read).run
    assert found is not None
    return found


def test_maps_merge(tmp_path: Path) -> None:
    read = loaded(tmp_path, SMALL, "components: {vision: {memory: 1 GiB}, speech: {criticality: 3}}\n")

    assert (vision(read).memory, vision(read).criticality) == (2**30, 40)
    assert read.system is not None
    assert list(read.system.components) == ["vision", "speech"]


@pytest.mark.parametrize(
    ("overlay", "found"),
    [
        ("components: {vison: {criticality: 3}}", ("component/vison", 'Did you mean "vision"?')),
        ("components: {vison: null}", ("component/vison", 'removes the component "vison"')),
        ("hosts: {onbord: {logical_processors: 2, memory: 1 GiB}}", ("host/onbord", 'Did you mean "onboard"?')),
        ("partitions: {vison: {components: [vision]}}", ("partition/vison", 'Did you mean "vision"?')),
        ("partitions: {vision: {memory: 1 GiB}}", None),
        ("components: {speech: {criticality: 3, new: true}}\npartitions: {speech: {memory: 1 GiB}}", None),
        ("hosts: {dock: {logical_processors: 2, memory: 1 GiB, new: true}}", None),
        ("partitions: {front: {components: [vision], new: true}}", None),
    ],
)
def test_name_that_only_the_overlay_has(tmp_path: Path, overlay: str, found: tuple[str, str] | None) -> None:
    read = loaded(tmp_path, SMALL, f"{overlay}\n")

    warnings = [(each.address, each.detail) for each in read.diagnostics if each.code == UNKNOWN_NAME.code]
    assert [address for address, _ in warnings] == ([found[0]] if found else [])
    assert all(found is not None and found[1] in detail for _, detail in warnings)
    assert read.system is not None


def test_misspelt_overlay_name_is_a_finding(tmp_path: Path) -> None:
    read = loaded(tmp_path, SMALL, "components: {vison: {memory: 1 GiB}}\n")

    assert read.system is None
    assert {each.code for each in read.diagnostics} > {UNKNOWN_NAME.code}


def test_the_later_overlay_wins(tmp_path: Path) -> None:
    first, second = (f"components: {{vision: {{criticality: {number}}}}}\n" for number in (1, 2))

    assert vision(loaded(tmp_path, SMALL, first, second)).criticality == 2


def test_a_list_replaces_a_list(tmp_path: Path) -> None:
    read = loaded(tmp_path, SMALL, "components: {vision: {run: {command: [other]}}}\n")

    assert run(read).start == Command(words=("other",))


def test_null_removes(tmp_path: Path) -> None:
    read = loaded(tmp_path, SMALL, "components: {vision: {apt: null}, nobody: null}\npolicy: null\n")

    assert vision(read).apt == {}


@pytest.mark.parametrize(
    ("overlay", "advice"),
    [
        ("hosts: {onboard: {provider: linux}}\n", "Write hyperv: null in overlay-0.yaml."),
        ("hosts: {onboard: {memory: 2 GiB}}\n", "Remove it, or write provider: hyperv."),
    ],
)
def test_null_is_advised_for_another_provider(tmp_path: Path, overlay: str, advice: str) -> None:
    text = SMALL.replace("memory: 4 GiB", "memory: 4 GiB, hyperv: {generation: 2}", 1)
    text = text if "provider" in overlay else text.replace("memory: 4 GiB", "provider: linux, memory: 4 GiB", 1)
    read = loaded(tmp_path, text, overlay)

    (found,) = (str(each.advice) for each in read.diagnostics if each.code == "RARMS015")
    assert found.replace(f"{tmp_path.as_posix()}/", "") == advice


def test_null_removes_inside_what_manifest_does_not_have(tmp_path: Path) -> None:
    read = loaded(tmp_path, SMALL, "policy: {interference: null, headroom: none}\n")

    assert read.system is not None
    assert (read.system.policy.interference, read.system.policy.headroom) == (DEFAULT_LOADS, "none")


@pytest.mark.parametrize("overlay", ["run: {until: {elapsed: 3 s}}", "apt: {mean_response_time: {at_most: 7 ms}}"])
def test_joint_values_are_replaced_together(tmp_path: Path, overlay: str) -> None:
    base = SMALL.replace("[python3, vision.py]", "[x], until: {samples: 3}")

    read = loaded(tmp_path, base, f"components: {{vision: {{{overlay}}}}}\n")

    if "until" in overlay:
        assert run(read).until == Elapsed(time=run(read).until.time)  # type: ignore[union-attr]  # it is one
    else:
        assert vision(read).apt == {"mean_response_time": AtMost(value=vision(read).apt["mean_response_time"].value)}
        assert vision(read).apt["mean_response_time"].value == 7


def test_place_is_in_file_that_said_it(tmp_path: Path) -> None:
    read = loaded(tmp_path, SMALL, "components:\n  vision: {memory: 1 GiB}\n")

    assert Path(read.places.value("components", "vision", "memory").file).name == "overlay-0.yaml"
    assert Path(read.places.value("components", "vision", "criticality").file).name == "rarms.yaml"
    assert read.places.key("components", "vision", "memory").line == 2


def test_paths_are_relative_to_file_that_says_them(tmp_path: Path) -> None:
    (tmp_path / "cells" / "tools").mkdir(parents=True)
    (tmp_path / "cells" / "tools" / "x.py").touch()
    message = "{command: [python3, tools/x.py, ./new.py, -v, tools/none.py], files: ['*.bin'], folder: work}"
    overlay = write(tmp_path, f"components: {{vision: {{run: {message}}}}}\n", "cells/one.yaml")

    read = load_system(write(tmp_path, SMALL), [overlay], today=date(2026, 1, 1), checks=no_checks)

    assert run(read).start == Command(words=("python3", "cells/tools/x.py", "cells/new.py", "-v", "tools/none.py"))
    assert (run(read).files, run(read).folder) == (("cells/*.bin",), "cells/work")


@pytest.mark.parametrize("path", ["/opt/x", "C:\\x"])
def test_an_absolute_path_stays(path: str) -> None:
    assert moved_path(path, "a", "b") == path


def test_a_path_may_lie_above() -> None:
    assert moved_path("x", "cells", os.path.join("robots", "one")) == "../../cells/x"  # noqa: PTH118 - the caller's form


def test_an_overlay_that_cannot_be_read_is_told(tmp_path: Path) -> None:
    read = load_system(write(tmp_path, SMALL), [str(tmp_path / "none.yaml")], today=date(2026, 1, 1), checks=no_checks)

    assert read.system is None
    assert [diagnostic.code for diagnostic in read.diagnostics] == ["RARMS001"]
