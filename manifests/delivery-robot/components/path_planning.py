"""Plans the robot's way over a map of cells: Dijkstra with the cost of turning, as PPP modifies it."""

import heapq
import random

SIZE = 48
MOVES = ((1, 0), (0, 1), (-1, 0), (0, -1))
TURN = 2  # a turn takes as long as two cells
Cell = tuple[int, int]

_chance = random.Random(3)  # noqa: S311 - the same maps every time


def obstacles() -> set[Cell]:
    """Return a floor with furniture: about every fifth cell is taken, start and goal are free."""
    cells = {(_chance.randrange(SIZE), _chance.randrange(SIZE)) for _ in range(SIZE * SIZE // 5)}
    return cells - {(0, 0), (SIZE - 1, SIZE - 1)}


def shortest(taken: set[Cell], start: Cell, goal: Cell) -> int | None:
    """Return the least cost from start to goal; None where no way leads there."""
    best = {(start, heading): 0 for heading in range(4)}
    queue = [(0, start, heading) for heading in range(4)]
    while queue:
        cost, cell, heading = heapq.heappop(queue)
        if cell == goal:
            return cost
        if cost > best[cell, heading]:
            continue
        for way, (east, south) in enumerate(MOVES):
            there = (cell[0] + east, cell[1] + south)
            if there in taken or not (0 <= there[0] < SIZE and 0 <= there[1] < SIZE):
                continue
            further = cost + 1 + TURN * (way != heading)
            if further < best.get((there, way), further + 1):
                best[there, way] = further
                heapq.heappush(queue, (further, there, way))
    return None


def plan() -> int | None:
    """One job: a new map, and the cost of the best way through it."""
    return shortest(obstacles(), (0, 0), (SIZE - 1, SIZE - 1))
