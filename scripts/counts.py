"""Print the size of the code base: finding ids, what one plan runs, and by room modules, dataclasses and lines.

It also counts words that the style guide replaces. Lines are those with code: no blank lines, comments or docstrings.
"""

import ast
import contextlib
import io
import re
import sys
from collections import Counter, defaultdict
from inspect import CO_OPTIMIZED
from pathlib import Path
from tokenize import COMMENT, DEDENT, ENCODING, ENDMARKER, INDENT, NEWLINE, NL, tokenize
from types import FrameType

from rich import print as show
from rich.table import Table

from rarms_iac.cli.main import main as rarms

PACKAGE = Path("rarms_iac")
OTHERS = (Path("tests"), Path("benchmarks"), Path("scripts"))
NO_CODE = frozenset({COMMENT, DEDENT, ENCODING, ENDMARKER, INDENT, NEWLINE, NL})
WORDS = {
    "beside": r"\bbeside\b",
    "is no X": r"\bis no [a-z]",
    "anew, mend, rests on, stands up to": r"\b(anew|mends?|rests on|stands up to)\b",
    "takes back, told, stranger": r"\b(takes back|told|strangers?)\b",
}
READ = {".py", ".md", ".j2", ".psm1", ".ps1", ".html", ".js"}
"""The endings of files of the package, the templates and the docs that people read."""
CELL = ["plan", "-f", "manifests/hyperv-cell", "--snapshot", "cell=manifests/hyperv-cell/host.json"]


def code_lines(path: Path) -> int:
    """Return the number of lines of a module that have code."""
    with path.open("rb") as file:
        lines = {
            line
            for token in tokenize(file.readline)
            if token.type not in NO_CODE
            for line in range(token.start[0], token.end[0] + 1)
        }
    for node in ast.walk(ast.parse(path.read_bytes())):
        match node:
            case ast.Expr(value=ast.Constant(value=str()), lineno=first, end_lineno=int(last)):
                lines.difference_update(range(first, last + 1))
            case _:
                pass
    return len(lines)


def dataclasses_in(path: Path) -> int:
    """Return the number of classes of a module that the decorator makes."""
    classes = (node for node in ast.walk(ast.parse(path.read_bytes())) if isinstance(node, ast.ClassDef))
    return sum("dataclass" in ast.unparse(each) for node in classes for each in node.decorator_list)


def run_by_a_plan() -> tuple[int, int, int]:
    """Return the number of functions, class bodies and modules that `rarms plan` of the sample cell runs.

    A class body runs once, when its module is imported.
    """
    functions: set[tuple[str, int]] = set()
    bodies: set[tuple[str, int]] = set()
    package = str(PACKAGE.resolve())

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(package) and not code.co_name.startswith("<"):
            (functions if code.co_flags & CO_OPTIMIZED else bodies).add((code.co_filename, code.co_firstlineno))

    sys.setprofile(note)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            rarms(CELL)
    finally:
        sys.setprofile(None)
    return len(functions), len(bodies), len({path for path, _ in functions | bodies})


def hops() -> int:
    """Return the number of hops of a reservation that docs/architecture.md lists."""
    text = Path("docs/architecture.md").read_text(encoding="utf-8")
    _, _, section = text.partition("## One reservation")
    return len(re.findall(r"^\d+\. ", section.partition("\n## ")[0], re.MULTILINE))


def uses(pattern: str) -> int:
    """Return how often the package, the templates and the docs have a pattern."""
    folders = (PACKAGE, Path("templates"), Path("docs"))
    files = (path for folder in folders for path in folder.rglob("*") if path.suffix in READ)
    return sum(len(re.findall(pattern, path.read_text(encoding="utf-8"), re.IGNORECASE)) for path in files)


def short_args() -> int:
    """Return the number of `Args` entries of at most four words without a unit: they say no more than the name."""
    entries = (
        line.partition(": ")[2]
        for path in PACKAGE.rglob("*.py")
        for section in re.findall(r"^ +Args:\n((?: {8,}\S.*\n)+)", path.read_text(encoding="utf-8"), re.MULTILINE)
        for line in section.splitlines()
        if re.match(r" +\w+: ", line)
    )
    return sum(len(entry.split()) <= 4 and not re.search(r"bytes|seconds|columns|UTC", entry) for entry in entries)


def by_room() -> Table:
    """Return modules, dataclasses and lines of each room of the package, and their sums."""
    rooms: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for path in PACKAGE.rglob("*.py"):
        inner = path.relative_to(PACKAGE).parts
        counts = {"modules": path.name != "__init__.py", "dataclasses": dataclasses_in(path), "lines": code_lines(path)}
        for room in (inner[0] if len(inner) > 1 else "(no room)", "together"):
            rooms[room].update(counts)
    table = Table("Room", "Modules", "Dataclasses", "Lines")
    for room in [*sorted(rooms.keys() - {"together"}), "together"]:
        table.add_row(room, *(str(rooms[room][each]) for each in ("modules", "dataclasses", "lines")))
    return table


def main() -> None:
    """Print the tables."""
    functions, bodies, of_modules = run_by_a_plan()
    table = Table("What", "Count")
    table.add_row("finding ids", str(len(list(Path("docs/findings").glob("RARMS*.md")))))
    table.add_row("functions that run for a plan", f"{functions}, and {bodies} class bodies, in {of_modules} modules")
    table.add_row("hops of a reservation", str(hops()))
    for folder in OTHERS:
        table.add_row(f"lines of {folder}", str(sum(map(code_lines, folder.rglob("*.py")))))
    for name, pattern in WORDS.items():
        table.add_row(f"uses of: {name}", str(uses(pattern)))
    table.add_row("entries of Args without a fact", str(short_args()))
    show(by_room(), table)


if __name__ == "__main__":
    main()
