import json
from dataclasses import dataclass
from fractions import Fraction

from rarms_iac.model.changes import Address
from rarms_iac.model.output import Internal, OpenBound, output
from rarms_iac.storage.codec import encode_output
from scripts.schema_of_types import output_schema_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """An answer."""

    address: Address
    amount: Fraction
    upper: OpenBound
    secret: Internal[str] = "secret"

    @property
    def unmarked(self) -> int:
        return 1

    @output
    def double(self) -> Fraction:
        return 2 * self.amount


ANSWER = Answer(address=Address(partition="vision"), amount=Fraction(1, 4), upper=float("inf"))


def test_result_is_its_fields_and_its_marked_properties() -> None:
    assert encode_output(ANSWER) == {"address": "partition/vision", "amount": 0.25, "upper": None, "double": 0.5}


def test_the_schema_has_the_same_parts() -> None:
    json_text = json.dumps(encode_output(ANSWER))
    definition = output_schema_of([Answer])["$defs"]["Answer"]

    assert list(definition["properties"]) == definition["required"] == list(json.loads(json_text))
    assert definition["properties"]["upper"] == {"type": ["number", "null"]}
