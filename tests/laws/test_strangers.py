"""A manifest by any author: `validate` and `plan --snapshot` start no program, show no variable it names, and open
no file outside of the checkout. That is why pull requests of strangers are safe to look at."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import rarms_iac

pytestmark = pytest.mark.needs("posix", "git")

WATCHED = """
import json, os, sys

class Watched(os._Environ):
    def __getitem__(self, key):
        READ.append(str(key))
        return super().__getitem__(key)

READ, EVENTS = [], []
os.environ.__class__ = Watched

def watch(event, arguments):
    if event == "open":
        EVENTS.append((event, os.path.realpath(str(arguments[0])) if not isinstance(arguments[0], int) else ""))
    elif event.split(".")[0] in {"subprocess", "socket", "pty"} or event in {
        "os.system", "os.exec", "os.posix_spawn", "os.spawn", "os.fork", "os.forkpty", "ctypes.dlopen",
    }:
        EVENTS.append((event, str(arguments)))

sys.addaudithook(watch)
from rarms_iac.cli.main import main
code = main(sys.argv[2:])
with open(sys.argv[1], "w") as file:
    json.dump({"code": code, "events": EVENTS, "read": READ}, file)
"""

COMPONENT = """
  NAME:
    criticality: 3
    memory: 512 MiB
    apt: { mean_response_time: { at_most: 100 ms } }
    simulation: { work: 10 ms, varies: 10 % }
    interference: theirs
    run:
      RUN
      files: [components/*.py, ../../outside/secret.txt, OUTSIDE/*, link.txt, '/etc/pass*']
      environment: { TOKEN: { from_env: STRANGERS_TOKEN } }
      until: { samples: 20 }
"""
COMPONENTS = COMPONENT.replace("NAME", "vision").replace("RUN", "command: [OUTSIDE/secret.txt, ./run.sh, /bin/true]")
COMPONENTS += COMPONENT.replace("NAME", "speech").replace("RUN", "call: components.seen:work").removeprefix("\n")
MANIFEST = f"""schema: rarms/v1
application: {{ name: strange }}
hosts:
  onboard: {{ HOST, logical_processors: 2, memory: 4 GiB }}
components:{COMPONENTS}
interference:
  theirs: {{ kind: command, command: [OUTSIDE/secret.txt, /bin/sh, -c, touch OUTSIDE/run] }}
"""
TOKEN = "s3cr!"
HOSTS = ["provider: simulated", "provider: linux", "provider: hyperv, connect: { ssh: stranger@example.org }"]


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkout of a stranger's repository, with data logs of its component, beside a folder that is none of its."""
    top = tmp_path_factory.mktemp("strangers")
    (top / "outside").mkdir()
    (top / "outside" / "secret.txt").write_text("secret", encoding="utf-8")
    (top / "outside" / "secret.txt").chmod(0o755)  # a program that could be started
    checkout = top / "checkout"
    (checkout / "components").mkdir(parents=True)
    (checkout / "components" / "seen.py").write_text("def work(): raise SystemExit('it ran')\n", encoding="utf-8")
    (checkout / "run.sh").write_text("#!/bin/sh\ntouch ran\n", encoding="utf-8")
    (checkout / "link.txt").symlink_to(top / "outside" / "secret.txt")
    subprocess.run(["git", "init", "-q", str(checkout)], check=True)
    written(checkout)
    assert rarms(checkout, "measure").returncode == 0
    assert rarms(checkout, "snapshot", "--out", "host.json").returncode == 0
    return checkout


def written(checkout: Path, host: str = HOSTS[0]) -> Path:
    file = checkout / "rarms.yaml"
    text = MANIFEST.replace("HOST", host).replace("OUTSIDE", str(checkout.parent / "outside"))
    file.write_text(text, encoding="utf-8")
    return file


def rarms(checkout: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "rarms_iac", *words], cwd=checkout, capture_output=True, text=True, check=False
    )


def watched(checkout: Path, *words: str) -> tuple[int, list[tuple[str, str]], list[str], str]:
    """Exit code, what happened but for Python's and rarms' own files, the variables that were read, and the output."""
    report = checkout.parent / "report.json"
    done = subprocess.run(
        [sys.executable, "-c", WATCHED, str(report), *words],
        cwd=checkout,
        env={**os.environ, "STRANGERS_TOKEN": TOKEN, "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert report.is_file(), done.stderr
    heard = json.loads(report.read_text(encoding="utf-8"))
    report.unlink()
    own = [os.path.realpath(folder) for folder in (sys.prefix, sys.base_prefix, Path(rarms_iac.__file__).parents[1])]
    own += [str(checkout), "/usr/share/zoneinfo", "/dev/null", os.path.realpath(report)]
    events = [(event, what) for event, what in heard["events"] if not what.startswith((*own, "<frozen"))]
    return heard["code"], [(event, what) for event, what in events if what], heard["read"], done.stdout + done.stderr


@pytest.mark.parametrize("host", HOSTS)
def test_looking_at_strangers_manifest_touches_nothing_of_ours(measured: Path, host: str) -> None:
    written(measured, host)

    for words in (
        ("validate", "."),
        ("plan", "--snapshot", "onboard=host.json", "--output", "markdown"),
    ):
        code, events, read, printed = watched(measured, *words)
        assert (code in {0, 2, 4}, events) == (True, [])
        assert ("STRANGERS_TOKEN" in read) == (words[0] == "validate") == ("RARMS345" in printed)
        assert TOKEN not in printed
    assert not (measured / "ran").exists()
    assert not (measured.parent / "outside" / "run").exists()


def test_a_program_that_is_started_would_be_noticed(measured: Path) -> None:
    written(measured)

    _, events, read, _ = watched(measured, "run", "vision", "--samples", "1")

    assert any(event.startswith(("subprocess", "os.")) for event, _ in events)
    assert "STRANGERS_TOKEN" in read


@pytest.mark.parametrize("name", ["rarms.yaml", "overlay.yaml", "other.json"])
def test_link_out_of_the_checkout_is_not_followed(measured: Path, name: str) -> None:
    outside = measured.parent / "outside" / name
    outside.write_text("password: hunter2\n", encoding="utf-8")
    written(measured)
    (measured / name).unlink(missing_ok=True)
    (measured / name).symlink_to(outside)
    more = {"overlay.yaml": ("--overlay", name), "other.json": ("--snapshot", f"onboard={name}")}

    done = rarms(measured, "plan", *more.get(name, ()))
    (measured / name).unlink()

    assert done.returncode in {1, 4}
    assert "a link that leads out of the repository" in " ".join(done.stderr.split())
    assert "hunter2" not in done.stdout + done.stderr


def test_host_without_snapshot_is_refused_unasked(measured: Path) -> None:
    file = written(measured)
    other = "  other: { provider: hyperv, connect: { ssh: a@example.org }, logical_processors: 2, memory: 4 GiB }"
    file.write_text(file.read_text(encoding="utf-8").replace("components:\n", f"{other}\ncomponents:\n", 1))

    refused, _, _, _ = watched(measured, "plan", "--snapshot", "onboard=host.json")
    _, events, _, _ = watched(measured, "plan", "--snapshot", "onboard=host.json", "--host", "onboard")

    assert (refused, events) == (64, [])
