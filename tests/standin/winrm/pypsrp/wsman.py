class WSMan:
    """Who asks, and how: kept for the shell, which refuses what no service would take."""

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
    ) -> None:
        self.server = server
        self.port = port
        self.username = username
        self.password = password
        self.auth = auth
        assert ssl
        assert cert_validation
        assert connection_timeout > 0
