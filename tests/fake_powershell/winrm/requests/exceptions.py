class ConnectTimeout(OSError):
    pass


class ReadTimeout(OSError):
    pass


ConnectionError = OSError  # noqa: A001 - its name there
