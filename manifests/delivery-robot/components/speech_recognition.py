"""Recognises spoken commands: tone energies a frame, compared with known words by dynamic time warping (SRP).

Writes one line a command: `heard <word> ok=<1 or 0> ms=<response time>`.
"""

import math
import random
import sys
import time

RATE, FRAME = 8000, 160
TONES = (300, 500, 800, 1200)
WORDS = {"stop": (300, 1200, 500), "follow": (500, 300, 800), "home": (1200, 800), "deliver": (800, 500, 1200, 300)}
Features = list[tuple[float, ...]]


def spoken(word: str, chance: random.Random) -> list[float]:
    """Return the word as samples: one tone a syllable, at the speaker's own pace, in noise."""
    samples: list[float] = []
    for tone in WORDS[word]:
        length = int(chance.uniform(10, 20)) * FRAME
        samples += [math.sin(2 * math.pi * tone * now / RATE) + chance.gauss(0, 0.4) for now in range(length)]
    return samples


def energy(frame: list[float], tone: int) -> float:
    """Return the energy of one tone (Goertzel's filter)."""
    turn = 2 * math.cos(2 * math.pi * tone / RATE)
    last = before = 0.0
    for sample in frame:
        last, before = sample + turn * last - before, last
    return last * last + before * before - turn * last * before


def features(samples: list[float]) -> Features:
    """For every frame the share of each tone."""
    frames = [samples[start : start + FRAME] for start in range(0, len(samples), FRAME)]
    energies = [[energy(frame, tone) for tone in TONES] for frame in frames]
    return [tuple(one / (sum(line) or 1.0) for one in line) for line in energies]


def distance(one: Features, other: Features) -> float:
    """How far two utterances are apart when time may stretch."""
    costs = [0.0] + [math.inf] * len(other)
    for frame in one:
        row = [math.inf]
        for number, known in enumerate(other):
            step = min(costs[number], costs[number + 1], row[number])
            row.append(step + math.dist(frame, known))
        costs = row
    return costs[-1]


def main() -> None:
    """Commands until its reader has gone, or as many as the first argument says."""
    chance = random.Random(2)  # noqa: S311 - the same commands every time
    known = {word: features(spoken(word, random.Random(word))) for word in WORDS}  # noqa: S311 - the same voice
    commands = int(sys.argv[1]) if len(sys.argv) > 1 else sys.maxsize
    for _ in range(commands):
        word = chance.choice(sorted(WORDS))
        samples = spoken(word, chance)
        started = time.perf_counter()
        utterance = features(samples)
        heard = min(known, key=lambda name: distance(utterance, known[name]))
        response = 1000 * (time.perf_counter() - started)
        print(f"heard {heard} ok={int(heard == word)} ms={response:.3f}", flush=True)


if __name__ == "__main__":
    main()
