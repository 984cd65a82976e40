"""What the Action installs is held with hashes, which `scripts/lock` writes: all that rarms needs and is built with."""

import re
import tomllib
from pathlib import Path

import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[3]
LOCK = (ROOT / "locked-requirements.txt").read_text(encoding="utf-8")
LINES = [line for line in LOCK.replace("\\\n", "").splitlines() if not line.startswith("#")]


def locked() -> dict[str, list[Requirement]]:
    """The pinned requirements, by name."""
    by_name: dict[str, list[Requirement]] = {}
    for line in LINES:
        requirement = Requirement(re.split(r"\s+--hash", line)[0])
        by_name.setdefault(canonicalize_name(requirement.name), []).append(requirement)
    return by_name


def test_every_dependency_is_locked_within_its_bounds() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wanted = [*project["project"]["dependencies"], *project["build-system"]["requires"]]
    held = locked()
    for requirement in map(Requirement, wanted):
        for pin in held[canonicalize_name(requirement.name)]:
            (version,) = pin.specifier
            assert version.operator == "=="
            assert requirement.specifier.contains(version.version), f"{requirement}: run make lock"


def test_locked_versions_have_hashes() -> None:
    for line in LINES:
        assert re.search(r"--hash=sha256:[0-9a-f]{64}\b", line), line
    assert "://" not in LOCK
    assert "index" not in LOCK


def test_the_action_installs_by_these_hashes_alone() -> None:
    action = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
    (install,) = [step["run"] for step in action["runs"]["steps"] if step["name"] == "Install rarms"]
    installs = [line for line in install.splitlines() if "pip" in line and " install " in line]
    assert len(installs) == 2
    assert '--require-hashes -r "$GITHUB_ACTION_PATH/locked-requirements.txt"' in installs[0]
    assert "--no-deps --no-build-isolation" in installs[1]
