"""Line charts as small SVG files: no library, the same bytes for the same numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

WIDTH, HEIGHT = 560, 330
LEFT, RIGHT, TOP, BOTTOM = 60, 16, 54, 62
COLOURS = ("#0b6bcb", "#c2410c", "#15803d", "#7e22ce")
DASHES = ("", "6 3", "2 3", "8 3 2 3")

Line = Sequence[tuple[float, float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Chart:
    """Lines over one axis, each with a name."""

    title: str
    across: str
    up: str
    lines: Mapping[str, Line]
    span: tuple[float, float]  # the ends of the horizontal axis
    most: float  # the upper end of the vertical axis
    least: float = 0.0


def draw(chart: Chart) -> str:
    """Return the chart as SVG text."""
    low, high = chart.span

    def place(x: float, y: float) -> tuple[float, float]:
        across = (x - low) / (high - low) * (WIDTH - LEFT - RIGHT)
        up = (y - chart.least) / (chart.most - chart.least) * (HEIGHT - TOP - BOTTOM)
        return round(LEFT + across, 1), round(HEIGHT - BOTTOM - up, 1)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" '
        f'font-size="12" role="img" aria-label="{escape(chart.title)}">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>',
        f'<text x="{LEFT}" y="20" font-size="14">{escape(chart.title)}</text>',
    ]
    for step in range(6):
        value = chart.least + (chart.most - chart.least) * step / 5
        _, y = place(low, value)
        parts.append(f'<path d="M{LEFT} {y}H{WIDTH - RIGHT}" stroke="#ddd"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{y + 4}" text-anchor="end">{value:g}</text>')
        x, _ = place(low + (high - low) * step / 5, chart.least)
        label = f"{low + (high - low) * step / 5:g}"
        parts.append(f'<text x="{x}" y="{HEIGHT - BOTTOM + 16}" text-anchor="middle">{label}</text>')
    middle = (LEFT + WIDTH - RIGHT) / 2
    parts.append(f'<text x="{middle}" y="{HEIGHT - BOTTOM + 32}" text-anchor="middle">{escape(chart.across)}</text>')
    parts.append(f'<text x="14" y="{TOP - 14}" font-size="11">{escape(chart.up)}</text>')
    for number, (name, line) in enumerate(chart.lines.items()):
        parts += _line(number, name, [place(x, y) for x, y in line])
    return "\n".join([*parts, "</svg>", ""])


def _line(number: int, name: str, places: Sequence[tuple[float, float]]) -> list[str]:
    colour, dash = COLOURS[number % len(COLOURS)], DASHES[number % len(DASHES)]
    way = " ".join(f"{x},{y}" for x, y in places)
    key = LEFT + number * 126
    y = HEIGHT - 12
    stroke = f'fill="none" stroke="{colour}" stroke-width="2" stroke-dasharray="{dash}"'
    return [
        f'<polyline points="{way}" {stroke}/>',
        *(f'<circle cx="{x}" cy="{y}" r="2.5" fill="{colour}"/>' for x, y in places),
        f'<path d="M{key} {y - 4}h22" {stroke}/>',
        f'<text x="{key + 27}" y="{y}">{escape(name)}</text>',
    ]
