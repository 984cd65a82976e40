from rarms_iac.applying import refusals
from rarms_iac.providers.interface import HostFailed, HostUnreachable


def test_unreachable_host_has_its_own_finding() -> None:
    finding = refusals.host_failed(HostUnreachable("onboard", "ssh does not reach robot@cell: no route", "Try ssh."))

    assert (finding.code, finding.address) == ("RARMS189", "host/onboard")
    assert finding.values == {
        "host": "onboard",
        "reason": "ssh does not reach robot@cell: no route",
        "unreachable": True,
    }


def test_a_host_that_fails_was_reached() -> None:
    finding = refusals.host_failed(HostFailed("onboard", "its disk is full", "Make room."))

    assert "unreachable" not in finding.values
