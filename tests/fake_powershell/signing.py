"""Made signatures, and what a Windows that wants signed files says of one."""

import hashlib
import re

SIGNED = re.compile(rb"\r\n# SIG # Begin signature block\r\n# ([0-9a-f]{64})\r\n# SIG # End signature block\r\n")


def signed(script: bytes) -> bytes:
    """A script with a made signature: as Windows adds one, with a digest in the place of the certificate's word."""
    digest = hashlib.sha256(script).hexdigest().encode()
    return script + b"\r\n# SIG # Begin signature block\r\n# " + digest + b"\r\n# SIG # End signature block\r\n"


def why_unsigned(script: bytes) -> str:
    """Why a Windows that wants signed scripts refuses this one."""
    found = SIGNED.search(script)
    if found is None or found.end() != len(script):
        return "The file is not digitally signed."
    return "" if signed(script[: found.start()]) == script else "The hash of the file does not match."
