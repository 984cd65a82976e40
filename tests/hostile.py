"""Input that no author writes by accident, as bytes: shared by the tests and the benchmark."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Hostile:
    """A text, the finding it must give, and where."""

    name: str
    make: Callable[[], bytes]
    code: str
    line: int = 1
    column: int = 1
    large: bool = False  # breaks only the limit of nodes or of size, so it may take five times as long


HEAD = b"schema: rarms/v1\n"


def _bomb(body: bytes) -> Callable[[], bytes]:
    return lambda: HEAD + body


def _aliases() -> bytes:
    rows = [b"a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    rows += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]".encode() for n in range(1, 20)]
    return b"\n".join(rows) + b"\n"


HOSTILE = (
    Hostile(name="alias bomb", make=_aliases, code="RARMS007", column=5),
    Hostile(
        name="merge-key bomb", make=_bomb(b"a: &a {x: 1}\nb:\n  <<: [*a, *a]\n"), code="RARMS007", line=2, column=4
    ),
    Hostile(name="alias", make=_bomb(b"a: &a x\nb: *a\n"), code="RARMS007", line=3, column=4),
    Hostile(name="anchor of a text", make=_bomb(b"a: &a x\n"), code="RARMS007", line=2, column=4),
    Hostile(name="tag of a text", make=_bomb(b"a: !!str 1\n"), code="RARMS007", line=2, column=4),
    Hostile(name="duplicate keys", make=_bomb(b"a: 1\na: 2\n"), code="RARMS007", line=3),
    Hostile(name="duplicate keys, one quoted", make=_bomb(b"a: 1\n'a': 2\n"), code="RARMS007", line=3),
    Hostile(name="tag", make=_bomb(b"a: !!python/object/apply:os.system [ls]\n"), code="RARMS007", line=2, column=4),
    Hostile(name="50,000 brackets", make=lambda: b"[" * 50_000, code="RARMS007", column=33),
    Hostile(name="50,000 braces", make=lambda: b"{a: " * 50_000, code="RARMS007", column=129),
    Hostile(
        name="deep indentation",
        make=lambda: b"".join(b" " * n + b"a:\n" for n in range(2000)),
        code="RARMS007",
        line=33,
        column=33,
    ),
    Hostile(name="huge integer", make=_bomb(b"a: " + b"9" * 60_000 + b"\n"), code="RARMS007", line=2, column=4),
    Hostile(name="NaN", make=_bomb(b"a: .nan\n"), code="RARMS007", line=2, column=4),
    Hostile(name="infinity", make=_bomb(b"a: -.inf\n"), code="RARMS007", line=2, column=4),
    Hostile(name="infinity by size", make=_bomb(b"a: 1e999\n"), code="RARMS007", line=2, column=4),
    Hostile(name="NUL", make=_bomb(b"a: x\0y\n"), code="RARMS005", line=2, column=5),
    Hostile(name="NUL by escape", make=_bomb(b'a: "x\\0y"\n'), code="RARMS005", line=2, column=4),
    Hostile(name="bidirectional control", make=_bomb("a: é\u202e\n".encode()), code="RARMS005", line=2, column=5),
    Hostile(name="bidirectional control by escape", make=_bomb(b'a: "\\u2066"\n'), code="RARMS005", line=2, column=4),
    Hostile(name="lone surrogate", make=_bomb(b"a: \xed\xa0\x80\n"), code="RARMS001", line=2, column=4),
    Hostile(name="lone surrogate by escape", make=_bomb(b'a: "\\ud800"\n'), code="RARMS007", line=2, column=7),
    Hostile(name="several documents", make=_bomb(b"---\na: 1\n"), code="RARMS007", line=2),
    Hostile(name="invalid UTF-8", make=_bomb(b"a: \xff\n"), code="RARMS001", line=2, column=4),
    Hostile(name="UTF-16", make=lambda: "schema: rarms/v1\n".encode("utf-16"), code="RARMS001"),
    Hostile(
        name="UTF-16 without a mark", make=lambda: "schema: rarms/v1\n".encode("utf-16-le"), code="RARMS005", column=2
    ),
    Hostile(name="empty", make=lambda: b"", code="RARMS001"),
    Hostile(name="blank", make=lambda: b" \n\n", code="RARMS001"),
    Hostile(name="only comments", make=lambda: b"# nothing\n", code="RARMS001"),
    Hostile(name="long scalar", make=lambda: b"a: " + b"x" * 2**20, code="RARMS007", column=4),
    Hostile(
        name="many comments",
        make=lambda: b"a: 1\n" + b"#\n" * 400_001,
        code="RARMS007",
        line=400_002,
        column=1,
        large=True,
    ),
    Hostile(
        name="many nodes", make=lambda: b"- {a: b}\n" * 400_000, code="RARMS007", line=133_334, column=3, large=True
    ),
    Hostile(name="8 MiB and a byte", make=lambda: b"#" * (8 * 2**20 + 1), code="RARMS001", large=True),
    Hostile(
        name="8 MiB of line ends",
        make=lambda: b"\n" * (8 * 2**20 - 1) + b"[",
        code="RARMS007",
        line=8_388_608,
        column=2,
        large=True,
    ),
    Hostile(
        name="8 MiB of emoji",
        make=lambda: b"#" + "\U0001f600".encode() * 2_000_000 + b"\n[",
        code="RARMS007",
        line=2,
        column=2,
        large=True,
    ),
)

MANIFEST = """\
schema: rarms/v1
application: {{name: robot}}
hosts: {{here: {{logical_processors: {processors}, memory: {memory}}}}}
components:
  vision:
    criticality: 1
    apt: {{success_rate: {{at_least: 5 %}}}}
    run: {{command: [x], samples: {{from: pattern, pattern: '{pattern}', success: {{field: ok}}}}}}
    cpu: {{reserve: 5 %}}
"""


def manifest(*, processors: str = "2", memory: str = "4 GiB", pattern: str = "(?P<ok>1)") -> bytes:
    return MANIFEST.format(processors=processors, memory=memory, pattern=pattern).encode()


HOSTILE_VALUES = (
    Hostile(name="full-width digits", make=lambda: manifest(processors="２"), code="RARMS017", line=3, column=36),
    Hostile(name="Arabic digits", make=lambda: manifest(memory="٤ GiB"), code="RARMS017", line=3, column=47),
    Hostile(
        name="pattern with a backreference",
        make=lambda: manifest(pattern=r"(?P<ok>1)\1"),
        code="RARMS017",
        line=8,
        column=59,
    ),
    Hostile(
        name="pattern with lookahead",
        make=lambda: manifest(pattern=r"(?P<ok>1)(?=(a+)+$)"),
        code="RARMS017",
        line=8,
        column=59,
    ),
)
