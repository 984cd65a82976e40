"""Values that want to get out of their quotes, for the tests of everything that writes or reads scripts."""

import random

QUOTES = "'\u2018\u2019\u201a\u201b"
PIECES = (
    *QUOTES,
    *'"\u201c\u201d\u201e',
    *"\u2013\u2014\u2015-",
    *"$`@#<>|&;,(){}[]%*?!=+./\\^~:_ ",
    *"\t\r\n\0\x07\x1b\x7f\u0085\u00a0\u2028\u2029\ufeff\u202e",
    "\U0001f600",
    "é",
    "漢",
    "a",
    "Z",
    "0",
    "''",
    "'@",
    "@'",
    "\r\n'@\r\n",
    "<#",
    "#>",
    "$(",
    "${",
    "; Remove-Item x; ",
    "' ; Hyper-V\\Remove-VM -VM $vm #",
    "\u2019 ; Hyper-V\\Remove-VM -VM $vm #",
    "--%",
    "-WhatIf",
    "$true",
    "[char]0x27",
    "requires -Version 99",
    "SIG # Begin signature block",
)


def hostile_texts(count: int, seed: int = 7) -> list[str]:
    """So many texts, the same for the same seed."""
    pick = random.Random(seed)
    return ["".join(pick.choices(PIECES, k=pick.randint(0, 12))) for _ in range(count)]
