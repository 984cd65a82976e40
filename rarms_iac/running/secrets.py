"""Values that a component gets from rarms' own environment: what it prints is recorded in git, and they are not."""

import json
from collections.abc import Callable, Mapping
from urllib.parse import quote, quote_plus

from rarms_iac.model.run import FromEnvironment, Run

LEAST = 6
"""Characters of a value that is looked for: a shorter one stands in other words, too."""


def hide_secrets(run: Run, own: Mapping[str, str]) -> Callable[[str], str]:
    """Make the function that takes the values of `from_env` variables out of a text.

    Args:
        run: of the component.
        own: rarms' own environment.

    Returns:
        A function of a text, which has `<NAME>` in place of each value of at least `LEAST` characters, as it is or as
        JSON or an address writes it; the longest first, so that none is left in part.
    """
    names = {value.name for value in run.environment.values() if isinstance(value, FromEnvironment)}
    forms = {
        form: name
        for name in sorted(names)
        if len(value := own.get(name, "")) >= LEAST
        for form in (value, json.dumps(value)[1:-1], json.dumps(value, ensure_ascii=False)[1:-1], *_in_addresses(value))
    }
    ordered = sorted(forms, key=lambda form: (-len(form), form))

    def hide(text: str) -> str:
        for form in ordered:
            text = text.replace(form, f"<{forms[form]}>")
        return text

    return hide


def _in_addresses(value: str) -> tuple[str, ...]:
    """The value as addresses write it; bytes that are no text are written as they came."""
    return tuple(write(value, errors="surrogateescape") for write in (quote, quote_plus))
