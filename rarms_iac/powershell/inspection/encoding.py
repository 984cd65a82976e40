"""The bytes of a script: printable ASCII in lines that end with CRLF, and not too many of them."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place

BYTES = Finding.error("RARMS200", "A script is not pure ASCII with CRLF")

MOST_BYTES = 16 * 1024 * 1024
"""Bytes of a script that is looked at; a plan of a thousand partitions makes a tenth of it."""


def check_bytes(script: bytes, name: str) -> Iterator[Diagnostic]:
    """Find bytes that PowerShell 5.1 may read otherwise than they were written.

    Args:
        script: its bytes.
        name: its file name, for the findings.

    Yields:
        A finding for each line with such a byte or another end; nothing but its size where it is too large.
    """

    def problem(line: int, detail: str, advice: str, **values: int) -> Diagnostic:
        place = Place(file=name, line=line, column=1)
        return BYTES.at(place, detail, advice, values={"script": name, **values})

    if len(script) > MOST_BYTES:
        yield problem(1, f"it has {len(script)} bytes", "split the plan", bytes=len(script), most_bytes=MOST_BYTES)
        return
    *lines, rest = script.split(b"\n")
    if rest or not lines:
        yield problem(len(lines) + 1, "the last line does not end", "write its CRLF")
    for number, line in enumerate(lines, start=1):
        if bad := [byte for byte in line.removesuffix(b"\r") if not 0x20 <= byte <= 0x7E]:
            advice = "5.1 reads a script in the code page of its Windows: only ASCII is the same everywhere"
            yield problem(number, f"a byte 0x{bad[0]:02x} is not printable ASCII", advice, byte=bad[0])
        elif not line.endswith(b"\r"):
            yield problem(number, "the line does not end with CR LF", "write it with CRLF, to its last line")
