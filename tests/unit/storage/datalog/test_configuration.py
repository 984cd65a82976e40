from pathlib import Path

from rarms_iac.storage.datalog.decisions import Chosen, Proven, ProvenIndex, append_entry, last_chosen, read_entries
from rarms_iac.storage.datalog.files import configuration_path
from tests.builders import at_most
from tests.builders_measured import a_bench, a_subject


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


def proven() -> Proven:
    return Proven(
        component="vision",
        when="2027-01-31T13:00:00Z",
        rarms_version="0",
        host="onboard",
        partition="vision",
        reserve=62,
        serial=3,
        beside=("speech",),
        indexes=(
            ProvenIndex(
                index="mean_response_time",
                threshold=at_most(100),
                value=97.5,
                lower=97.0,
                upper=98.0,
                met=True,
                verdict="met",
                error=0.01,
            ),
        ),
    )


def test_entries_read_back_and_the_last_choice_holds(tmp_path: Path) -> None:
    path = configuration_path(tmp_path, "onboard", "vision")
    for entry in (chosen(62), chosen(70), proven()):
        append_entry(path, entry)

    entries = read_entries(path)

    assert entries == (chosen(62), chosen(70), proven())
    assert last_chosen(entries) == chosen(70)
    assert last_chosen(()) is None
    assert read_entries(tmp_path / "none.jsonl") == ()
