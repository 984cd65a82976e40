"""docs/library.md: its lines run as they stand, in a folder with its manifest."""

import re
import subprocess
import sys
from pathlib import Path

PAGE = (Path(__file__).parents[2] / "docs" / "library.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    found = re.search(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    assert found is not None, language
    return found.group(1)


def test_the_lines_of_the_page_measure_plan_apply_and_prove(tmp_path: Path) -> None:
    (tmp_path / "rarms.yaml").write_text(block("yaml"), encoding="utf-8")
    program = block("python") + "print(rarms.plan(robot).has_changes)\n"

    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300
    )

    assert done.returncode == 0, done.stderr
    measured, applied, proven, changes = done.stdout.splitlines()
    assert measured.startswith("vision Sufficient(")
    assert applied.endswith(" done")
    assert proven == "[]"
    assert changes == "False"


def test_importing_the_package_imports_its_version_alone() -> None:
    program = "import sys, rarms_iac; print(sorted(name for name in sys.modules if name.startswith('rarms_iac.')))"

    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)

    assert ran.stdout == "['rarms_iac.model', 'rarms_iac.model.version']\n"


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    import rarms_iac

    assert not hasattr(rarms_iac, "anything_else")
    assert callable(rarms_iac.apply)
