"""A loop that never waits: one of a busy-loop program's (BLP). A program of its own (`loads.py`)."""

while True:
    pass
