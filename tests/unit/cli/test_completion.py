import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rarms_iac.cli.table import COMMANDS
from rarms_iac.storage.finding_pages import known_codes
from tests.needs import CHECKOUT
from tests.unit.cli.running import rarms

BASH = shutil.which("bash")
needs_bash = pytest.mark.needs("bash")


@pytest.fixture
def complete(monkeypatch: pytest.MonkeyPatch):  # type: ignore[no-untyped-def]  # a function of words
    """What is offered for the last word, as PowerShell's script asks."""

    def ask(*words: str) -> list[str]:
        monkeypatch.setenv("_RARMS_COMPLETE", "powershell_complete")
        monkeypatch.setenv("COMP_WORDS", "\n".join(words[:-1]))
        monkeypatch.setenv("COMP_CWORD", words[-1])
        return [line.partition("\t")[0] for line in rarms().lines if line]

    return ask


def test_commands_options_and_choices_are_completed(complete) -> None:  # type: ignore[no-untyped-def]
    assert complete("dri") == ["drift"]
    assert complete("") == list(COMMANDS)
    assert complete("--ver") == ["--version"]
    assert complete("schema", "--de") == ["--debug"]
    assert complete("completion", "po") == ["powershell"]
    assert complete("validate", "--output", "s") == ["sarif"]
    assert complete("plan", "--max-disruption", "l") == ["live"]
    assert complete("explain", "RARMS01") == [code for code in known_codes() if code.startswith("RARMS01")]


def test_names_are_those_of_the_manifest(tmp_path: Path, complete) -> None:  # type: ignore[no-untyped-def]
    (tmp_path / "rarms.yaml").write_text(
        "hosts:\n  onboard: {}\ncomponents:\n    # the eyes\n    vision:\n        criticality: 3\n    video: {}\n"
        "partitions:\n  vault: {}\n",
        encoding="utf-8",
        newline="\n",
    )

    for manifest in (str(tmp_path), str(tmp_path / "rarms.yaml")):
        assert complete("measure", "-f", manifest, "v") == ["vision", "video"]
        assert complete("plan", "--manifest", manifest, "--host", "") == ["onboard"]


@pytest.mark.parametrize(
    "words", [("measure", "-f", "nothing-here", "v"), ("measure", "--nonsense", "x", "-f", "-", "v")]
)
def test_what_cannot_be_read_offers_nothing(words: tuple[str, ...], complete) -> None:  # type: ignore[no-untyped-def]
    assert complete(*words) == []


@needs_bash
def test_the_bash_script_asks_rarms(tmp_path: Path) -> None:
    program = tmp_path / "rarms"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m rarms_iac.cli.main "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    script = rarms("completion", "bash").out
    ask = f'{script}\nCOMP_WORDS=(rarms dri); COMP_CWORD=1; _rarms_completion rarms; printf "%s\\n" "${{COMPREPLY[@]}}"'
    environment = {**os.environ, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(CHECKOUT)}

    shown = subprocess.run(
        [str(BASH), "--norc", "-c", ask], capture_output=True, text=True, check=True, env=environment
    )

    assert (shown.stdout, shown.stderr) == ("drift\n", "")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish", "powershell"])
def test_completion_script_only_asks_rarms(shell: str) -> None:
    script = rarms("completion", shell).out

    assert "_RARMS_COMPLETE" in script and f"{shell}_complete" in script  # noqa: PT018
    assert "components" not in script


def test_completing_a_command_imports_no_command() -> None:
    script = (
        "import sys; from rarms_iac.cli.main import main; main([]); "
        "print([m for m in sys.modules if m.startswith(('rarms_iac.cli.commands.', 'yaml', 'pydantic', 'rich'))])"
    )
    asked = {**os.environ, "_RARMS_COMPLETE": "powershell_complete", "COMP_CWORD": "dri"}

    shown = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, env=asked)

    assert shown.stdout.splitlines()[-1] == "[]"


def test_missing_shell_lists_the_known_ones() -> None:
    answer = rarms("completion")

    assert answer.code == 64
    assert "Choose from: bash, zsh, fish, powershell." in " ".join(answer.err.split())
