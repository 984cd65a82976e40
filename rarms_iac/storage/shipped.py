"""Finds what is shipped beside the code: schemas, manifests, templates and the findings' pages."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent.parent


class NotShipped(FileNotFoundError):
    """This copy of rarms lacks one of its own files: it was not installed whole."""

    def __init__(self, relative: str) -> None:
        super().__init__(f"rarms lacks its own file {relative}: install it again")
        self.relative = relative


def shipped(relative: str) -> Path:
    """Where a shipped file or folder lies, e.g. `docs/findings`: inside the wheel, else in the checkout.

    Args:
        relative: path with `/`, as in the checkout.

    Returns:
        A path that exists.

    Raises:
        NotShipped: it lies in neither.
    """
    for root in (_PACKAGE / "shipped", _PACKAGE.parent):
        found = root / relative
        if found.exists():
            return found
    raise NotShipped(relative)


def shipped_text(relative: str) -> str:
    """The text of a shipped file, with LF on every system.

    Args:
        relative: as of `shipped`.

    Returns:
        UTF-8, decoded.

    Raises:
        NotShipped: it lies in neither place.
    """
    return shipped(relative).read_text(encoding="utf-8")
