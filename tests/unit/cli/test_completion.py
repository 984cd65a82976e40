import shutil
import subprocess
from pathlib import Path

import pytest

from rarms_iac.cli.shape import command_shapes
from rarms_iac.cli.table import COMMANDS
from rarms_iac.views.completion import Shell
from tests.unit.cli.running import rarms

BASH = shutil.which("bash")
needs_bash = pytest.mark.needs("bash")


def complete(*words: str) -> list[str]:
    """What bash offers for the last word."""
    assert BASH is not None
    script = rarms("completion", "bash").out
    ask = f'{script}\nCOMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _rarms; printf "%s\\n" "${{COMPREPLY[@]}}"'
    shown = subprocess.run(
        [BASH, "--norc", "-c", ask, "-", "rarms", *words], capture_output=True, text=True, check=True, env={"PATH": ""}
    )
    return shown.stdout.split()


@needs_bash
def test_the_bash_script_completes_commands_options_and_choices() -> None:
    assert complete("dri") == ["drift"]
    assert complete("--ver") == ["--version"]
    assert complete("schema", "--de") == ["--debug"]
    assert complete("completion", "po") == ["powershell"]


@needs_bash
def test_the_bash_script_parses(tmp_path: Path) -> None:
    script = tmp_path / "rarms.bash"
    script.write_text(rarms("completion", "bash").out, encoding="utf-8", newline="\n")

    assert subprocess.run([str(BASH), "-n", str(script)]).returncode == 0


@pytest.mark.parametrize("shell", list(Shell))
def test_every_script_knows_every_command_and_starts_no_python(shell: Shell) -> None:
    script = rarms("completion", shell.value).out

    assert all(name in script for name in COMMANDS)
    assert "python" not in script.lower().replace("starts no python", "")


def test_the_shape_has_every_option() -> None:
    schema = next(shape for shape in command_shapes() if shape.name == "schema")

    assert [option.flags[0] for option in schema.options] == ["--no-color", "--debug", "-h"]
