"""A plan that was edited and sealed anew does not show one thing and do another: it is refused, value by value."""

import json
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.model.plan import Plan
from rarms_iac.storage.codec import NotDecodable, decode
from rarms_iac.storage.digest import digest
from rarms_iac.storage.plan_file import plan_id
from rarms_iac.storage.shipped import shipped
from tests.effort import Attempt, every_few, tried
from tests.laws.test_damaged_file_laws import changed, paths_in
from tests.unit.cli.running import rarms

CELL = shipped("manifests/hyperv-cell")
SHOWN = {"changes", "steps", "totals"}
"""The parts of a host's plan that a reviewer judges by."""
WORDS = {"message", "place"}
"""What cannot be derived: reasons, and places in the manifest; also what an undo cannot bring back is a message."""


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    path = tmp_path_factory.mktemp("cell") / "cell.plan"
    assert rarms("plan", "-f", str(CELL), "--snapshot", f"cell={CELL / 'host.json'}", "--out", str(path)).code == 0
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return document


def another(value: Any) -> Any:
    match value:
        case bool():
            return not value
        case int():
            return value + 1
        case str():
            return f"{value}x"
        case None:
            return "x"
        case list():
            return value[1:]
        case _:
            return {}


def value_at(document: Any, path: tuple[Any, ...]) -> Any:
    for key in path:
        document = document[key]
    return document


def forged(document: dict[str, Any], path: tuple[Any, ...]) -> dict[str, Any] | None:
    """The document with one value changed, and an id and a seal that fit; None where no plan has such a value."""
    document = dict(changed(document, path, another(value_at(document, path))))
    del document["seal"]
    try:
        document["id"] = plan_id(decode(Plan, document))
    except (NotDecodable, LookupError, TypeError, AttributeError):
        return None
    return {**document, "seal": digest(document)}


def test_no_value_that_a_reviewer_judges_by_can_be_forged(sealed: dict[str, Any], tmp_path: Path) -> None:
    paths = [path for path in paths_in(sealed) if path[0] == "hosts" and path[2:3] and path[2] in SHOWN]
    judged = [path for path in paths if not WORDS & set(path)]
    refused, passed = 0, []
    for number in every_few(len(judged), 120):
        document = forged(sealed, judged[number])
        if document is None or document["id"] == sealed["id"]:
            continue
        file = tmp_path / "forged.plan"
        file.write_text(json.dumps(document), encoding="utf-8")
        tried(Attempt.FORGERY)
        answer = rarms("show", str(file), "--json")
        if answer.code == 3 and "RARMS180" in answer.err:
            refused += 1
        else:
            passed.append(judged[number])

    assert passed == []
    assert refused > 50
