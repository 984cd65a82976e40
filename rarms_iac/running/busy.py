"""A loop that never waits: one of a busy-loop program's (BLP). A program of its own (`loads.py`)."""

if __name__ == "__main__":
    while True:
        pass
