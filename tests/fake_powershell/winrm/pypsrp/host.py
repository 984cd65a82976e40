class PSHostUserInterface:
    pass


class PSHost:
    def __init__(self, *parts: object) -> None:
        self.parts = parts
