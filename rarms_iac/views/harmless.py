"""Text from anywhere, shown so that it cannot act on a terminal or on the runner of a workflow.

`Terminal` lets no other text out; forms for programs (SARIF, Markdown, HTML) use it for what they show to people.
"""

import re
import unicodedata

from rarms_iac.model.wording import HIDDEN

GLUE = "\ue000"
"""Stands for a space that no line is broken at; rich would break at a no-break space."""

_HARMLESS = re.compile(r"[\x20-\x7e]*")
_COMMAND = re.compile(r"(?:^|(?<=\s)):(?=:)|#(?=#\[)", re.MULTILINE)
"""What begins a command in the log of a GitHub workflow, `::error` or `##[error]`; a line may be broken before it."""
_ACTING = {"Cc", "Cf", "Cs", "Zl", "Zp"}


def visible(text: str, keep: str = "\n") -> str:
    """Spell out everything that could act on a terminal or on the runner of a workflow, or has no encoding: `<U+202E>`.

    Control characters, bidirectional and other invisible formatting, line separators, lone surrogates, and the
    beginning of a workflow's command.

    Args:
        text: from anywhere, also from an attacker.
        keep: characters that stay as they are.
    """
    if _COMMAND.search(text):
        text = _COMMAND.sub(lambda sign: f"<U+{ord(sign[0]):04X}>", text)
    if _HARMLESS.fullmatch(text):
        return text
    return "".join(
        character
        if character in keep or (unicodedata.category(character) not in _ACTING and character != GLUE)
        else f"<U+{ord(character):04X}>"
        for character in text
    )


def spell_out_hidden(text: str) -> str:
    """Spell out the characters that a reader would not see, and leave all others as they are.

    Returns:
        It; `<U+202E>` for each such character.
    """
    return HIDDEN.sub(lambda sign: f"<U+{ord(sign[0]):04X}>", text)
