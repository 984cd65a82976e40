"""What a server adds to the page: no text in any of its fields becomes markup."""

from dataclasses import dataclass, fields, is_dataclass, replace
from html.parser import HTMLParser
from typing import Any

from rarms_iac.app.status import NextCommand
from rarms_iac.model.commands import command
from rarms_iac.model.diagnostics import Finding, Place
from rarms_iac.studio.page import BarPart, ComponentOnPage, HostOnPage, StudioOnPage, render_studio
from rarms_iac.studio.plan_page import PlanOnPage
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
            partitions=(("x", "x", "x", "x"),),
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
    history=(("x",) * 7,),
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
