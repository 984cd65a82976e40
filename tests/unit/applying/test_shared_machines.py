"""Hosts of one plan that are one machine, or clones of one image, are named in a warning."""

from dataclasses import replace

import pytest

from rarms_iac.applying.make_plan import make_plan
from rarms_iac.model.host import LinuxHost, ProviderKind
from rarms_iac.model.state import State
from tests.builders import a_host, a_system, codes
from tests.builders_plan import facts
from tests.planning import a_request

SHARED = {"RARMS343"}


def found(provider: ProviderKind, ids: tuple[str, str], slices: tuple[str, str] = ("rarms", "rarms")) -> set[str]:
    hosts = [
        a_host(name, provider=provider, settings=LinuxHost(slice=part) if provider is ProviderKind.LINUX else None)
        for name, part in zip(("left", "right"), slices, strict=True)
    ]
    states = {
        name: State(facts=replace(facts(), name=name, id=identity, provider=provider))
        for name, identity in zip(("left", "right"), ids, strict=True)
    }
    return SHARED & set(codes(make_plan(a_request(a_system(hosts=hosts)), states).findings))


@pytest.mark.parametrize("provider", ProviderKind)
def test_equal_identities_are_named_as_clones(provider: ProviderKind) -> None:
    assert found(provider, ("a" * 32, "a" * 32)) == {"RARMS343"}
    assert found(provider, ("a" * 32, "b" * 32)) == set()
    assert found(provider, ("", "")) == set()


def test_slices_of_one_machine_are_no_clones() -> None:
    assert found(ProviderKind.LINUX, ("a" * 32, "a" * 32), ("left", "right")) == {"RARMS343"}
    assert found(ProviderKind.LINUX, ("a" * 32, "b" * 32), ("left", "right")) == set()
