"""A document with more errors than a person reads costs little, also where they begin late."""

import pytest

from rarms_iac.manifest.document import validate_document as validation
from rarms_iac.manifest.document.validate_document import NotAManifest, validate_document
from rarms_iac.manifest.text.positions import FirstLine

SOUND = {"criticality": 1, "memory": "64 MiB", "cpu": {"reserve": "0.1 LP"}}
WRONG = {**SOUND, "memory": 5}
HOST = {"provider": "simulated", "logical_processors": 2, "memory": "4 GiB"}


def test_errors_behind_sound_entries_are_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(validation, "TOO_MANY_TO_LIST", 50)
    monkeypatch.setattr(validation, "PART_SIZES", (20, 5))
    names = [f"c{number:03}" for number in range(200)]
    document = {
        "schema": "rarms/v1",
        "application": {"name": "a"},
        "hosts": {"h": HOST},
        "components": {name: SOUND if name < "c060" else WRONG for name in names},
    }

    with pytest.raises(NotAManifest) as caught:
        validate_document(document, FirstLine("rarms.yaml"))

    assert [error.path[:2] for error in caught.value.errors] == [("components", name) for name in names[60:80]]
    assert caught.value.following == 140 - 20
