"""Pictures of a terminal for docs/tutorial.md: its commands are run, and rich draws what they print.

`make pictures` writes `docs/figures/tutorial-<name>.svg`. Plans' ids and times differ from run to run.
"""

import fcntl
import io
import os
import pty
import re
import struct
import subprocess
import sys
import tempfile
import termios
import tty
from pathlib import Path

from rich.console import Console
from rich.text import Text

FIGURES = Path("docs/figures").resolve()
RARMS = Path(sys.executable).with_name("rarms")
WIDTH = 80

RUNS: tuple[tuple[str, str, str], ...] = (
    ("", "init . --tutorial", "out"),
    ("measure", "measure", "out"),
    ("too-much", "plan", "err"),
    ("tune", "tune", "out"),
    ("plan", "plan", "out"),
    ("", "apply --auto-approve", "out"),
    ("prove", "prove --load-host", "out"),
)
"""The picture's name, empty for none; the words behind `rarms`; the stream that is drawn."""


def on_a_terminal(words: str, folder: str, stream: str) -> str:
    """Return a command's output on one of its streams, a terminal of 80 columns, with colours."""
    leader, follower = pty.openpty()
    tty.setraw(follower)  # no carriage returns before line ends
    fcntl.ioctl(follower, termios.TIOCSWINSZ, struct.pack("HHHH", 50, WIDTH, 0, 0))
    process = subprocess.Popen(
        [str(RARMS), *words.split()],
        cwd=folder,
        env={**os.environ, "COLUMNS": str(WIDTH), "TERM": "xterm-256color"},
        stdin=subprocess.DEVNULL,
        stdout=follower if stream == "out" else subprocess.DEVNULL,
        stderr=follower if stream == "err" else subprocess.DEVNULL,
    )
    os.close(follower)
    written = b""
    while block := _read(leader):
        written += block
    process.wait()
    os.close(leader)
    return written.decode()


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 65536)
    except OSError:  # the other side is closed
        return b""


def draw(name: str, words: str, printed: str) -> None:
    """Write the picture of a command and its output."""
    console = Console(record=True, width=WIDTH, file=io.StringIO(), legacy_windows=False)
    console.print(Text.assemble(("$ ", "bold green"), (f"rarms {words}", "bold")))
    console.print(Text.from_ansi(printed))
    svg = console.export_svg(title="robot", unique_id=f"tutorial-{name}")
    svg = re.sub(r"@font-face \{.*?\}\s*", "", svg, flags=re.DOTALL)  # nothing is fetched from elsewhere
    (FIGURES / f"tutorial-{name}.svg").write_text(svg, encoding="utf-8")


def main() -> None:
    """Run the tutorial in a folder of its own, and draw what it prints."""
    with tempfile.TemporaryDirectory() as folder:
        for name, words, stream in RUNS:
            printed = on_a_terminal(words, folder, stream)
            if name:
                draw(name, words, printed)


if __name__ == "__main__":
    main()
