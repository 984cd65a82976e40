"""Hosts and components are listed as a reader counts: h2 before h10."""

import re
from pathlib import Path

import pytest

from tests.unit.cli.running import rarms

HOSTS = "".join(f"  h{number}: {{ logical_processors: 1, memory: 1 GiB }}\n" for number in (10, 2, 1))
COMPONENTS = "".join(
    f"  c{number}: {{ criticality: 5, memory: 64 MiB, hosts: [h{host}], cpu: {{ reserve: 0.1 LP }} }}\n"
    for host in (1, 2, 10)
    for number in (host * 100 + 10, host * 100 + 2, host * 100 + 1)
)


@pytest.mark.parametrize(
    "words", [["plan"], ["apply", "--auto-approve"], ["status"], ["history"], ["doctor"], ["graph"]]
)
def test_no_list_has_a_10_before_a_2(words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = f"schema: rarms/v1\napplication: {{ name: robot }}\nhosts:\n{HOSTS}components:\n{COMPONENTS}"
    Path("rarms.yaml").write_text(text, encoding="utf-8")

    shown = rarms(*words).out

    hosts = list(dict.fromkeys(re.findall(r"\bh(1|2|10)\b", shown)))
    components = list(dict.fromkeys(re.findall(r"\bc(\d+)\b", shown)))
    assert hosts == sorted(hosts, key=int)
    assert len(hosts) == 3
    assert components == sorted(components, key=int)
