"""Recognises spoken commands with pocketsphinx and a grammar (SRP).

Writes one line a command: `heard <command> ok=<1 or 0> ms=<response time>`.
Usage: speech_recognition.py [--period-ms MS] [COMMANDS]
"""

import argparse
import itertools
import time
import wave
from pathlib import Path

from pocketsphinx import Decoder

DATA = Path(__file__).resolve().parent.parent / "data"
GRAMMAR = """#JSGF V1.0;
grammar commands;
public <command> = stop | (follow me) | (turn around) | <go> | <bring>;
<go> = go (left | right | (to the (kitchen | door | office)));
<bring> = bring (the | me the) (parcel | letter | coffee);
"""


def sound(path: Path) -> bytes:
    """Return the samples of a recording: 16 bit, 16 kHz, mono."""
    with wave.open(str(path)) as recording:
        samples: bytes = recording.readframes(recording.getnframes())
        return samples


def understand(decoder: Decoder, samples: bytes) -> str:
    """Return the command that was most probably spoken; empty where none was."""
    decoder.start_utt()
    decoder.process_raw(samples, full_utt=True)
    decoder.end_utt()
    best = decoder.hyp()
    return best.hypstr if best else ""


def main() -> None:
    """Listen to one command a period until its reader has gone, or to as many as the arguments say."""
    options = argparse.ArgumentParser()
    options.add_argument("--period-ms", type=float, default=0.0)
    options.add_argument("commands", type=int, nargs="?")
    asked = options.parse_args()
    decoder = Decoder(loglevel="FATAL", lm=None)
    decoder.add_jsgf_string("commands", GRAMMAR)
    decoder.activate_search("commands")
    spoken = [(path.stem.replace("-", " "), sound(path)) for path in sorted(DATA.glob("*.wav"))]
    due = time.perf_counter()
    for command, samples in itertools.islice(itertools.cycle(spoken), asked.commands):
        time.sleep(max(0.0, due - time.perf_counter()))
        started = due if asked.period_ms else time.perf_counter()
        heard = understand(decoder, samples)
        response = 1000 * (time.perf_counter() - started)
        print(f"heard {heard or 'nothing'} ok={int(heard == command)} ms={response:.3f}", flush=True)
        due += asked.period_ms / 1000


if __name__ == "__main__":
    main()
