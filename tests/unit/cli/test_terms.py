"""One table of terms (docs/glossary.md): an amount is in LPs, and a per cent says what it is a share of."""

import json
import re
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path

import pytest

from rarms_iac.storage.shipped import shipped
from tests.robots import a_measured, a_robot_of
from tests.unit.cli.running import rarms

MANIFEST = a_robot_of(
    a_measured(processors=1, simulation="work: 13 ms, varies: 2 %"),
    "  speech: { criticality: 1, memory: 256 MiB, cpu: { reserve: 20 % }, processors: 2 }\n",
    name="drone",
    hosts="onboard: { logical_processors: 2, memory: 4 GiB, keep_for_host: { processor: 10 % } }",
)

NOUNS = (
    "its VPs",
    "its 1 VP",
    "its 2 VPs",
    "each VP",
    "each of its VPs",
    "each of 2 processors",
    "its processor",
    "each)",  # of the processors in a column beside it
    "them",
    "the partition's VPs",
    "onboard",
    "host",
    "the threshold",
)
"""What a share of processors may be of, as docs/glossary.md lists it."""

BARE = re.compile(r"\d ?%(?! sure| confidence| of (?:" + "|".join(map(re.escape, NOUNS)) + r"))")

VIEWS = (
    "plan",
    "plan --verbose",
    "plan --output markdown",
    "status",
    "select vision --at 50ms",
    "explain vision",
    "graph",
    "report --out -",
    "show --script drone.plan",
    "show drone.plan",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A drone whose one component was measured, and its plan in a file."""
    made = tmp_path_factory.mktemp("drone")
    (made / "rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    with chdir(made):
        assert rarms("measure").code == 0
        assert rarms("plan", "--out", "drone.plan").code == 0
        yield made


@pytest.mark.parametrize("words", VIEWS)
def test_per_cent_says_of_what_it_is_share(words: str, folder: Path) -> None:
    answer = rarms(*words.split())

    assert answer.code == 0, answer.err
    text = " ".join(_without_drawings(answer.out).split())
    assert "LP" in text or words.startswith("show --script")
    assert [text[max(0, found.start() - 40) : found.end() + 30] for found in BARE.finditer(text)] == []


def _without_drawings(page: str) -> str:
    """A page without its style, script, drawings and sizes: what is read."""
    read = re.sub(r"<(style|script|svg)\b.*?</\1>", "", page, flags=re.DOTALL)
    return re.sub(r"<[^>]*>", " ", read) if read != page else page


def test_measure_says_lps_and_share_with_its_noun(folder: Path) -> None:
    out = rarms("measure", "-v").out

    assert re.search(r"vision +mean <= 50 ms +[\d.]+ ms +0\.\d+ LP [^:]*vision: \d+ % of its 1 VP", out)
    assert not BARE.search(out)


def test_json_reserve_is_percent_and_lp_are_lps(folder: Path) -> None:
    found = 0
    for words in ("plan", "status", "report", "explain vision", "select vision --at 50ms"):
        for fields in _objects(json.loads(rarms(*words.split(), "--json").out)):
            reserve = fields.get("reserve")
            if isinstance(reserve, int):
                assert 0 <= reserve <= 100
            processors = fields.get("processors")
            if isinstance(reserve, int) and isinstance(processors, int) and "reserved_lp" in fields:
                assert fields["reserved_lp"] == pytest.approx(reserve * processors / 100)
                found += 1
    assert found


def _objects(value: object) -> Iterator[dict[str, object]]:
    if isinstance(value, dict):
        yield value
        for each in value.values():
            yield from _objects(each)
    elif isinstance(value, list):
        for each in value:
            yield from _objects(each)


def test_the_glossary_lists_the_nouns() -> None:
    glossary = shipped("docs/glossary.md").read_text(encoding="utf-8")
    table = glossary.partition("## How amounts are written")[2].partition("\n## ")[0]

    for written in ("`0.26 LP`", "`26 % of its 1 VP`", "`13 % of onboard`", "`70 % of host`", "`reserve`", "`..._lp`"):
        assert written in table
