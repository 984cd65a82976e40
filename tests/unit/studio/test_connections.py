"""The studio's port: taken again at once, and never taken from another program."""

import socket

import pytest

from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.studio.connections import LOOPBACK, bind
from tests.needs import ON_WINDOWS


def test_recently_used_port_is_taken() -> None:
    with bind(0) as first, socket.create_connection(first.getsockname()) as client:
        served, _ = first.accept()
        served.close()  # who closes first keeps the port for a minute
        assert client.recv(1) == b""
        port = first.getsockname()[1]

    with bind(port) as again:
        assert again.getsockname() == (LOOPBACK, port)


def test_a_port_that_another_program_has_is_refused() -> None:
    with bind(0) as other, pytest.raises(RequestError, match="cannot be taken"):
        bind(other.getsockname()[1])


def test_only_windows_has_the_port_exclusively() -> None:
    with bind(0) as bound:
        assert bool(bound.getsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR)) is not ON_WINDOWS
        if ON_WINDOWS:
            assert bound.getsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE)  # type: ignore[attr-defined]
