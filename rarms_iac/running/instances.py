"""Runs several instances of one program at once, until the first of them ends. A program of its own (`loads.py`).

Arguments: how many instances, a text that each has to write to standard error before it counts as running (empty:
none), and the program with its arguments, in which `{n}` is the instance's number. Writes `running` once all are.
"""

import queue
import subprocess
import sys
import threading

PIECE = 4096
NOT_THERE = 127


def main(words: list[str]) -> int:
    """Start them all and wait for the first to end, which is none of a load's business."""
    count, expected, *program = words
    messages: queue.Queue[tuple[int, int | None]] = queue.Queue()
    for number in range(int(count)):
        own = [word.replace("{n}", str(number)) for word in program]
        threading.Thread(target=watch, args=(number, own, expected.encode(), messages), daemon=True).start()
    waiting = set(range(int(count)))
    while True:
        number, code = messages.get()
        if code is not None:
            ended = f"ended with exit code {code}" if code >= 0 else f"was ended by signal {-code}"
            sys.stderr.write(f"\ninstance {number + 1} of {count} {ended}\n")
            return 1
        waiting.discard(number)
        if not waiting:
            sys.stdout.write("running\n")
            sys.stdout.flush()


def watch(number: int, program: list[str], expected: bytes, messages: "queue.Queue[tuple[int, int | None]]") -> None:
    """Start an instance, send None when it runs and its exit code at the end, pass on its errors; runs in a thread."""
    nothing = subprocess.DEVNULL
    try:
        process = subprocess.Popen(program, stdin=nothing, stdout=nothing, stderr=subprocess.PIPE)
    except OSError as error:
        sys.stderr.write(f"{program[0]}: {error.strerror or repr(error)}\n")
        messages.put((number, NOT_THERE))
        return
    assert process.stderr is not None
    written, running = b"", not expected
    if running:
        messages.put((number, None))
    while line := process.stderr.readline(PIECE):
        written = (written + line)[-PIECE:]
        if not running and expected in written:
            running = True
            messages.put((number, None))
        sys.stderr.buffer.write(line)
        sys.stderr.flush()
    messages.put((number, process.wait()))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
