"""Values of a manifest that must not leave it, hidden in its text."""

from collections.abc import Iterator
from dataclasses import replace

from rarms_iac.manifest.text.tree import Node, Scalar, build_positions, plain
from rarms_iac.model.plan import InputText

_HIDDEN = (
    ("components", "*", "run", "environment", "*"),
    ("partitions", "*", "guest", "connect", "ssh"),
    ("partitions", "*", "guest", "credential"),
)


def with_hidden_secrets(text: InputText) -> InputText:
    """Return the text with `x` for each letter and digit of variables' values, and of the way into guests.

    Lines and columns stay, so that findings point to the same places.
    """
    whole = "\n".join(text.lines)
    for scalar in _secrets(build_positions(whole, text.file), ()):
        head, body = "", whole[scalar.start : scalar.end]
        if scalar.style in {"|", ">"}:  # behind its first line, which says how it is written
            head, newline, rest = body.partition("\n")
            head, body = head + newline, rest
        elif scalar.style:
            head, body = body[0], body[1:]
        tail = scalar.style if scalar.style in {"'", '"'} else ""
        hidden = "".join(_hide(sign) for sign in body.removesuffix(tail))
        whole = whole[: scalar.start] + head + hidden + tail + whole[scalar.end :]
    return replace(text, lines=tuple(whole.split("\n")))


def _hide(sign: str) -> str:
    return sign if sign.isspace() or (sign.isascii() and not sign.isalnum() and sign not in "\\'\"") else "x"


def _secrets(node: Node, path: tuple[str, ...]) -> Iterator[Scalar]:
    if isinstance(node, Scalar):
        if any(_matches(path, hidden) for hidden in _HIDDEN) and isinstance(plain(node), str):
            yield node
    elif node.is_mapping:
        for entry in node.entries:
            if entry.key is not None:
                yield from _secrets(entry.value, (*path, entry.key.value))


def _matches(path: tuple[str, ...], hidden: tuple[str, ...]) -> bool:
    return len(path) == len(hidden) and all(each in {"*", name} for name, each in zip(path, hidden, strict=True))
