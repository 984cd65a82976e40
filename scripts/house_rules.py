"""House rules that no linter knows: each class name has one meaning, names say what they hold, one reader.

Prints each breach as `file:line: what is wrong` and exits 1 where there is one.
"""

import ast
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path("rarms_iac")

MAY_READ = {
    "storage/reading.py": "the one reader",
    "storage/disk.py": "the writers' effects on files",
    "storage/lock.py": "a lock is an open file",
    "storage/shipped.py": "what rarms ships, as it was installed",
    "powershell/cmdlets.py": "a table inside the package",
    "running/supervisor_process.py": "files of the kernel",
}
"""Who opens files, and why; DESIGN section 4: one reader, two writers, and files of the kernel in their provider."""


def breaches(package: Path) -> Iterator[str]:
    """Everything below the package that breaks a rule."""
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(package.rglob("*.py"))}
    yield from _classes_of_two_meanings(trees)
    for path, tree in trees.items():
        yield from _names_that_say_nothing(path, tree)
        if path.relative_to(package).as_posix() not in MAY_READ:
            yield from _other_readers(path, tree)


def _classes_of_two_meanings(trees: dict[Path, ast.Module]) -> Iterator[str]:
    places: dict[str, list[str]] = defaultdict(list)
    for path, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(f"{path.as_posix()}:{node.lineno}")
    for name, where in sorted(places.items()):
        if len(where) > 1:
            yield f"{where[0]}: class {name} has another meaning in {', '.join(where[1:])}: rename one of them"


def _names_that_say_nothing(path: Path, tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        match node:
            case ast.Name(id="one", ctx=ast.Store()) | ast.arg(arg="one"):
                yield f"{path.as_posix()}:{node.lineno}: `one` does not say what it holds: use the noun"
            case _:
                pass


def _other_readers(path: Path, tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and _opens_a_file(node) and "devnull" not in ast.unparse(node):
            yield f"{path.as_posix()}:{node.lineno}: this opens a file: use storage.reading or storage.shipped"


def _opens_a_file(call: ast.Call) -> bool:
    """Whether it is `open(...)`, `os.open(...)`, `path.open("r")`, `path.read_text()` or the like."""
    match call.func:
        case ast.Name(id="open"):
            return True
        case ast.Attribute(value=ast.Name(id="os" | "io"), attr="open" | "fdopen"):
            return True
        case ast.Attribute(attr="read_text" | "read_bytes"):
            return True
        case ast.Attribute(attr="open"):
            modes = [*call.args[:1], *(keyword.value for keyword in call.keywords)]
            return not call.args or any(isinstance(mode, ast.Constant) for mode in modes)
        case _:
            return False


def main() -> int:
    """Print what breaks a rule; 1 where something does."""
    found = list(breaches(PACKAGE))
    for breach in found:
        print(breach)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
