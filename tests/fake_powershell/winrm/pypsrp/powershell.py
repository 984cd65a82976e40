"""What Ansible's `psrp` opens before a command; scripts do not run in it here."""

from pypsrp.shell import WinRS
from pypsrp.wsman import WSMan


class RunspacePool:
    def __init__(self, connection: WSMan, host: object, configuration_name: str) -> None:
        assert configuration_name == "Microsoft.PowerShell"
        self.connection = connection
        self.host = host
        self.id = "1"
        self.state = "BeforeOpen"

    def open(self) -> None:
        WinRS(self.connection).__enter__()
        self.state = "Opened"

    def close(self) -> None:
        self.state = "Closed"


class PowerShell:
    def __init__(self, runspace_pool: RunspacePool) -> None:
        raise AssertionError("rarms runs commands, and no script in Ansible's runspace")
