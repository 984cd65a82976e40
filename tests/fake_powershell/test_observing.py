"""The stand-in looks, through the very observe.ps1, as the host looked that it was made from."""

from typing import Any

import pytest

from rarms_iac.providers.hyperv.observation import observation_of
from rarms_iac.providers.hyperv.parse import identity_of
from tests.fake_powershell.observing import document_of, host_from
from tests.recorded_hosts import NAMES, document


def told(seen: dict[str, Any]) -> dict[str, Any]:
    """Without the words of errors, and keys in the order of their names, as a registry has them."""
    kept = {name: _told(probe) for name, probe in seen.items()}
    for name, key in (("tasks", ("name",)), ("records", ("application", "task"))):
        if isinstance(kept[name].get("value"), list):
            kept[name]["value"].sort(key=lambda entry: [entry[part].lower() for part in key])  # used at once
    if "value" in kept["machine_id"]:
        kept["machine_id"]["value"] = identity_of(kept["machine_id"]["value"])  # of older ones the Windows' own id
    for machine in kept["machines"].get("value", ()):
        machine.setdefault("replication_mode", "None")  # which older ones did not ask
    return kept


def _told(probe: Any) -> Any:
    return {key: value for key, value in probe.items() if key != "message"} if isinstance(probe, dict) else probe


@pytest.mark.parametrize("name", NAMES)
def test_recorded_host_comes_out_as_it_went_in(name: str) -> None:
    recorded = document(name)
    seen = document_of(host_from(recorded))

    # Recordings of an older observe.ps1 lack its later probes; all that they do have must come out.
    assert told({probe: seen[probe] for probe in recorded}) == told(recorded)


@pytest.mark.parametrize("name", NAMES)
def test_what_the_stand_in_prints_is_an_observation(name: str) -> None:
    assert observation_of(document_of(host_from(document(name)))).computer == document(name)["computer"]
