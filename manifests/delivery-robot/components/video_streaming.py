"""Streams what the camera sees: a moving picture, its difference to the last frame, compressed (VSP).

Writes one JSON line a frame: how many frames were sent, and their bytes.
"""

import json
import os
import sys
import time
import zlib

WIDTH, HEIGHT = 320, 240
PERIOD_S = float(os.environ.get("RARMS_PERIOD_MS", "33")) / 1000  # as the manifest's `arrival` says


def picture(number: int) -> bytes:
    """Return the camera's picture: a pattern that drifts a pixel a frame."""
    row = bytes((x * x // 64 + 3 * x) % 256 for x in range(number, number + WIDTH))
    return b"".join(row[y % 32 :] + row[: y % 32] for y in range(HEIGHT))


def encoded(frame: bytes, last: bytes) -> bytes:
    """Return the frame as its compressed difference to the last one."""
    difference = (int.from_bytes(frame, "big") ^ int.from_bytes(last, "big")).to_bytes(len(frame), "big")
    return zlib.compress(difference, 6)


def main() -> None:
    """Frames, one a period, until its reader has gone, or as many as the first argument says."""
    frames = int(sys.argv[1]) if len(sys.argv) > 1 else sys.maxsize
    last, due = picture(0), time.perf_counter()
    for number in range(1, frames + 1):
        frame = picture(number)
        sent = encoded(frame, last)
        print(json.dumps({"frames": 1, "bytes": len(sent)}), flush=True)
        last, due = frame, due + PERIOD_S
        time.sleep(max(0.0, due - time.perf_counter()))


if __name__ == "__main__":
    main()
