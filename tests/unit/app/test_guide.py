import json
from pathlib import Path

from tests.unit.app.test_data_logs import MEANS, edit, here, measure
from tests.unit.cli.running import rarms
from tests.unit.views.test_json import check

__all__ = ["here"]


def test_guide_says_what_to_set_in_order(here: Path) -> None:
    measure(here, MEANS)
    edit(here / "rarms.yaml", "    memory: 512 MiB\n", "    memory: 512 MiB\n    task: ObjectIdentification\n")
    measure(here, MEANS)

    answer = rarms("explain", "vision", "--guide", "-f", str(here))

    assert answer.code == 0, answer.err
    hyperv = [answer.out.index(word) for word in ("Stop-VM", "-ProcessorCount 2", "-Reserve 62", "Start-VM")]
    assert hyperv == sorted(hyperv)
    assert "`Priority = " in answer.out
    assert "`Scheduling Category = Medium (sz)`" in answer.out
    assert 'AvSetMmThreadCharacteristics("ObjectIdentification")' in answer.out
    assert "echo 124 > /sys/fs/cgroup/rarms.slice/vision/cpu.weight" in answer.out
    assert "exec python3 vision.py" in answer.out
    assert "mean_response_time at most 100 ms" in answer.out
    assert max(map(len, answer.lines)) <= 130


def test_fixed_reserve_and_limit_have_guide_too(here: Path) -> None:
    edit(here / "rarms.yaml", "    memory: 512 MiB\n", "    memory: 512 MiB\n    cpu: { reserve: 40 %, limit: 50 % }\n")

    answer = rarms("explain", "vision", "--guide", "-f", str(here))
    facts = rarms("explain", "vision", "--guide", "--json", "-f", str(here)).out

    check(facts)
    assert (json.loads(facts)["reserve"], json.loads(facts)["limit"]) == (40, 50)
    assert "as the manifest fixes it" in answer.out
    assert "echo '10000 10000'" in answer.out, "half of two processors in each period of a tenth of 100 ms"
    assert "nothing is to be set" in answer.out


def test_no_guide_without_log_or_component(here: Path) -> None:
    assert rarms("explain", "vision", "--guide", "-f", str(here)).code == 4
    unknown = rarms("explain", "visoin", "--guide", "-f", str(here))
    assert unknown.code == 64
    assert 'Did you mean "vision"?' in " ".join(unknown.err.split())


def test_guide_without_program_invents_no_words(here: Path) -> None:
    program = "    run:\n      command: [python3, vision.py]\n      until: { samples: 200 }\n"
    edit(here / "rarms.yaml", program, "    processors: 1\n    cpu: { reserve: 40 % }\n")

    answer = rarms("explain", "vision", "--guide", "-f", str(here))

    assert "gets 0.8 LP (80 % of its 1 VP),\n" in answer.out
    assert "have vision start with Windows.\n" in answer.out
    assert "exec COMMAND'`, with what starts vision in place of COMMAND.\n" in answer.out
