"""The glossary has a line for every word that the project agreed on."""

import re
from pathlib import Path

import pytest

GLOSSARY = Path(__file__).parents[2] / "docs" / "glossary.md"
WORDS = """CoI|compound CoI|PI|APT|criticality|interfering load|partition|CR|LP|component
compute_minimum_cpu_reservation
combine_components|tune_performance_to_use_less_resource|manifest|desired|observed|resource|address|provider|action
change|step|plan|drift|apply|journal|data log|configuration log|overlay|layout|disruption|mark|serial|setting|platform
finding|diagnostic|acceptance|task class|reserve|limit|weight|snapshot|undo|lock|curve|RC SS|MMCSS"""


def entries() -> dict[str, str]:
    """The words in the first column, each with its meaning."""
    rows = re.findall(r"^\| (.+?) \| (.+) \|$", GLOSSARY.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {
        word.strip("` "): message
        for words, message in rows
        for word in re.split(r", | \(|\)", words)
        if words != "word"
    }


@pytest.mark.parametrize("word", re.split(r"[|\n]", WORDS))
def test_a_word_that_we_use_is_explained(word: str) -> None:
    assert len(entries()[word]) > 15


def test_no_word_is_explained_twice() -> None:
    first = re.findall(r"^\| (.+?) \|", GLOSSARY.read_text(encoding="utf-8"), flags=re.MULTILINE)
    words = [word for word in first if word not in {"word", "---"}]

    assert sorted(set(words)) == sorted(words)
