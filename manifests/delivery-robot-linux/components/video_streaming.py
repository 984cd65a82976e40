"""Streams what the camera sees: frames as JPEG pictures in UDP packets to the operator's screen (VSP).

Writes one JSON line a frame: how many frames were sent, their bytes, and the response time in ms from the moment at
which the frame was due.
Usage: video_streaming.py [--period-ms MS] [FRAMES]
"""

import argparse
import itertools
import json
import socket
import time
from pathlib import Path

import cv2

DATA = Path(__file__).resolve().parent.parent / "data"
QUALITY = 85
ZOOM = 2  # the operator sees 1920 x 1080 pixels
PACKET = 32 * 1024  # bytes


def main() -> None:
    """Send a frame a period until its reader has gone, or as many as the arguments say."""
    options = argparse.ArgumentParser()
    options.add_argument("--period-ms", type=float, default=33.0)
    options.add_argument("frames", type=int, nargs="?")
    asked = options.parse_args()
    cv2.setNumThreads(1)
    frames = [cv2.resize(cv2.imread(str(path)), None, fx=ZOOM, fy=ZOOM) for path in sorted(DATA.glob("frame-*.png"))]
    screen = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)  # where an operator would look
    screen.bind(("127.0.0.1", 0))
    camera = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    due = time.perf_counter()
    for frame in itertools.islice(itertools.cycle(frames), asked.frames):
        time.sleep(max(0.0, due - time.perf_counter()))
        picture = cv2.imencode(".jpg", frame, (cv2.IMWRITE_JPEG_QUALITY, QUALITY))[1].tobytes()
        seen = 0
        for start in range(0, len(picture), PACKET):
            camera.sendto(picture[start : start + PACKET], screen.getsockname())
            seen += len(screen.recv(PACKET))
        response = 1000 * (time.perf_counter() - due)
        print(json.dumps({"frames": 1, "bytes": seen, "response": round(response, 3)}), flush=True)
        due += asked.period_ms / 1000


if __name__ == "__main__":
    main()
