"""Every number that is read from a file or a host has a range, and nothing beyond it is read."""

import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any, NewType, get_args, get_type_hints

import pytest

from rarms_iac.model.journal import RunClosed, RunStarted, ScriptStarted, StepRecorded
from rarms_iac.model.series import Sample
from rarms_iac.model.setting import Setting, SettingEvidence
from rarms_iac.model.state import State
from rarms_iac.providers.hyperv.observation import HostObservation
from rarms_iac.providers.simulated.content import Content
from rarms_iac.storage.codec import NotDecodable, decoder_of_field, has_numbers
from rarms_iac.storage.datalog.decisions import Chosen, Proven, TuningRun
from rarms_iac.storage.datalog.log import Header, Provenance, Remeasurement
from rarms_iac.storage.plan_file import PlanFile
from rarms_iac.storage.ranges import RANGES, range_of

READ = (
    *(State, PlanFile, RunStarted, StepRecorded, RunClosed, ScriptStarted, HostObservation, Content),
    *(Header, Provenance, Remeasurement, SettingEvidence, Chosen, Proven, TuningRun),
    Sample,
)
"""The types of what is read; the samples of a data log have a reader of their own, those from a robot do not."""


def records_in(hint: Any, known: dict[type, None]) -> None:
    while isinstance(hint, NewType):
        hint = hint.__supertype__
    if isinstance(hint, type) and is_dataclass(hint):
        if hint not in known:
            known[hint] = None
            for inner in get_type_hints(hint).values():
                records_in(inner, known)
        return
    for argument in get_args(hint):
        records_in(argument, known)


@cache
def numbers() -> tuple[tuple[str, str, Any], ...]:
    known: dict[type, None] = {Setting: None}
    for record in READ:
        records_in(record, known)
    return tuple(
        (record.__name__, part.name, hint)
        for record in known
        if is_dataclass(record) and record is not HostObservation  # a probe of it is read by its own type
        for part in fields(record)
        if has_numbers(hint := get_type_hints(record)[part.name])
    )


def test_every_range_belongs_to_a_read_number() -> None:
    names = {name for record, field, _ in numbers() for name in (field, f"{record}.{field}")}

    assert set(RANGES) <= names
    assert len(numbers()) > 100


def documents(number: float) -> Iterator[Any]:
    yield from (number, [number], {"x": number}, [[number]], {"x": [number]})


@pytest.mark.parametrize(("record", "name", "hint"), numbers())
def test_a_number_just_beyond_its_range_is_refused(record: str, name: str, hint: Any) -> None:
    least, most = range_of(record, name)
    read = decoder_of_field(record, name, hint)
    for number in (least - 1, most + 1, most * 2):
        if abs(number) == float("inf"):
            continue
        messages = []
        for document in documents(number):
            with pytest.raises(NotDecodable) as refused:
                read(document, name)
            messages.append(str(refused.value))
        assert any(re.search("is not between .* and |more than 64 bits", message) for message in messages)
