"""Rules that no linter knows. Prints each breach as `file:line: what is wrong`; exits with 1 where there is one.

Each rule names the fault that it prevents.
"""

import ast
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

PACKAGE = Path("rarms_iac")
OPENS_FILES = frozenset(
    {"app/install_there.py", "storage/reading.py", "storage/disk.py", "storage/writing.py", "storage/shipped.py"}
    | {"providers/cgroups/effects.py", "running/supervisor_process.py", "running/kernel_files.py"}
    | {"running/line_sources.py", "running/environment.py", "running/thread_priorities.py", "running/thread_watcher.py"}
)
"""Modules that open files: the reader, the writers, and those that read files of the kernel or of components, or run
alone."""
READS_TEXT = ("running/", "powershell/", "providers/hyperv/", "manifest/text/")
"""Rooms that read what other programs print."""
SENTENCES = frozenset({"summary", "detail", "advice", "message", "reason", "comment", "title", "note"})
"""Fields with sentences for people."""
READING = frozenset({"startswith", "endswith", "removeprefix", "removesuffix", "split", "partition", "find", "count"})


def breaches_in(package: Path) -> Iterator[str]:
    """Yield every breach below the package, as `path:line: text`."""
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(package.rglob("*.py"))}
    yield from _repeated_class_names(trees)
    for path, tree in trees.items():
        module = path.relative_to(package).as_posix()
        for node in ast.walk(tree):
            place = f"{path.as_posix()}:{getattr(node, 'lineno', 0)}"
            if module not in OPENS_FILES and _opens_a_file(node) and "devnull" not in ast.unparse(node):
                yield f"{place}: this opens a file: use storage.reading or storage.shipped"
            if not module.startswith(READS_TEXT) and _reads_a_sentence(node):
                yield f"{place}: this reads a sentence: what code needs is a field"
            if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in {"benchmarks", "tests"}:
                yield f"{place}: the package is installed without benchmarks and tests"


def _repeated_class_names(trees: Mapping[Path, ast.Module]) -> Iterator[str]:
    """Two classes of one name were taken for each other in reviews, and JSON had two shapes for one type."""
    first: dict[str, str] = {}
    for path, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                place = f"{path.as_posix()}:{node.lineno}"
                if (other := first.setdefault(node.name, place)) != place:
                    yield f"{place}: class {node.name} is also in {other}: rename one of them"


def _opens_a_file(node: ast.AST) -> bool:
    """Files that were opened elsewhere had no size limit and followed links: one of 5 GB filled the memory."""
    match node:
        case ast.Call(func=ast.Name(id="open") | ast.Attribute(attr="read_text" | "read_bytes")):
            return True
        case ast.Call(func=ast.Attribute(attr="open" | "fdopen", value=ast.Name(id="os" | "io"))):
            return True
        case ast.Call(func=ast.Attribute(attr="open"), args=[] | [ast.Constant(), *_]):
            return True
        case _:
            return False


def _reads_a_sentence(node: ast.AST) -> bool:
    """Decisions that were made on a sentence changed when its English did."""
    match node:
        case ast.Call(func=ast.Attribute(attr=attr, value=ast.Attribute(attr=name) | ast.Name(id=name))):
            return attr in READING and name in SENTENCES
        case ast.Compare(ops=[ast.In() | ast.NotIn()], comparators=[ast.Attribute(attr=name)]):
            return name in SENTENCES
        case _:
            return False


if __name__ == "__main__":
    found = list(breaches_in(PACKAGE))
    print(*found, sep="\n", end="\n" if found else "")
    sys.exit(1 if found else 0)
