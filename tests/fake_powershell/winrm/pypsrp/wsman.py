"""Who asks, and how: kept for the shell, which refuses what no service would take."""

from types import SimpleNamespace


class WSMan:
    def __init__(
        self,
        server: str,
        port: int | None = None,
        username: str | None = None,
        password: str | None = None,
        ssl: bool = True,
        auth: str = "negotiate",
        cert_validation: bool = True,
        connection_timeout: int = 30,
        **of_ansible: object,
    ) -> None:
        self.server = server
        self.port = port
        self.username = username
        self.password = password
        self.auth = auth
        self.transport = SimpleNamespace(endpoint=f"{server}:{port}")
        assert ssl
        assert cert_validation
        assert connection_timeout > 0
