from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.model.changes import Address
from rarms_iac.model.journal import RunStarted
from rarms_iac.model.operations import RemovePartition
from rarms_iac.model.plan import Step
from rarms_iac.model.state import State
from rarms_iac.providers.journaled import journal_in
from rarms_iac.storage.append import sealed_line
from rarms_iac.storage.codec import NotDecodable, encode
from tests.builders_plan import facts
from tests.contracts.runs import a_run, a_step

RUN = a_run(State(facts=facts("onboard")))
FORGED = [
    replace(a_step(0), address=Address(partition="../vision")),
    replace(a_step(0), operation=RemovePartition(partition="../vision")),
    replace(a_step(0), address=Address(partition="vision", task="..\\Windows")),
]


def journal_of(run: RunStarted) -> bytes:
    record = encode(run)
    assert isinstance(record, dict)
    return sealed_line(record)


def test_a_journal_reads_back() -> None:
    journal = journal_in(journal_of(RUN), Path("journal.jsonl"))

    assert journal is not None
    assert journal.started == RUN


@pytest.mark.parametrize("step", FORGED, ids=["address", "operation", "task"])
def test_journal_with_impossible_name_is_damaged(step: Step) -> None:
    forged = replace(RUN, steps=(step, *RUN.steps[1:]))

    with pytest.raises(NotDecodable, match="no manifest can give the name"):
        journal_in(journal_of(forged), Path("journal.jsonl"))
