"""A script for a reader: line numbers, what is fixed in scripts left out, colour by our tokens."""

from rarms_iac.powershell.inspection.layout import digest, split
from rarms_iac.powershell.tokens import NotTokens, Token, TokenKind, tokens

RESET = "\x1b[0m"
_REMARK, _TEXT, _CALL, _VARIABLE, _PARAMETER = "\x1b[32m", "\x1b[33m", "\x1b[1m", "\x1b[36m", "\x1b[2m"


def script_text(script: str, *, colour: bool = False, whole: bool = False) -> str:
    """The script with the numbers of its lines, as they are in the file; `whole`: its fixed parts too."""
    plain = script.replace("\r\n", "\n")
    parts = split(plain)
    shown = _coloured(plain) if colour else plain
    lines = shown.removesuffix("\n").split("\n")
    width = len(str(len(lines)))
    numbered = [f"{number:>{width}}  {line}".rstrip() for number, line in enumerate(lines, start=1)]
    for piece in () if whole else reversed(parts.fixed):
        fixed = (
            f"lines {piece.first} to {piece.last}: {piece.says}, fixed (SHA-256 {digest(piece.text)[:12]}); "
            "--whole shows it"
        )
        told = f"{'':>{width}}  ... {fixed}"
        numbered[piece.first - 1 : piece.last] = [told]
    return "\n".join(numbered) + "\n"


def _coloured(text: str) -> str:
    try:
        found = tokens(text)
    except NotTokens:
        return text  # it is shown as it is; the inspection says what is wrong with it
    made: list[str] = []
    at = 0
    for before, token in zip((None, *found), found, strict=False):
        made.append(text[at : token.offset])
        piece = text[token.offset : token.end]
        paint = _paint(before, token, piece)
        made.append(f"{paint}{piece}{RESET}" if paint else piece)
        at = token.end
    return "".join([*made, text[at:]])


def _paint(before: Token | None, token: Token, piece: str) -> str:
    match token.kind:
        case TokenKind.COMMENT:
            return _REMARK
        case TokenKind.STRING | TokenKind.EXPANDABLE:
            return "" if "\n" in piece else _TEXT
        case TokenKind.WORD if piece.startswith("$"):
            return _VARIABLE
        case TokenKind.WORD if piece.startswith("-") and piece[1:2].isalpha():
            return _PARAMETER
        case TokenKind.WORD if _begins(before) and "-" in piece:
            return _CALL
        case _:
            return ""


def _begins(before: Token | None) -> bool:
    """Whether a word after this one is a call."""
    return before is None or before.kind is TokenKind.NEWLINE or before.text in {"{", "(", "|", ";", "="}
