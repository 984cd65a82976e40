"""Takes values of rarms' own environment out of what components print, which is recorded in git.

In: `run` with its `from_env` variables and files of variables. Out: a function of a text. Begin at `hide_secrets`.
"""

import json
import os
from base64 import b64encode, urlsafe_b64encode
from collections.abc import Callable, Iterable, Iterator, Mapping
from urllib.parse import quote, quote_plus

from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.run import FromEnvironment, Run
from rarms_iac.model.system import Component
from rarms_iac.texts.findings import Finding
from rarms_iac.texts.messages import quoted

LEAST = 6
"""Characters of a value that is looked for: a shorter one stands in other words, too."""

LINE = 76
"""Characters after which programs break a line of base64."""


def hide_secrets(run: Run, own: Mapping[str, str], of_files: Mapping[str, str]) -> Callable[[str], str]:
    """Make the function that takes the values of `from_env` variables and of files of variables out of a text.

    Args:
        own: rarms' own environment.
        of_files: the variables of the files that `environment` names.

    Returns:
        A function of a text, which has `<NAME>` in place of each value of at least `LEAST` characters, as it is, in
        base64, or as JSON, Python, an address or a message writes it, whole or line by line; the longest first, so that
        none is left in part. Of a value that is cut off by an end of the text, or by `...`, the remainder is replaced,
        if it is as long.
    """
    each = [value for process in run.each_process.values() for value in process.variables.values()]
    values = {value.name: own.get(value.name, "") for value in each if isinstance(value, FromEnvironment)}
    forms = {
        form: name
        for name, value in sorted({**of_files, **values}.items())
        if len(value) >= LEAST
        for part in (value, *value.splitlines())
        if len(part) >= LEAST
        for form in _forms(part)
    }
    ordered = sorted(forms, key=lambda form: (-len(form), form))

    def hide(text: str) -> str:
        for form in ordered:
            text = text.replace(form, f"<{forms[form]}>")
        for form in ordered:
            text = _without_cut_off(text, form, f"<{forms[form]}>")
        return text

    return hide


def _without_cut_off(text: str, form: str, name: str) -> str:
    """Return the text without a cut form of a value at its beginning, at its end or before `...`."""
    if form[:LEAST] in text:
        for size in range(len(form) - 1, LEAST - 1, -1):
            text = text.replace(f"{form[:size]}...", f"{name}...")
            if text.endswith(form[:size]):
                text = f"{text[:-size]}{name}"
    if form[-LEAST:] in text:
        for size in range(len(form) - 1, LEAST - 1, -1):
            if text.startswith(form[-size:]):
                return f"{name}{text[size:]}"
    return text


def _forms(value: str) -> tuple[str, ...]:
    as_json = (json.dumps(value)[1:-1], json.dumps(value, ensure_ascii=False)[1:-1])
    as_python = (repr(value)[1:-1], ascii(value)[1:-1])  # what an exception of a component often shows
    # Bytes that are no text are written as they came.
    in_addresses = (write(value, errors="surrogateescape") for write in (quote, quote_plus))
    return (value, *as_json, *as_python, quoted(value)[1:-1], *in_addresses, *_as_base64(value))


def _as_base64(value: str) -> Iterator[str]:
    """Yield base64 of a value in both alphabets: alone, also in lines, and inside of a longer text (`user:password`).

    A character stands for six bits. So it matters how many bytes stand before the value, modulo three; inside of a
    text, characters that also stand for bits of a neighbour are left out.
    """
    data = value.encode("utf-8", errors="surrogateescape")
    for encode in (b64encode, urlsafe_b64encode):
        alone = encode(data).decode("ascii")
        lines = (alone[at : at + LINE] for at in range(0, len(alone), LINE))
        yield from (alone, alone.rstrip("="), *(line for line in lines if len(line) >= LEAST))
        for before in range(3):
            text = encode(bytes(before) + data).decode("ascii")
            yield text[-(-8 * before // 6) : 8 * (before + len(data)) // 6]


SHORT_SECRET = Finding.warning("RARMS345", "A value from the environment is too short to hide")


def short_secrets(components: Iterable[Component], places: Places) -> Iterator[Diagnostic]:
    """Find values of rarms' own environment that are too short to be found in what components print.

    Args:
        components: whose `from_env` variables are looked at.

    Yields:
        A warning for each such variable of a component; it shows neither the value nor its length.
    """
    for component in components:
        for path, _, value in component.run.own_variables if component.run is not None else ():
            if isinstance(value, FromEnvironment) and 0 < len(os.environ.get(value.name, "")) < LEAST:
                yield SHORT_SECRET.at(
                    places.value("components", component.name, "run", *path),
                    (
                        "{variable} has fewer than {least} characters. If {component:quoted} prints it, rarms shows "
                        "and records it."
                    ),
                    f"If it is a secret, use a value of at least {LEAST} characters.",
                    address=f"component/{component.name}",
                    component=component.name,
                    variable=value.name,
                    least=LEAST,
                )
