"""Finds a face in the camera's frames with OpenCV's Haar cascade (FDP).

Writes one JSON line a frame: the response time in ms, and whether the face was found where it is.
Usage: face_detection.py [FRAMES]
"""

import itertools
import json
import sys
import time
from pathlib import Path

import cv2

DATA = Path(__file__).resolve().parent.parent / "data"
SMALLEST = 50  # pixels; people farther away do not concern the robot


def main() -> None:
    """Look at frame after frame until its reader has gone, or at as many as the first argument says."""
    cv2.setNumThreads(1)
    cascade = cv2.CascadeClassifier(cv2.data.haarcascades + "haarcascade_frontalface_default.xml")
    faces = json.loads((DATA / "faces.json").read_text(encoding="ascii"))
    frames = [(cv2.imread(str(DATA / name)), face) for name, face in faces.items()]
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else None
    for frame, (left, top, size) in itertools.islice(itertools.cycle(frames), wanted):
        started = time.perf_counter()
        grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        found = cascade.detectMultiScale(grey, 1.15, 5, minSize=(SMALLEST, SMALLEST))
        response = 1000 * (time.perf_counter() - started)
        x, y = left + size / 2, top + size / 2
        right = any(a < x < a + width and b < y < b + height for a, b, width, height in found)
        print(json.dumps({"response": round(response, 3), "found": right}), flush=True)


if __name__ == "__main__":
    main()
