import re
import shutil
import subprocess
from pathlib import Path

import pytest

from rarms_iac.cli.commands.help_commands import command_shapes
from rarms_iac.cli.table import COMMANDS
from rarms_iac.storage.finding_pages import known_codes
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
    assert complete("validate", "--output", "s") == ["sarif"]
    assert complete("explain", "RARMS01") == [code for code in known_codes() if code.startswith("RARMS01")]


@needs_bash
def test_the_bash_script_completes_the_components_of_the_manifest(tmp_path: Path) -> None:
    (tmp_path / "rarms.yaml").write_text(
        "hosts:\n  onboard: {}\ncomponents:\n    # the eyes\n    vision:\n        criticality: 3\n    video: {}\n"
        "partitions:\n  vault: {}\n",
        encoding="utf-8",
        newline="\n",
    )

    for names in (("-f", str(tmp_path)), ("--manifest", str(tmp_path / "rarms.yaml"))):
        assert complete("measure", *names, "v") == ["vision", "video"]
    assert complete("measure", "-f", str(tmp_path / "none"), "v") == []


@pytest.mark.needs("linux")
def test_what_zsh_and_fish_read_components_with_finds_the_same() -> None:
    program = re.search(r"awk '(.*)' \"\$file\"", rarms("completion", "zsh").out)
    manifest = Path(__file__).parents[3] / "manifests" / "delivery-robot" / "rarms.yaml"

    assert program is not None
    shown = subprocess.run(["awk", program[1], str(manifest)], capture_output=True, text=True, check=True)
    assert shown.stdout.split() == ["face-detection", "speech-recognition", "path-planning", "video-streaming"]


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
