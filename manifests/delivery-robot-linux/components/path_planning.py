"""Plans the robot's way over a map of cells: A* with the cost of turning, as PPP modifies Dijkstra's algorithm."""

import heapq
import random

SIZE = 48
MOVES = ((1, 0), (0, 1), (-1, 0), (0, -1))
TURN = 2  # a turn takes as long as two cells
Cell = tuple[int, int]

_chance = random.Random(3)  # noqa: S311 - the same maps every time


def obstacles() -> frozenset[Cell]:
    """Return a floor with furniture: about every eighth cell is taken, the corners are free."""
    taken = {(_chance.randrange(SIZE), _chance.randrange(SIZE)) for _ in range(SIZE * SIZE // 8)}
    return frozenset(taken - {(0, 0), (SIZE - 1, SIZE - 1)})


def cheapest(taken: frozenset[Cell], start: Cell, goal: Cell) -> int | None:
    """Return the least cost from start to goal; None where no way leads there."""

    def at_least(cell: Cell) -> int:
        return abs(goal[0] - cell[0]) + abs(goal[1] - cell[1])

    best = {(start, heading): 0 for heading in range(4)}
    queue = [(at_least(start), 0, start, heading) for heading in range(4)]
    while queue:
        _, cost, cell, heading = heapq.heappop(queue)
        if cell == goal:
            return cost
        if cost > best[cell, heading]:
            continue
        for way, (east, south) in enumerate(MOVES):
            neighbour = (cell[0] + east, cell[1] + south)
            if neighbour in taken or not (0 <= neighbour[0] < SIZE and 0 <= neighbour[1] < SIZE):
                continue
            further = cost + 1 + TURN * (way != heading)
            if further < best.get((neighbour, way), further + 1):
                best[neighbour, way] = further
                heapq.heappush(queue, (further + at_least(neighbour), further, neighbour, way))
    return None


def plan() -> int | None:
    """One job: a new map, and the cost of the best way through it."""
    return cheapest(obstacles(), (0, 0), (SIZE - 1, SIZE - 1))
