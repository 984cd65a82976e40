"""What a plan says of its choice of hosts: in its text, in its JSON and in its sealed file."""

import json
from pathlib import Path

import pytest

from rarms_iac.planner.certifying.checker import check as check_certificate
from rarms_iac.storage.plan_file import read_plan
from tests.unit.cli.running import rarms
from tests.unit.views.test_json import check

HOST = """\
  {name}:
    provider: simulated
    logical_processors: 1
    memory: 1 GiB
"""
COMPONENT = """\
  {name}:
    criticality: 1
    run: {{ command: [python3, "{name}.py"], samples: {{ from: per_run }}, until: {{ samples: 20 }} }}
    memory: 64 MiB
    cpu: {{ reserve: {reserve} % }}
    processors: 1
"""
CERTIFIED = "The choice of hosts is proved and certified"


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    hosts = "".join(HOST.format(name=name) for name in ("one", "three", "two"))
    reserves = {"a": 60, "b": 50, "c": 40, "d": 30, "e": 20}
    components = "".join(COMPONENT.format(name=name, reserve=share) for name, share in reserves.items())
    text = f"schema: rarms/v1\n\napplication:\n  name: fleet\n\nhosts:\n{hosts}\ncomponents:\n{components}"
    (tmp_path / "rarms.yaml").write_text(text, encoding="utf-8", newline="\n")
    return tmp_path


def test_a_certificate_is_in_the_json_and_in_the_sealed_plan(fleet: Path) -> None:
    answer = rarms("plan", "--json", "-f", str(fleet), "--out", str(fleet / "plan.json"))

    check(answer.out)
    told = json.loads(answer.out)["placement"]
    sealed = read_plan((fleet / "plan.json").read_bytes()).placement
    assert sealed is not None
    assert told["verdict"] == sealed.verdict == "optimal"
    assert told["certificate"] == sealed.certificate
    certificate = json.loads(sealed.certificate)
    check_certificate(certificate["problem"], certificate["claim"])


def test_plan_show_and_explain_say_that_it_is_certified(fleet: Path) -> None:
    planned = rarms("plan", "-f", str(fleet), "--out", str(fleet / "plan.json"))
    shown = rarms("show", str(fleet / "plan.json"))
    explained = rarms("explain", "a", "-f", str(fleet))

    for answer in (planned, shown, explained):
        assert CERTIFIED in " ".join(answer.out.split()), answer.err


@pytest.mark.parametrize("more", [60, 25], ids=["more than there is", "no way to lay them out"])
def test_what_does_not_fit_is_certified_in_the_json_of_the_refusal(fleet: Path, more: int) -> None:
    """Of 60, 50, 40, 30 and 20 % on two hosts, 60 more are too much; on three hosts nothing takes 55 % four times."""
    text = (fleet / "rarms.yaml").read_text(encoding="utf-8")
    if more == 60:
        text = text.replace(HOST.format(name="three"), "") + COMPONENT.format(name="f", reserve=more)
    else:
        for share in (60, 50, 40, 30):
            text = text.replace(f"reserve: {share} %", "reserve: 55 %")
    (fleet / "rarms.yaml").write_text(text, encoding="utf-8", newline="\n")

    answer = rarms("plan", "--json", "-f", str(fleet))

    assert answer.code == 4
    check(answer.out)
    certificate = json.loads(json.loads(answer.out)["certificate"])
    assert set(certificate["claim"]) == {"impossible"}
    check_certificate(certificate["problem"], certificate["claim"])
