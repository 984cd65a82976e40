"""What a server adds to the page: no text in any of its fields becomes markup."""

import socket
import time
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.app.requests import ManifestSource
from rarms_iac.app.status import NextCommand
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.model.commands import command
from rarms_iac.model.diagnostics import Place
from rarms_iac.providers.cgroups import provider
from rarms_iac.studio.actions import Workspace
from rarms_iac.studio.guard import LOOPBACK, bind
from rarms_iac.studio.knowledge import LOOK_SECONDS, Watch
from rarms_iac.studio.page import (
    BarPart,
    ComponentOnPage,
    HostOnPage,
    PlanOnPage,
    StudioOnPage,
    StudioSettings,
    page_of,
    render_studio,
)
from rarms_iac.texts.findings import Finding
from rarms_iac.views.table import Column, Table
from tests.needs import ON_WINDOWS
from tests.unit.views.reports.test_html import REPORT

NASTY = "</script></textarea></pre><script>alert(1)</script><img src=x onerror=alert(1)> \" ' & \u2028 {{ 7 * 7 }}"

PLAN = PlanOnPage(
    id="x",
    text="x",
    details="x",
    scripts=(("x", "x", "x", "x"),),
    command=command("x"),
    is_made_anew=False,
    can_be_applied=True,
    changed=("x",),
)
STUDIO = StudioOnPage(
    version="x",
    application="x",
    read_only=False,
    manifest_options="x",
    hosts=(
        HostOnPage(
            name="x",
            sentence="x",
            parts=(BarPart(kind="x", start="x", width="x", title="x"),),
            partitions=Table((Column("x"),), (("x",),)),
            problems=("x",),
            remark="x",
        ),
    ),
    components=(
        ComponentOnPage(name="x", criticality=1, apt=("x",), reserve="x", share="x", verdicts=("x",)),
    ),
    is_running=False,
    held="x",
    next_command=NextCommand(command=command("x"), reason="x"),
    unfinished=True,
    left_by_measurement=True,
    forms_by_verb={},
    plan=PLAN,
    plan_is_next=False,
    history=Table((Column("x"),), (("x",),)),
    can_undo=True,
    has_manifest=True,
)  # fmt: skip


def with_texts(value: Any, text: str) -> Any:
    """The value with this text in the place of each text in it."""
    if isinstance(value, str):
        return text
    if isinstance(value, tuple):
        return tuple(with_texts(each, text) for each in value)
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value, **{each.name: with_texts(getattr(value, each.name), text) for each in fields(value)})
    return value


@dataclass(slots=True)
class Content:
    """Elements with the names of their attributes, and all text."""

    elements: list[tuple[str, list[str]]]
    texts: list[str]


class Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.content = Content([], [])

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.content.elements.append((tag, [name for name, _ in attrs]))
        self.content.texts += [value for _, value in attrs if value]

    def handle_data(self, data: str) -> None:
        self.content.texts.append(data)


def content(text: str) -> Content:
    finding = Finding.error("RARMS999", "x").at(
        Place(file="x", line=1, column=1), "{_detail}", text, _detail=text, x=text
    )
    reader = Reader()
    reader.feed(render_studio(REPORT, (finding,), {"x": text}, with_texts(STUDIO, text)).decode())
    reader.close()
    return reader.content


def test_hostile_text_becomes_no_markup() -> None:
    plain, nasty = content("x"), content(NASTY)

    assert nasty.elements == plain.elements
    shown = NASTY.replace("\u2028", "<U+2028>")
    assert sum(shown in text for text in nasty.texts) > 60, "all of it is there to be read"
    assert not any("\u2028" in text for text in nasty.texts)


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

    assert (f"Read at {known.looked_at}." in page) == says
    assert ("Locks by other runs are not shown" in page) == says


def test_recently_used_port_is_taken() -> None:
    with bind(0) as first, socket.create_connection(first.getsockname()) as client:
        served, _ = first.accept()
        served.close()  # who closes first keeps the port for a minute
        assert client.recv(1) == b""
        port = first.getsockname()[1]

    with bind(port) as again:
        assert again.getsockname() == (LOOPBACK, port)


def test_a_port_that_another_program_has_is_refused() -> None:
    with bind(0) as other, pytest.raises(RequestError, match="cannot be used"):
        bind(other.getsockname()[1])


def test_only_windows_has_the_port_exclusively() -> None:
    with bind(0) as bound:
        assert bool(bound.getsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR)) is not ON_WINDOWS
        if ON_WINDOWS:
            assert bound.getsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE)  # type: ignore[attr-defined]
