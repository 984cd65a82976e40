"""What ends a component's run early, as exceptions with their facts."""


class RunningError(Exception):
    """Something about a component's processes that its samples cannot tell."""


class CannotStart(RunningError):
    """The component cannot be started as the manifest says it."""

    def __init__(self, component: str, says: str) -> None:
        super().__init__(f"{component}: {says}")
        self.component = component
        self.says = says


class KeeperLost(RunningError):
    """The process between rarms and the component is gone: somebody killed it, and what it kept with it."""

    def __init__(self, component: str, says: str) -> None:
        super().__init__(f"{component}: {says}")
        self.component = component
        self.says = says
