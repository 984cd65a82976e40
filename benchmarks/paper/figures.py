"""Writes docs/figures/*.svg and docs/paper-figures.md: the paper's figures on the simulated host, next to its numbers.

The same code gives the same bytes; tests hold the numbers with fewer jobs.
"""

import subprocess
from pathlib import Path

from benchmarks.paper.drawing import Chart, draw
from benchmarks.paper.experiments import FDP, PPP, SRP, VSP, Loaded, figure_1, figure_3, figure_3_together, figure_4

DOCS = Path(__file__).resolve().parents[2] / "docs"
SOURCES = ("rarms_iac/providers/simulated", "benchmarks/paper", "manifests/delivery-robot")
SEEDS = (1, 2, 3)
JOBS = 300
UNTIL_MS = 20_000.0
TOGETHER = (0, 2, 5, 10, 15)

PARAMETERS = """\
## Parameters of each figure

| parameter | value | where | figures |
|---|---|---|---|
| work, blocked time and variation of FDP | 61.6 ms, 26.4 ms, 5 % | `manifests/delivery-robot` | 1, 3, 4 |
| the demands of SRP, VSP and PPP | 50 ms; 2 ms every 33 ms; 20 ms and 30 ms blocked | `manifests/delivery-robot` | 3 |
| window of a reserve and of unused claim | 100 ms | `machine.py` | 1: the bend at 70 % |
| saved claim before an interruption; slice of unclaimed time | 20 ms; 10 ms | `hypervisor.py` | 1, a little |
| weight of P2 | 10000 | `rarms measure` | 1: with Table 1's 100 P1 gets a third more at 10 % |
| interrupts of an idle machine | 1 % | `machine.py` | 1, 3, 4 |
| thread priorities 30 and 31, 8 | as in the paper | `experiments.py` | 3 |
| turn of a thread | 31.2 ms | `hypervisor.py` | 3: the degradation of VSP and PPP |
| decoding a frame | 4 ms | `simulation.py` | 3, 4 |
| painting a frame, and its interrupts, on the machine itself | 2 ms, 0.2 ms | `simulation.py` | 3 |
| traps of a frame, and the parent's emulation, in a partition | 10 ms, 16 ms | `simulation.py` | 4: the peak at two |
| memory of a system and of a browser | 150 MiB, 130 MiB | `simulation.py` | 4: the fall towards ten |
| a disk read, and the largest share of frames with it | 12 ms, a third | `simulation.py` | 4: the fall towards ten |"""


def main() -> None:
    """Run all three experiments and writes what they show."""
    first, three, four = figure_1(JOBS, SEEDS), figure_3(UNTIL_MS, SEEDS), figure_4(JOBS, SEEDS)
    together = figure_3_together(UNTIL_MS, SEEDS, TOGETHER)
    _write(DOCS / "figures" / "figure-1.svg", draw(_chart_1(first)))
    _write(DOCS / "figures" / "figure-3.svg", draw(_chart_3(three)))
    _write(DOCS / "figures" / "figure-4.svg", draw(_chart_4(four)))
    _write(DOCS / "paper-figures.md", "\n".join(_page(first, three, together, four)))


def _commit() -> str:
    """Return the last commit that changed what the figures are made of: the same code gives the same bytes."""
    words = ["git", "log", "-1", "--format=%h", "--abbrev=9", "--", *SOURCES]
    return subprocess.run(words, check=True, capture_output=True, text=True, cwd=DOCS.parent).stdout.strip()


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_text(text, encoding="utf-8", newline="\n")


def _chart_1(curve: dict[int, float]) -> Chart:
    return Chart(
        title="Face detection: response time by reservation",
        across="CPU reservation of P1 (%)",
        up="mean response time (ms)",
        lines={"simulated": list(curve.items()), "88 ms (paper, 70 %)": [(10, 88), (100, 88)]},
        span=(0, 100),
        most=800,
    )


def _chart_3(three: list[Loaded]) -> Chart:
    return Chart(
        title="One operating system: what a job takes, without load = 1",
        across="processors used by the browsers (%)",
        up="mean response time, times that without load",
        lines={
            name: [(point.utilisation, point.response_ms[part] / three[0].response_ms[part]) for point in three[:14]]
            for name, part in (("FDP, at 30", FDP), ("SRP, at 31", SRP), ("VSP, at 8", VSP), ("PPP, at 8", PPP))
        },
        span=(0, 100),
        most=12.5,
    )


def _chart_4(four: dict[tuple[int, int], dict[int, float]]) -> Chart:
    return Chart(
        title="Face detection: response time by browsers in P2",
        across="browsers that stream video",
        up="mean response time (ms)",
        lines={f"{p1}/{p2}": list(line.items()) for (p1, p2), line in four.items()},
        span=(0, 10),
        most=200,
    )


def _page(
    curve: dict[int, float],
    three: list[Loaded],
    together: dict[int, dict[str, float]],
    four: dict[tuple[int, int], dict[int, float]],
) -> list[str]:
    return [
        "# The paper's figures on the simulated host",
        "",
        "`make figures` writes this page from the parameters of `manifests/delivery-robot`. For the model of "
        "the processors,",
        "see [scheduling-model.md](scheduling-model.md). All figures use the same parameters, except those "
        "that the paper",
        "varied. The values are means of "
        f"{JOBS} jobs (Fig. 3: of {UNTIL_MS / 1000:g} s) for each of {len(SEEDS)} seeds.",
        f"Run with commit {_commit()}, the last one before the run that changed the simulated host or the parameters.",
        "",
        *_table_1(curve),
        *_table_3(three),
        *_table_together(together),
        *_table_4(four),
        *PARAMETERS.splitlines(),
        "",
    ]


def _table_1(curve: dict[int, float]) -> list[str]:
    said = {10: "600 to 800", 70: "88"}
    return [
        "## Fig. 1: face detection against busy loops",
        "",
        "P2 reserves the remaining time and has the weight 10000, as in `rarms measure`. In the paper's "
        "Table 1, both weights",
        "are 100. With these weights, P1 would get a third of the idle time of its second VP, and the value "
        "at 10 % would be",
        "about 465 ms.",
        "",
        "![Response time falls with the reservation](figures/figure-1.svg)",
        "",
        "| P1 reserves | mean response time (ms) | the paper |",
        "|---:|---:|---|",
        *(f"| {cr} % | {ms:.1f} | {said.get(cr, '')} |" for cr, ms in curve.items()),
        "",
    ]


def _table_3(three: list[Loaded]) -> list[str]:
    return [
        "## Fig. 3: one operating system, no partitions",
        "",
        "Each component runs alone with the browsers. FDP and SRP have their task classes at priorities 30 "
        "and 31, VSP and",
        "PPP have the ordinary priority. In the paper, FDP and SRP do not change up to 100 % utilisation. "
        "VSP and PPP degrade",
        "above about 70 %.",
        "",
        "![Classes stay flat, ordinary threads degrade](figures/figure-3.svg)",
        "",
        "| browsers | used by browsers | FDP (ms) | SRP (ms) | SRP in time | VSP (ms) | VSP in time | PPP (ms) |",
        "|---:|---:|---:|---:|---:|---:|---:|---:|",
        *(_row_3(point) for point in three),
        "",
    ]


def _table_together(together: dict[int, dict[str, float]]) -> list[str]:
    names = (FDP, SRP, VSP, PPP)
    return [
        "**All four together.** The table shows mean response times in ms. FDP and SRP do not change here "
        "either. The jobs of",
        "SRP follow each other without a pause. SRP and FDP use 1.7 of the two LPs. So VSP and PPP are late "
        "even without a",
        "browser, and the table does not show the start of their degradation. For this reason, the figure "
        "has each component",
        "alone. From ten browsers on, the queue of VSP grows during the whole run.",
        "",
        _row("browsers", "FDP", "SRP", "VSP", "PPP"),
        "|---:|---:|---:|---:|---:|",
        *(_row(str(number), *(f"{ms[name]:.1f}" for name in names)) for number, ms in together.items()),
        "",
    ]


def _row_3(loaded: Loaded) -> str:
    ms = {name: f"{value:.1f}" for name, value in loaded.response_ms.items()}
    return (
        f"| {loaded.browsers} | {loaded.utilisation:.0f} % | {ms[FDP]} | {ms[SRP]} | {loaded.success_rate[SRP]:.0f} % "
        f"| {ms[VSP]} | {loaded.throughput[VSP]:.1f} /s | {ms[PPP]} |"
    )


def _table_4(four: dict[tuple[int, int], dict[int, float]]) -> list[str]:
    said = {0: "88 to 100", 1: "up to 184 to 194 at one or two", 2: "up to 184 to 194 at one or two", 10: "150 to 175"}
    pairs = list(four)
    browsers = list(four[pairs[0]])
    return [
        "## Fig. 4: face detection against browsers",
        "",
        "The table shows mean response times in ms, for reserves of P1 and P2 in per cent. In the paper, a "
        "reservation does",
        "not hide interrupts.",
        "",
        "![Browsers slow face detection at every reservation](figures/figure-4.svg)",
        "",
        _row("browsers", *(f"{p1}/{p2}" for p1, p2 in pairs), "the paper"),
        "|---:|" + "---:|" * len(pairs) + "---|",
        *(
            _row(str(number), *(f"{four[pair][number]:.1f}" for pair in pairs), said.get(number, ""))
            for number in browsers
        ),
        "",
    ]


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
