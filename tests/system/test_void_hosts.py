"""Hosts that cannot be believed, or that would not keep what is planned: said instead of planned."""

from pathlib import Path

import pytest

from tests.unit.cli.running import Ran, rarms

PROVIDER = "provider: simulated  # needs no installation; or hyperv, or linux"
ACCEPTED = """\
policy:
  accept:
    RARMS159: { at: [host/onboard], reason: nothing has to answer in time }
"""


class Desk:
    """A folder with the manifest of `init`, whose host is described again for every command."""

    def __init__(self, folder: Path) -> None:
        assert rarms("init", str(folder), "--name", "desk").code == 0
        self.manifest = folder / "rarms.yaml"
        self.text = self.manifest.read_text(encoding="utf-8")
        assert PROVIDER in self.text

    def run(self, *words: str, host: str = "", policy: str = "policy:\n") -> Ran:
        described = PROVIDER + (f"\n    simulated: {{ {host} }}" if host else "")
        text = self.text.replace(PROVIDER, described).replace("policy:\n", policy)
        self.manifest.write_text(text, encoding="utf-8", newline="\n")
        return rarms(words[0], "-f", str(self.manifest), *words[1:])


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path)


@pytest.mark.parametrize(
    "words",
    [("plan",), ("drift",), ("apply", "--auto-approve"), ("destroy", "--auto-approve"), ("undo", "--auto-approve")],
)
def test_unseen_is_not_believed_gone(desk: Desk, words: tuple[str, ...]) -> None:
    assert desk.run("apply", "--auto-approve").code == 0

    blind = desk.run(*words, host="administrator: false")

    assert blind.code == 1
    assert "error[RARMS158]" in blind.err
    assert desk.run("plan").code == 0, "nothing was begun"


def test_unseen_run_is_not_continued(desk: Desk) -> None:
    fault = 'faults: { broken: { operation: start_partition, at: "*", effect: refuse, times: 1 } }'
    assert desk.run("apply", "--auto-approve", host=fault).code == 1

    blind = desk.run("apply", host="administrator: false")

    assert blind.code == 1
    assert "error[RARMS158]" in blind.err
    assert desk.run("apply").code == 0
    assert desk.run("plan").code == 0


@pytest.mark.parametrize("host", ["scheduler: root", "scheduler: unknown, client: true"])
def test_reserves_without_effect_are_not_planned(desk: Desk, host: str) -> None:
    refused = desk.run("plan", host=host)

    assert refused.code == 4
    assert "error[RARMS159]" in refused.err
    assert "control, display" in refused.err
    assert desk.run("plan", host=host, policy=ACCEPTED).code == 0
    assert desk.run("apply", "--auto-approve", host=host, policy=ACCEPTED).code == 0
    assert desk.run("destroy", "--auto-approve", host=host).code == 0, "to let go needs no reserve"


def test_where_reserves_count_nothing_has_to_be_accepted(desk: Desk) -> None:
    told = desk.run("plan", host="scheduler: core", policy=ACCEPTED)

    assert told.code == 0
    assert "RARMS159 does not occur at host/onboard" in told.out + told.err
