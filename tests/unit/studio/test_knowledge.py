"""What the page follows: the folder of the manifest, and hosts whose journal lies elsewhere."""

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from rarms_iac.app.requests import ManifestSource
from rarms_iac.providers.cgroups import provider
from rarms_iac.studio.actions import Workspace
from rarms_iac.studio.knowledge import LOOK_SECONDS, Watch
from rarms_iac.studio.page import StudioSettings, page_of

MANIFEST = """\
schema: rarms/v1
application: {{ name: cell }}
hosts:
  onboard: {{ {host}, logical_processors: 2, memory: 4 GiB }}
components:
  control: {{ criticality: 1, memory: 512 MiB, cpu: {{ reserve: 30 % }} }}
"""


def watch_of(folder: Path, host: str, now: Callable[[], float] = time.monotonic) -> Watch:
    (folder / "rarms.yaml").write_text(MANIFEST.format(host=host), encoding="utf-8", newline="\n")
    watch = Watch(ManifestSource(manifest=str(folder)), now)
    watch.knowledge()
    return watch


@pytest.mark.needs("linux")
def test_local_linux_run_is_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(provider, "STATE_FOLDER", tmp_path / "state")
    watch = watch_of(tmp_path, "provider: linux, linux: { slice: cell }")
    before = watch.version(is_running=False)

    journal = tmp_path / "state" / "cell" / "journal.jsonl"
    journal.parent.mkdir(parents=True)
    journal.write_text("{}\n", encoding="utf-8")

    assert watch.version(is_running=False) != before
    assert watch.version(is_running=False) == watch.version(is_running=False)


def test_distant_host_is_polled_when_idle(tmp_path: Path) -> None:
    now = [1000.0]
    watch = watch_of(tmp_path, "provider: linux, connect: { ssh: robot@robot.invalid }", lambda: now[0])
    before = watch.version(is_running=False)

    now[0] += 2 * LOOK_SECONDS
    assert watch.version(is_running=True) == before
    assert watch.version(is_running=False) != before


def test_simulated_host_is_followed_by_file(tmp_path: Path) -> None:
    now = [1000.0]
    watch = watch_of(tmp_path, "provider: simulated", lambda: now[0])
    before = watch.version(is_running=False)

    now[0] += 2 * LOOK_SECONDS
    assert watch.version(is_running=False) == before


@pytest.mark.parametrize(
    ("host", "says"),
    [
        ("provider: linux, connect: { ssh: robot@robot.invalid }", True),
        ("provider: simulated", False),
    ],
)
def test_page_says_when_host_was_asked(tmp_path: Path, host: str, says: bool) -> None:
    known = watch_of(tmp_path, host).knowledge()
    source = ManifestSource(manifest=str(tmp_path))
    settings = StudioSettings(source=source)

    page = page_of(known, Workspace(source=source), settings, version="", is_running=False).decode()

    assert (f"Asked at {known.looked_at}." in page) == says
    assert ("whether another run holds this host is not seen" in page) == says
