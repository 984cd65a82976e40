class WinRMError(Exception):
    pass


class AuthenticationError(WinRMError):
    pass
