class GenericComplexObject:
    pass


class PSInvocationState:
    RUNNING = "Running"


class RunspacePoolState:
    OPENED = "Opened"
