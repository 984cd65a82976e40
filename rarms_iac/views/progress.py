"""Lines that are written over, until nothing uses them."""

from rarms_iac.views.console import columns

WRITE_OVER = "\r\x1b[K"


def seconds(time: float) -> str:
    """`0.1 s`, `75 s`: no more digits than a person reads."""
    return f"{time:.1f} s" if time < 10 else f"{time:.0f} s"


def fitting(text: str, width: int) -> str:
    """The text, cut so that the cursor stays on its line."""
    while columns(text) >= width:
        text = text[:-1]
    return text
