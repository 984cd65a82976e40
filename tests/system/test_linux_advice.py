"""What messages about control groups recommend, run on real ones in the situation that each message is about."""

import os
from collections.abc import Iterator
from contextlib import chdir
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.providers.cgroups.machine import read_boot
from rarms_iac.providers.cgroups.provider import STATE_FOLDER
from tests.contracts.benches import forget_host, groups_of, slice_of
from tests.unit.cli.running import rarms

pytestmark = [pytest.mark.needs("control-groups")]

MANIFEST = """\
schema: rarms/v1
application: {{ name: advice }}
policy: {{ interference: busy-loop }}
hosts:
  here:
    provider: linux
    logical_processors: {processors}
    memory: 1 GiB
    keep_for_host: {{ processor: 10 %, memory: 256 MiB }}
    linux: {{ slice: {slice}, mechanism: deadline }}
components:
  eyes:
    criticality: 20
    memory: 64 MiB
    cpu: {{ reserve: 20 % }}
    apt: {{ mean_response_time: {{ at_most: 25 ms }} }}
    run: {{ command: [python3, -c, pass], until: {{ samples: 1 }}, samples: {{ from: per_run }} }}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """A folder with the manifest, which is applied; the machine is as before afterwards."""
    slice_name = slice_of(tmp_path)
    text = MANIFEST.format(processors=len(os.sched_getaffinity(0)), slice=slice_name)
    (tmp_path / "rarms.yaml").write_text(text, encoding="utf-8")
    run(tmp_path, "apply", "--auto-approve")
    yield tmp_path
    forget_host(tmp_path)


def run(folder: Path, command: str, *words: str, ends: int = 0) -> str:
    """All that a command says that must end so, in one line."""
    with chdir(folder):
        ran = rarms(command, *words)
    assert ran.code == ends, ran.out + ran.err
    return " ".join((ran.out + ran.err).split())


@pytest.mark.parametrize("at_boot", [False, True])
def test_after_restart_apply_or_unit_starts_partitions(folder: Path, at_boot: bool) -> None:
    groups_of(folder).remove("eyes")
    for definition in (STATE_FOLDER / slice_of(folder)).glob("*.json"):
        text = definition.read_text(encoding="ascii")
        definition.write_text(text.replace(read_boot(LinuxEffects()), "an earlier start"), encoding="ascii")

    advised = run(folder, "doctor")
    assert "`rarms apply` starts them" in advised
    if at_boot:
        assert "`rarms start --boot` starts them at each boot" in advised
        assert f"Started below {slice_of(folder)}: eyes." in run(folder, "start", "--boot")
        assert run(folder, "plan") != ""
    else:
        run(folder, "apply", "--auto-approve", "--lock-timeout", "60s")  # other tests hold this machine, too

    assert groups_of(folder).names() == ("eyes",)
    assert "starts them" not in run(folder, "doctor")
    assert f"Started below {slice_of(folder)}: none, because none was off." in run(folder, "start", "--boot")


@pytest.mark.parametrize(("key", "kind"), [("user: robot-7", "user"), ("groups: [robot-7]", "group")])
def test_doctor_names_missing_users(folder: Path, key: str, kind: str) -> None:
    manifest = folder / "rarms.yaml"
    manifest.write_text(manifest.read_text(encoding="utf-8").replace("run: {", f"run: {{ {key},"), encoding="utf-8")

    assert f"eyes cannot run on here: the {kind} robot-7 does not exist here." in run(folder, "doctor", ends=2)


@pytest.mark.alone  # other tests' deadlines take from what the kernel admits
def test_processors_taken_from_deadline_are_given_back(
    folder: Path,
) -> None:
    groups = groups_of(folder)
    groups.write("eyes", replace(groups.read("eyes"), processors=(0,)))

    # `rarms prove` refuses before with RARMS119; only a change after that look meets the advice itself.
    assert "eyes has 1 of" in run(folder, "run", "eyes")
    assert "eyes" in run(folder, "plan")
    run(folder, "apply", "--auto-approve")

    assert groups.read("eyes").processors is None
    assert "without a reservation" not in run(folder, "run", "eyes")


def test_kernel_refusal_leads_to_doctor(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(16, "Device or resource busy")

    manifest = folder / "rarms.yaml"
    manifest.write_text(manifest.read_text(encoding="utf-8").replace("64 MiB", "96 MiB"), encoding="utf-8")
    with monkeypatch.context() as patched:
        patched.setattr(type(groups_of(folder)), "write", refuse)
        refused = run(folder, "apply", "--auto-approve", ends=1)

    assert "Check the kernel: `rarms doctor`" in refused
    run(folder, "doctor")
    run(folder, "apply", "--auto-approve")
    assert groups_of(folder).read("eyes").memory == 96 * 2**20
