"""House rules that no linter knows: each class name has one meaning, names are nouns, contracts are whole, one reader.

No code reads a sentence either.

Prints each breach as `file:line: what is wrong` and exits 1 where there is one.
"""

import ast
import re
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from tokenize import COMMENT, tokenize

PACKAGE = Path("rarms_iac")

MAY_READ = {
    "app/install_there.py": "runs alone on a robot, where no other module of rarms is",
    "storage/reading.py": "the one reader",
    "storage/disk.py": "the writers' effects on files",
    "storage/lock.py": "a lock is an open file",
    "storage/shipped.py": "what rarms ships, as it was installed",
    "providers/cgroups/effects.py": "files of the kernel",
    "running/supervisor_process.py": "files of the kernel",
    "running/kernel_files.py": "files of the kernel",
}
"""Who opens files, and why: there is one reader, two writers, and files of the kernel in their provider."""

EMPTY_NAMES = frozenset(
    {"one", "says", "left", "kept", "where", "what", "standing", "told", "_told", "not_told", "_not_told"}
    | {"_where", "ours", "not_ours", "these"}
)
"""Names of parameters, variables, fields and functions, in small letters, that do not say what they hold."""

TESTS = Path("tests/unit")
TESTED_ROOMS = ("diff", "model", "planner", "running", "statistics", "storage")
"""Whose tests name things as the package does; the rest of what is no package binds no `one`."""
BENCHMARKS = Path("benchmarks")
ELSEWHERE = (Path("tests"), BENCHMARKS, Path("scripts"))

WITH_CONTRACTS = ("app/", "diff/", "measuring/", "planner/", "providers/interface.py", "statistics/", "storage/")
"""Where public functions say what their types do not: what a plain number or text means, and what is raised."""
PLAIN = frozenset({"int", "float", "str", "bytes", "object", "Any"})
COLLECTIONS = frozenset(
    {"Iterable", "Iterator", "Sequence", "Collection", "Mapping", "tuple", "list", "dict", "set"}
) | {
    "frozenset",
    "None",
}
REFERENCE = re.compile(r"See (`|the (interface|protocol))|The same\b|Its \w+\.$")
"""How a docstring begins that sends its reader elsewhere instead of saying what it is about."""

PRONOUNS = re.compile(r"\b(?:no|some)body\b|\b(?:who|what|wher)ever\b", re.IGNORECASE)
"""Words that leave open who or what it is."""
TEMPLATES = Path("templates")
WITH_WORDS = frozenset({".py", ".ps1", ".j2", ".html", ".js", ".sh", ".md", ".txt", ".json", ".yaml"})

PROSE = frozenset({"summary", "detail", "advice", "message", "reason", "comment", "title", "note"})
"""Fields and variables that hold sentences for people, of any type: most of them are `str`."""
PROSE_TYPES = frozenset({"Prose", "Wording"})
"""Types whose values are sentences; fields, parameters and results of them count under any name."""
RENDERING = ("show_", "describe_", "plain_text", "render")
"""How functions begin that make text of values; those of views that return what is shown count as well."""
SHOWN = frozenset({"RenderableType", "Text"})
READING = frozenset({"removeprefix", "removesuffix", "replace", "split", "rsplit", "partition", "rpartition"}) | {
    "startswith",
    "endswith",
    "find",
    "index",
    "count",
    "splitlines",
    "casefold",
    "lower",
}
STRIPPING = frozenset({"strip", "lstrip", "rstrip"})
"""These read a sentence where they are told what to take off."""
PATTERNS = frozenset({"search", "match", "fullmatch", "sub", "split", "findall", "finditer"})

MAY_READ_PROSE = {
    "running/": "what components print",
    "powershell/": "text of scripts",
    "providers/hyperv/": "what PowerShell prints",
    "manifest/text/": "what the YAML parser says",
}
"""Where such a name holds what another program printed."""


def breaches_in(package: Path) -> Iterator[str]:
    """Everything below the package that breaks a rule."""
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(package.rglob("*.py"))}
    yield from _classes_of_two_meanings(trees)
    in_protocols = _protocol_methods(trees.values())
    prose = _names_of_prose(trees.values())
    for path, tree in trees.items():
        module = path.relative_to(package).as_posix()
        yield from _names_that_say_nothing(path, tree)
        if module.startswith(WITH_CONTRACTS):
            yield from _contracts_in_part(path, tree, in_protocols)
        yield from _methods_without_docstring(path, tree, in_protocols)
        yield from _references_for_docstrings(path, tree)
        if module not in MAY_READ:
            yield from _other_readers(path, tree)
        if not module.startswith(tuple(MAY_READ_PROSE)):
            yield from _readers_of_prose(path, tree, prose)
        yield from _imports_of_the_laboratory(path, tree)
    yield from _pronouns_below(package)


def breaches_elsewhere() -> Iterator[str]:
    """Everything beside the package that breaks a rule."""
    yield from _pronouns_below(TEMPLATES)
    for path in sorted(path for room in ELSEWHERE for path in room.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        names = EMPTY_NAMES if any(path.is_relative_to(TESTS / room) for room in TESTED_ROOMS) else frozenset({"one"})
        yield from _names_that_say_nothing(path, tree, names)
        yield from _names_of_pronouns(path, tree)
        yield from _pronouns_in_comments(path, tree)
        if not path.is_relative_to(BENCHMARKS):
            yield from _imports_of_the_laboratory(path, tree)


def _classes_of_two_meanings(trees: dict[Path, ast.Module]) -> Iterator[str]:
    places: dict[str, list[str]] = defaultdict(list)
    for path, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(f"{path.as_posix()}:{node.lineno}")
    for name, where in sorted(places.items()):
        if len(where) > 1:
            yield f"{where[0]}: class {name} has another meaning in {', '.join(where[1:])}: rename one of them"


def _names_that_say_nothing(path: Path, tree: ast.Module, names: frozenset[str] = EMPTY_NAMES) -> Iterator[str]:
    for line, name in _bound_names(tree):
        if name.lower() in names:
            yield f"{path.as_posix()}:{line}: `{name}` does not say what it holds: use the noun"


def _names_of_pronouns(path: Path, tree: ast.Module) -> Iterator[str]:
    for line, name in _bound_names(tree):
        if name != "NOBODY" and PRONOUNS.search(name.replace("_", " ")):  # the user of Unix that owns nothing
            yield f"{path.as_posix()}:{line}: `{name}`: say who or what it is"


def _pronouns_in_comments(path: Path, tree: ast.Module) -> Iterator[str]:
    """Those in comments and docstrings; other texts of a test are its data."""
    docstrings = [node.value for node in ast.walk(tree) if isinstance(node, ast.Expr)]
    texts = [(each.lineno, each.value) for each in docstrings if isinstance(each, ast.Constant)]
    with path.open("rb") as file:
        texts += [(token.start[0], token.string) for token in tokenize(file.readline) if token.type == COMMENT]
    for line, text in texts:
        for word in PRONOUNS.findall(str(text)):
            yield f"{path.as_posix()}:{line}: `{word}`: say who or what it is"


def _bound_names(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Names of variables, fields, parameters, functions, classes and imports, with their lines."""
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name) | ast.alias(asname=str(name)):
                yield node.lineno, name
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                yield node.lineno, name
            case ast.MatchAs(name=str(name)) | ast.MatchStar(name=str(name)):
                yield node.lineno, name
            case _:
                pass


def _protocol_methods(trees: Iterable[ast.Module]) -> frozenset[str]:
    """Names of the methods of protocols and abstract classes: their contracts stand there only."""
    return frozenset(
        method.name
        for tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef) and _is_protocol(node)
        for method in node.body
        if isinstance(method, ast.FunctionDef)
    )


def _is_protocol(node: ast.ClassDef) -> bool:
    return any(ast.unparse(base).startswith(("Protocol", "ABC")) for base in node.bases)


def _methods_without_docstring(path: Path, tree: ast.Module, in_protocols: frozenset[str]) -> Iterator[str]:
    """In place of ruff's D102, which knows no protocols."""
    for node in tree.body:
        if not isinstance(node, ast.ClassDef) or node.name.startswith("_"):
            continue
        for method in node.body:
            if not isinstance(method, ast.FunctionDef) or method.name.startswith("_") or ast.get_docstring(method):
                continue
            if _is_protocol(node) or method.name not in in_protocols:
                yield f"{path.as_posix()}:{method.lineno}: {method.name}: it has no docstring, nor has a protocol"


def _pronouns_below(folder: Path) -> Iterator[str]:
    for path in sorted(path for path in folder.rglob("*.*") if path.suffix in WITH_WORDS):
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            for word in PRONOUNS.findall(line):
                yield f"{path.as_posix()}:{number}: `{word}`: say who or what it is"


def _references_for_docstrings(path: Path, tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and REFERENCE.match(ast.get_docstring(node) or ""):
            yield f"{path.as_posix()}:{node.lineno}: {node.name}: its docstring only refers to another: say what it is"


def _contracts_in_part(path: Path, tree: ast.Module, in_protocols: frozenset[str]) -> Iterator[str]:
    for function in _public_functions(tree, in_protocols):
        if missing := list(_missing_sections(function)):
            yield f"{path.as_posix()}:{function.lineno}: {function.name}: its docstring has no {', '.join(missing)}"


def _public_functions(scope: ast.Module | ast.ClassDef, in_protocols: frozenset[str]) -> Iterator[ast.FunctionDef]:
    """Functions of a module and methods of its public classes; no properties, nothing private, no protocol's method."""
    implements = isinstance(scope, ast.ClassDef) and not _is_protocol(scope)
    for node in scope.body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from _public_functions(node, in_protocols)
        elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            decorators = {ast.unparse(decorator).rpartition(".")[2] for decorator in node.decorator_list}
            is_elsewhere = implements and node.name in in_protocols
            if not is_elsewhere and not decorators & {"property", "cached_property", "output", "overload"}:
                yield node


def _missing_sections(function: ast.FunctionDef) -> Iterator[str]:
    """The sections that its docstring lacks.

    A type of the package says what a value of it is, and `Args` may leave it out; a number or a text of the language
    does not: its unit, order and shape stand there. A summary that begins with `Return` or `Whether` tells what comes
    back.
    """
    text = ast.get_docstring(function) or ""
    arguments = function.args
    parameters = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    takes = [each for each in parameters if each.arg not in {"self", "cls"} and not each.arg.startswith("_")]
    if any(_is_plain(each.annotation) and f"    {each.arg}:" not in text for each in takes):
        yield "Args"
    is_told = "Returns:" in text or "Yields:" in text or text.startswith(("Return", "Whether"))
    if _is_plain(function.returns) and not is_told:
        yield "Returns"
    if "Raises:" not in text and any(_raises_something(node) for node in ast.walk(function)):
        yield "Raises"


def _is_plain(annotation: ast.expr | None) -> bool:
    """Whether it names types of the language alone, one of which says nothing of units and meaning."""
    if annotation is None:
        return False
    names = {node.id for node in ast.walk(annotation) if isinstance(node, ast.Name)}
    return bool(names & PLAIN) and names <= PLAIN | COLLECTIONS


def _raises_something(node: ast.AST) -> bool:
    """Whether it makes an exception; a bare `raise` lets one pass, and `AssertionError` tells of our own mistake."""
    return isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and "AssertionError" not in ast.unparse(node)


def _names_of_prose(trees: Iterable[ast.Module]) -> frozenset[str]:
    """Names of sentences: those of `PROSE`, fields of a type of sentences, and functions that end in one."""
    found = set(PROSE)
    for tree in trees:
        for node in ast.walk(tree):
            match node:
                case ast.ClassDef(body=body):
                    fields = (
                        each for each in body if isinstance(each, ast.AnnAssign) and _is_of_prose(each.annotation)
                    )
                    found |= {field.target.id for field in fields if isinstance(field.target, ast.Name)}
                case ast.FunctionDef(name=name, returns=returns) if _is_of_prose(returns) or _is_shown(returns):
                    found.add(name)
                case ast.FunctionDef(name=name, body=[*_, ast.Return(value=ast.expr() as value)]) if _is_prose(
                    value, PROSE
                ):
                    found.add(name)
                case _:
                    pass
    return frozenset(found)


def _is_of_prose(annotation: ast.expr | None) -> bool:
    """Whether it is a type of sentences, or that or nothing; a collection of sentences may be searched for one."""
    match annotation:
        case ast.Name(id=name) | ast.Constant(value=str(name)):
            return name in PROSE_TYPES
        case ast.BinOp(left=left, right=right):
            return _is_of_prose(left) or _is_of_prose(right)
        case _:
            return False


def _is_shown(annotation: ast.expr | None) -> bool:
    """Whether it is a type of what rich shows."""
    return isinstance(annotation, ast.Name | ast.Constant) and ast.unparse(annotation).strip("'") in SHOWN


def _readers_of_prose(path: Path, tree: ast.Module, prose: frozenset[str]) -> Iterator[str]:
    scopes: list[ast.Module | ast.FunctionDef] = [tree]
    scopes += [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    lines = {line for scope in scopes for line in _lines_that_read(scope, prose | _local_prose(scope, prose))}
    for line in sorted(lines):
        yield f"{path.as_posix()}:{line}: this reads a sentence: what code needs is a field"


def _local_prose(scope: ast.Module | ast.FunctionDef, prose: frozenset[str]) -> frozenset[str]:
    """Parameters of a function that are sentences by their type, and its variables that are set to a sentence."""
    if isinstance(scope, ast.Module):
        return frozenset()
    arguments = (*scope.args.posonlyargs, *scope.args.args, *scope.args.kwonlyargs)
    names = {argument.arg for argument in arguments if _is_of_prose(argument.annotation)}
    for node in ast.walk(scope):
        match node:
            case ast.Assign(value=value, targets=targets) if _is_prose(value, prose | names):
                names |= {target.id for target in targets if isinstance(target, ast.Name)}
            case ast.NamedExpr(value=value, target=target) if _is_prose(value, prose | names):
                names.add(target.id)
            case ast.ExceptHandler(name=str(name)):  # its text is a sentence: what code needs, it has as attributes
                names.add(name)
            case _:
                pass
    return frozenset(names)


def _lines_that_read(scope: ast.Module | ast.FunctionDef, prose: frozenset[str]) -> Iterator[int]:
    for node in ast.walk(scope):
        match node:
            case ast.Call(func=ast.Attribute(attr="replace" | "split" | "lstrip"), args=[*blanks]) if blanks and all(
                _is_blank(blank) for blank in blanks
            ):
                pass  # it lays lines out
            case ast.Call(func=ast.Attribute(attr=attr, value=text)) if attr in READING and _is_prose(text, prose):
                yield node.lineno
            case ast.Call(func=ast.Attribute(attr=attr, value=text), args=[_]) if attr in STRIPPING and _is_prose(
                text, prose
            ):
                yield node.lineno
            case ast.Compare(left=text, ops=[ast.Eq() | ast.NotEq()], comparators=[ast.Constant(value=str(other))]) if (
                other and _is_prose(text, prose)
            ):
                yield node.lineno
            case ast.Call(func=ast.Attribute(attr=attr), args=args) if attr in PATTERNS and any(
                _is_prose(arg, prose) for arg in args
            ):
                yield node.lineno
            case ast.Compare(ops=ops, comparators=texts) if any(
                isinstance(op, ast.In | ast.NotIn) and _is_prose(text, prose)
                for op, text in zip(ops, texts, strict=True)
            ):
                yield node.lineno
            case _:
                pass


def _is_prose(node: ast.expr, prose: frozenset[str]) -> bool:
    """Whether it is a field or variable of this name, text that a function made of a value, or made of such."""
    match node:
        case ast.Attribute(attr=name) | ast.Name(id=name):
            return name in prose
        case ast.Call(func=ast.Name(id="str"), args=[value]):
            return _is_prose(value, prose)
        case ast.Call(func=ast.Name(id=name)):
            return name.startswith(RENDERING) or name in prose
        case ast.Call(func=ast.Attribute(attr=name, value=value)):
            return name.startswith(RENDERING) or name in prose or _is_prose(value, prose)
        case ast.Subscript(value=value) | ast.FormattedValue(value=value):
            return _is_prose(value, prose)
        case ast.JoinedStr(values=parts):
            return any(_is_prose(part, prose) for part in parts)
        case ast.BinOp(left=left, right=right):
            return _is_prose(left, prose) or _is_prose(right, prose)
        case _:
            return False


def _is_blank(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str) and not node.value.strip()


def _other_readers(path: Path, tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and _opens_a_file(node) and "devnull" not in ast.unparse(node):
            yield f"{path.as_posix()}:{node.lineno}: this opens a file: use storage.reading or storage.shipped"


def _opens_a_file(call: ast.Call) -> bool:
    """Whether it is `open(...)`, `os.open(...)`, `path.open("r")`, `path.read_text()`, `stdin.read()` or the like."""
    match call.func:
        case ast.Name(id="open"):
            return True
        case ast.Attribute(value=ast.Name(id="os" | "io"), attr="open" | "fdopen"):
            return True
        case ast.Attribute(attr="read_text" | "read_bytes"):
            return True
        case ast.Attribute(value=ast.Attribute(attr="stdin" | "buffer"), attr="read"):
            return True
        case ast.Attribute(attr="open"):
            modes = [*call.args[:1], *(keyword.value for keyword in call.keywords)]
            return not call.args or any(isinstance(mode, ast.Constant) for mode in modes)
        case _:
            return False


def _imports_of_the_laboratory(path: Path, tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        match node:
            case ast.ImportFrom(module=str(module)):
                modules = [module]
            case ast.Import(names=names):
                modules = [alias.name for alias in names]
            case _:
                continue
        if any(module.split(".")[0] == BENCHMARKS.name for module in modules):
            yield f"{path.as_posix()}:{node.lineno}: benchmarks import the package, and nothing imports them"


def main() -> int:
    """Print what breaks a rule; 1 where something does."""
    found = [*breaches_in(PACKAGE), *breaches_elsewhere()]
    for breach in found:
        print(breach)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
