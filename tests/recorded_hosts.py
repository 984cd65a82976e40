"""The answers of hosts in tests/recorded/hyperv, and how to bend one of them."""

import json
from pathlib import Path
from typing import Any, cast

from rarms_iac.providers.hyperv.observation import HostObservation, document_of, observation_of

FOLDER = Path(__file__).parent / "recorded" / "hyperv"
NAMES = sorted(path.stem for path in FOLDER.glob("*.json"))


def recorded_bytes(name: str) -> bytes:
    """The file as it lies there."""
    return (FOLDER / f"{name}.json").read_bytes()


def read_observation(data: bytes) -> HostObservation:
    """The observation that a script's output holds."""
    return observation_of(document_of(data))


def document(name: str) -> dict[str, Any]:
    """Its JSON, for a test to change."""
    data = recorded_bytes(name)
    return cast("dict[str, Any]", json.loads(data.decode("utf-16" if data.startswith(b"\xff\xfe") else "utf-8")))


def recorded(name: str, **probes: Any) -> HostObservation:
    """The observation, with some probes given another value."""
    if not probes:
        return read_observation(recorded_bytes(name))
    given = {key: {"status": "value", "value": value} for key, value in probes.items()}
    return observation_of({**document(name), **given})


def unread(name: str, *probes: str, status: str = "absent") -> HostObservation:
    """The observation, with some probes absent or denied."""
    gone: dict[str, Any] = {key: {"status": status, "error": "Gone", "message": "it is gone"} for key in probes}
    return observation_of({**document(name), **gone})
