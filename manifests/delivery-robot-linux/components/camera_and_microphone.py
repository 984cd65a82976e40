"""Makes what the robot sees and hears, once: frames with a face in them, and spoken commands.

Writes `data/frame-*.png` with `data/faces.json` (where the face of each frame is), and `data/*.wav`, one a command.
"""

import json
import subprocess
import tempfile
from pathlib import Path

import cv2
import numpy as np
from skimage import data

DATA = Path(__file__).resolve().parent.parent / "data"
WIDTH, HEIGHT, FRAMES = 960, 540, 12
FACE = (175, 65, 95)  # left, top and size of the face in scikit-image's photograph of 512 x 512 pixels
COMMANDS = ("stop", "go left", "go right", "follow me", "turn around", "go to the kitchen", "bring the parcel")


def frame(number: int, photograph: np.ndarray) -> tuple[np.ndarray, list[int]]:
    """Return the photograph in a dim room, nearer or farther, in more or less light, and where its face is."""
    chance = np.random.default_rng(number)
    scale = chance.uniform(0.7, 1.0)
    person = cv2.resize(photograph, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    left, top = (int(chance.integers(0, room - person.shape[0] + 1)) for room in (WIDTH, HEIGHT))
    room = np.full((HEIGHT, WIDTH, 3), 60.0)
    room[top : top + person.shape[0], left : left + person.shape[1]] = person
    lit = np.clip(room * chance.uniform(0.7, 1.1), 0, 255).astype(np.uint8)
    return lit, [left + round(FACE[0] * scale), top + round(FACE[1] * scale), round(FACE[2] * scale)]


def speak(command: str) -> None:
    """Write the command as 16 kHz mono with 0.3 s of silence around it, as the recogniser's model expects."""
    with tempfile.NamedTemporaryFile(suffix=".wav") as spoken:
        subprocess.run(["espeak-ng", "-v", "en-us", "-s", "140", "-w", spoken.name, command], check=True)
        heard = DATA / f"{command.replace(' ', '-')}.wav"
        subprocess.run(
            ["sox", "-R", spoken.name, "-r", "16000", "-c", "1", "-b", "16", heard, "pad", "0.3", "0.3"], check=True
        )


def main() -> None:
    """Write all of it below `data`."""
    DATA.mkdir(exist_ok=True)
    photograph = cv2.cvtColor(data.astronaut(), cv2.COLOR_RGB2BGR)
    faces = {}
    for number in range(FRAMES):
        name = f"frame-{number:02}.png"
        picture, faces[name] = frame(number, photograph)
        cv2.imwrite(str(DATA / name), picture)
    (DATA / "faces.json").write_text(json.dumps(faces, indent=1) + "\n", encoding="ascii")
    for command in COMMANDS:
        speak(command)


if __name__ == "__main__":
    main()
