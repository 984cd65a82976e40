"""What comments of a script say: told to people, so it may be anything, and must do nothing.

A template puts a remark behind words of its own (`# why: ...`), on a line that ends with it. So no remark can begin
with `requires` or with the words of a signature block, which PowerShell heeds in comments.
"""


def remark(text: str) -> str:
    """The text on one line of printable ASCII; whatever else was in it is shown by its number, line ends as spaces."""
    return "".join(map(_character, " ".join(text.split())))


def _character(one: str) -> str:
    if one.isascii() and one.isprintable():
        return one
    return f"\\u{ord(one):04x}" if ord(one) < 0x10000 else f"\\U{ord(one):08x}"
