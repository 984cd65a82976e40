"""Commands that meet another version of rarms on a Linux host: both versions, and the command that helps."""

import os
from pathlib import Path

import pytest

from rarms_iac.model.version import __version__
from tests.remote import write_script
from tests.unit.cli.running import rarms

MANIFEST = """\
schema: rarms/v1
application: { name: cell }
hosts:
  onboard:
    provider: linux
    logical_processors: 2
    memory: 1 GiB
    connect: { ssh: cell, folder: /opt/robot }
components:
  vision:
    criticality: 1
    memory: 64 MiB
    cpu: { reserve: 0.1 LP }
    apt: { mean_response_time: { at_most: 60 ms } }
    run:
      command: [vision]
      until: { samples: 20 }
      samples: { from: json_lines, response_time: { field: r, unit: ms } }
"""
COMMANDS = (
    "doctor",
    "plan",
    "drift",
    "status",
    "history",
    "snapshot --out snapshot.json",
    "apply --auto-approve",
    "destroy --auto-approve",
    "stop --auto-approve",
    "start --auto-approve",
    "undo --auto-approve",
    "measure vision",
    "prove --load-host",
    "run vision",
)


@pytest.mark.needs("posix")
@pytest.mark.parametrize("words", COMMANDS)
def test_both_versions_and_the_command_that_helps(words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_script(tmp_path / "bin" / "ssh", 'echo "rarms: installed 0.0.8 0.0.9 current"; exit 69')
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    monkeypatch.chdir(tmp_path)

    ended = rarms(*words.split())

    said = " ".join((ended.out + ended.err).split())
    assert ended.code != 0
    assert f"it has rarms 0.0.8, 0.0.9; this is rarms {__version__}" in said
    assert "rarms install --host onboard" in said
