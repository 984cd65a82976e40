"""A table that is updated in place on a terminal, for what takes longer than a moment."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rarms_iac.views.console import table

if TYPE_CHECKING:
    from rich.console import Console
    from rich.live import Live


class LiveTable:
    """A table on a terminal whose last row changes while something runs; it is gone when it is hidden.

    Args:
        console: of standard error, where it is a terminal.
        header: names of the columns.
    """

    def __init__(self, console: "Console", header: Sequence[str] = ()) -> None:
        self._console = console
        self._header = header
        self._live: Live | None = None
        self.rows: list[Sequence[str]] = []

    def show(self, row: Sequence[str]) -> None:
        """Show the finished rows and this one below them."""
        from rich.live import Live

        if self._live is None:
            self._live = Live(console=self._console, transient=True, auto_refresh=False)
            self._live.start()
        wrapped = range(len(row))
        self._live.update(table([*self.rows, row], header=self._header, wrap=wrapped), refresh=True)

    def hide(self) -> None:
        """Take the table from the terminal, and give the cursor back."""
        if self._live is not None:
            self._live.stop()
            self._live = None
