from pathlib import Path

from rarms_iac.storage.datalog.decisions import Chosen, last_chosen, read_entries
from rarms_iac.storage.datalog.files import append_to_log, configuration_path
from tests.builders_measured import PROVEN, a_bench, a_subject


def chosen(reserve: int = 62) -> Chosen:
    return Chosen(
        component="vision",
        when="2027-01-31T12:00:00Z",
        rarms_version="0",
        apt={"mean_response_time": "at most 100 ms"},
        partition="vision",
        reserve=reserve,
        task="ObjectIdentification",
        data_log="measurements/onboard/vision/busy-loop.jsonl",
        identity="0" * 64,
        setup=a_subject().setup,
        platform_facts=a_bench(),
    )


def test_entries_read_back_and_the_last_choice_holds(tmp_path: Path) -> None:
    path = configuration_path(tmp_path, "onboard", "vision")
    for entry in (chosen(62), chosen(70), PROVEN):
        append_to_log(path, entry)

    entries = read_entries(path)

    assert entries == (chosen(62), chosen(70), PROVEN)
    assert last_chosen(entries) == chosen(70)
    assert last_chosen(()) is None
    assert read_entries(tmp_path / "none.jsonl") == ()
