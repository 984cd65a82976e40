"""The comment of a pull request."""

import re
from html import unescape
from pathlib import Path

import pytest

from rarms_iac.model.diagnostics import Place, Severity
from rarms_iac.texts.findings import Finding
from rarms_iac.views.markdown import LONGEST_COMMENT, failure_comment, findings_markdown, marker
from tests.needs import require
from tests.robots import fleet_manifest
from tests.unit.cli.running import rarms

HEAD = "schema: rarms/v1\napplication: { name: cell }\n"
HOST = "hosts:\n  onboard: { logical_processors: 4, memory: 8 GiB }\n"


def manifest(folder: Path, vision: str = "40 %", memory: str = "1 GiB", processors: int = 4, more: str = "") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "rarms.yaml"
    file.write_text(
        f"{HEAD}{HOST}components:\n"
        f"  vision: {{ criticality: 3, memory: {memory}, processors: {processors}, cpu: {{ reserve: {vision} }} }}\n"
        "  speech: { criticality: 2, memory: 1 GiB, cpu: { reserve: 20 % } }\n"
        f"partitions:\n  vision: {{ stop: {{ grace: 45 s }} }}\n{more}",
        encoding="utf-8",
        newline="\n",
    )
    return folder


def comment(folder: Path, *more: str) -> str:
    return rarms("plan", "-f", str(folder), "--output", "markdown", *more).out


@pytest.fixture
def applied(tmp_path: Path) -> Path:
    folder = manifest(tmp_path / "head")
    assert rarms("apply", "-f", str(folder), "--auto-approve").code == 0
    return folder


def test_a_comment_has_the_changes_in_a_table(applied: Path) -> None:
    text = comment(manifest(applied, vision="30 %", memory="512 MiB", processors=2))

    assert text.splitlines()[0] == marker(str(applied))
    assert (
        "| onboard | \\~ vision | 1.6 LP -> 1.2 LP | 1 GiB -> 512 MiB "
        "| processors 4 -> 2; stopped for up to 45 s to shut down, then for its start |"
    ) in unescape(text)
    assert "- onboard: Afterwards: 2 LP of 4 LP reserved" in text
    assert "**Plan: 0 to add, 1 to change, 0 to remove.**" in text


def test_a_host_as_wanted_has_no_table(applied: Path) -> None:
    text = comment(applied)

    assert "**No changes. The host is as in the manifest.**" in text
    assert "|---|" not in text


def test_comment_of_large_plan_is_short_enough(tmp_path: Path) -> None:
    (tmp_path / "rarms.yaml").write_text(fleet_manifest(400), encoding="utf-8")

    text = comment(tmp_path)

    assert 10_000 < len(text) < LONGEST_COMMENT
    assert "more changes: `rarms plan` shows all" in text
    assert text.count("<details>") == text.count("</details>")
    assert text.count("```") % 2 == 0


HOSTILE = "```</details>` @everyone <!-- --> ![x](http://x) | `code\n### head"


def test_what_a_stranger_wrote_stays_text() -> None:
    finding = Finding(code="RARMS999", severity=Severity.ERROR, summary=HOSTILE)
    place = Place(file="a`b|c.yaml", line=1, column=1)

    text = failure_comment(HOSTILE, [finding.at(place, "{_detail}", HOSTILE, _detail=HOSTILE)] * 500)

    assert len(text) < LONGEST_COMMENT
    assert text.splitlines()[0].count("-->") == 1
    body = re.sub("(?<![\\\\`])`[^`\n]+`", "code", text.split("\n", 1)[1])
    body = re.sub("(?<=&#64;|http:)<!-- -->", "", body)
    for begun in ("</details>", "@everyone", "<!--", "![x]"):
        assert begun not in body
    assert [line for line in body.splitlines() if line.startswith("### ")] == ["### rarms plan: not possible"]


ADDRESSES = "https://a.example/x HTTP://a.example www.a.example ftp://a.example me@a.example xmpp:me@a.example"


def test_addresses_in_names_are_no_links() -> None:
    """By the renderer that GitHub uses; GitHub links `@person` and `#1` in the page that comes out of it."""
    require("cmarkgfm")
    import cmarkgfm
    from cmarkgfm import cmark

    finding = Finding(code="RARMS999", severity=Severity.ERROR, summary=f"Not {ADDRESSES}")
    place = Place(file="www.a.example/me@a.example.yaml", line=1, column=1)

    text = findings_markdown([finding.at(place, "{_detail}", "", _detail=f"see {ADDRESSES} @person #1")])
    page = cmarkgfm.github_flavored_markdown_to_html(text, cmark.Options.CMARK_OPT_UNSAFE)

    assert "<a " not in page
    assert unescape(re.sub("<!-- -->", "", page)).count(ADDRESSES) == 2
    assert not re.search("@person|#1", unescape(page))


def test_findings_alone_are_a_list() -> None:
    note = Finding(code="RARMS086", severity=Severity.NOTE, summary="Not used").at(None, "x", "y")

    assert findings_markdown([]) == "No findings.\n"
    assert "- **note RARMS086** Not used: x y" in findings_markdown([note])


def test_list_in_a_finding_keeps_its_lines() -> None:
    note = Finding(code="RARMS014", severity=Severity.ERROR, summary="Too much").at(None, "One of:\n  - a\n  - b", "")

    assert findings_markdown([note]).strip().endswith("Too much: One of:<br>- a<br>- b")


def test_without_a_plan_every_form_says_why(tmp_path: Path) -> None:
    folder = manifest(tmp_path, vision="90 %")
    sarif = tmp_path / "plan.sarif"

    answer = rarms("plan", "-f", str(folder), "--output", "markdown", "--output", f"sarif={sarif}")

    assert answer.code == 4
    assert "**error RARMS014**" in answer.out
    assert "RARMS014" in sarif.read_text(encoding="utf-8")
    assert "error[RARMS014]" in answer.err
