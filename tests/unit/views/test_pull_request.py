"""The comment of a pull request."""

import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import pytest

from rarms_iac.app.pull_request import PlanReview
from rarms_iac.model.diagnostics import Finding, Place, Severity
from rarms_iac.model.host import ProviderKind
from rarms_iac.views.markdown import findings_markdown
from rarms_iac.views.pull_request import LONGEST_COMMENT, failure_comment, marker
from rarms_iac.views.pull_request import comment as comment_of
from tests.builders_plan import a_rich_plan
from tests.files import copy_files
from tests.fleet import manifest as fleet
from tests.needs import require
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


def test_the_comment_begins_with_its_marker_and_tells_the_risk_first(applied: Path) -> None:
    text = comment(manifest(applied, vision="30 %", memory="512 MiB", processors=2))

    assert text.splitlines()[0] == marker(str(applied))
    heads = re.findall("^#### (.*)$", text, re.MULTILINE)
    assert heads[:2] == ["Risk", "Taking it back"]
    assert "**Stops:** vision on onboard, for at most 45 s of shutdown, and then as long as its start takes" in text
    assert "- The undo stops vision again, for as long as above." in text
    assert "reserve 1.6 LP → 1.2 LP, limit 4 LP → 2 LP, memory 1 GiB → 512 MiB" in text
    assert (
        "| `~` | vision | onboard | 1.6 LP (40 % of onboard) | 1.2 LP (30 % of onboard) "
        "| 1 GiB | 512 MiB | processors 4 → 2" in text
    )


def test_what_stops_comes_before_what_shrinks_and_a_weight_is_no_risk(applied: Path) -> None:
    both = manifest(applied, processors=2).joinpath("rarms.yaml")
    shrunk = both.read_text(encoding="utf-8").replace("reserve: 20 %", "reserve: 10 %, weight: 50")
    both.write_text(shrunk, encoding="utf-8", newline="\n")

    text = comment(applied)

    assert re.findall(r"\*\*(Stops|Shrinks):\*\* (\S+)", text) == [
        ("Stops", "vision"),
        ("Shrinks", "partition/speech"),
        ("Shrinks", "partition/vision"),
    ]
    assert "reserve 0.8 LP → 0.4 LP.\n" in text
    assert re.search(r"speech .* weight \d+ → 50 \|$", text, re.MULTILINE)


def test_steps_are_numbered_by_host(tmp_path: Path) -> None:
    two = manifest(tmp_path / "two").joinpath("rarms.yaml")
    hosts = f"{HOST}  second: {{ logical_processors: 1, memory: 2 GiB }}\n"
    more = "  panel: { criticality: 1, memory: 1 GiB, cpu: { reserve: 5 % }, hosts: [second] }\npartitions:"
    text = two.read_text(encoding="utf-8").replace(HOST, hosts).replace("partitions:", more)
    two.write_text(text, encoding="utf-8", newline="\n")

    steps = comment(two.parent).partition("in order</summary>")[2]

    assert re.findall(r"^(Host .*|1\. \S+)", steps, re.MULTILINE) == [
        "Host onboard",
        "1. partition/vision:",
        "Host second",
        "1. partition/panel:",
    ]


def test_a_host_as_wanted_has_nothing_at_risk(applied: Path) -> None:
    assert "Nothing changes on the hosts." in comment(applied)


def test_scripts_are_compared_with_those_of_the_base(
    applied: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    copy_files(applied, tmp_path / "base" / "head")
    manifest(tmp_path / "base" / "head", vision="35 %")
    manifest(applied, vision="30 %")

    text = comment(Path("head"), "--base", "base")

    assert "<details><summary>What changed in the scripts</summary>" in text
    assert re.search(r"~ partition/vision, step 1: ", text)
    assert "there was nothing to compare" not in text
    assert "- Nothing stops.\n- **Shrinks:** partition/vision" in text


def test_a_base_without_a_manifest_is_said(applied: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "base").mkdir()

    assert "the base has no manifest" in comment(manifest(applied, vision="30 %"), "--base", "base")


def test_the_comment_of_a_large_plan_is_short_enough(tmp_path: Path) -> None:
    (tmp_path / "rarms.yaml").write_text(fleet(400), encoding="utf-8")

    text = comment(tmp_path)

    assert 10_000 < len(text) < LONGEST_COMMENT
    assert "more partitions: `rarms plan` shows all" in text
    assert text.count("<details>") == text.count("</details>")
    assert text.count("```") % 2 == 0


HOSTILE = "```</details>` @everyone <!-- --> ![x](http://x) | `code\n### head"


def test_what_a_stranger_wrote_stays_text() -> None:
    finding = Finding(code="RARMS999", severity=Severity.ERROR, summary=HOSTILE)
    place = Place(file="a`b|c.yaml", line=1, column=1)

    text = failure_comment(HOSTILE, [finding.at(place, HOSTILE, HOSTILE, values={})] * 500)

    assert len(text) < LONGEST_COMMENT
    assert text.splitlines()[0].count("-->") == 1
    body = re.sub("(?<![\\\\`])`[^`\n]+`", "code", text.split("\n", 1)[1])
    body = re.sub("(?<=&#64;|http:)<!-- -->", "", body)
    for begun in ("</details>", "@everyone", "<!--", "![x]"):
        assert begun not in body
    assert [line for line in body.splitlines() if line.startswith("### ")] == ["### rarms plan: there is none"]


ADDRESSES = "https://a.example/x HTTP://a.example www.a.example ftp://a.example me@a.example xmpp:me@a.example"


def test_addresses_in_names_are_no_links() -> None:
    """By the renderer that GitHub uses; GitHub links `@person` and `#1` in the page that comes out of it."""
    require("cmarkgfm")
    import cmarkgfm
    from cmarkgfm import cmark

    finding = Finding(code="RARMS999", severity=Severity.ERROR, summary=f"Not {ADDRESSES}")
    place = Place(file="www.a.example/me@a.example.yaml", line=1, column=1)

    text = findings_markdown([finding.at(place, f"see {ADDRESSES} @person #1", "", values={})])
    page = cmarkgfm.github_flavored_markdown_to_html(text, cmark.Options.CMARK_OPT_UNSAFE)

    assert "<a " not in page
    assert unescape(re.sub("<!-- -->", "", page)).count(ADDRESSES) == 2
    assert not re.search("@person|#1", unescape(page))


def test_findings_alone_are_a_list() -> None:
    note = Finding(code="RARMS086", severity=Severity.NOTE, summary="Not used").at(None, "x", "y", values={})

    assert findings_markdown([]) == "No findings.\n"
    assert "- **note RARMS086** Not used: x y" in findings_markdown([note])


def test_without_a_plan_every_form_says_why(tmp_path: Path) -> None:
    folder = manifest(tmp_path, vision="90 %")
    sarif = tmp_path / "plan.sarif"

    answer = rarms("plan", "-f", str(folder), "--output", "markdown", "--output", f"sarif={sarif}")

    assert answer.code == 4
    assert "**error RARMS014**" in answer.out
    assert "RARMS014" in sarif.read_text(encoding="utf-8")
    assert "error[RARMS014]" in answer.err


@pytest.mark.parametrize("provider", [ProviderKind.HYPERV, ProviderKind.LINUX])
def test_a_host_without_scripts_has_no_sentence_about_them(provider: ProviderKind) -> None:
    rich = a_rich_plan()
    hosts = tuple(replace(part, host=replace(part.host, provider=provider)) for part in rich.hosts)
    review = PlanReview(
        plan=replace(rich, hosts=hosts),
        headrooms=(),
        logs=(),
        scripts={},
        new_scripts=(),
        without_base="none",
    )

    assert ("Scripts are not compared" in comment_of(review)) == (provider is ProviderKind.HYPERV)
