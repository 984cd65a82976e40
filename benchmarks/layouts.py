"""Whether layouts hold that were measured with the default loads: random layouts on the simulated host.

`python -m benchmarks.layouts [LAYOUTS [FOLDER]]` draws so many layouts (300 unless said) of 1, 2 or 4 LPs, from the
hash of the last commit. Each component has one threshold (mean, p90, p95 or success rate), just what it shows at a
drawn reservation with the load that delays it most. Each layout is measured, planned, applied and proven, and proven
again for longer with another seed. Every fifth layout is measured with each load in one partition, too: the difference
in LP is what the other partitions cost. FOLDER keeps `commit` and `layouts.jsonl`: a run that was killed goes on.
PROCESSES in the environment is the number of processes, 2 unless said.

It fails where more than 1 % of the layouts that have a plan miss in either proof.
"""

import json
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from functools import partial
from multiprocessing import Pool
from pathlib import Path
from random import Random
from shutil import rmtree

import rarms_iac as rarms
from benchmarks.timing import Figure, commit, report
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.measuring.each_load import decisive
from rarms_iac.measuring.measure_request import MeasureRequest
from rarms_iac.measuring.prove import ProveRequest
from rarms_iac.model.outcomes import Missed
from rarms_iac.model.quantities import guaranteed
from rarms_iac.providers.simulated.scheduling.machine import VirtualMachine
from rarms_iac.statistics.distributions import share_interval
from tests.laws.test_layout_laws import draw, slowest

LAYOUTS = 300
PROCESSES = int(os.environ.get("PROCESSES", "2"))
MOST_MISSED = 1.0  # per cent of the layouts
SETTING, PROOF, LONG_PROOF = "5 min", "5 min", "30 min"  # of the host's clock
LONG_SEED = 7
COMPARED_EACH = 5  # every fifth layout is measured with each load in one partition, too
INDEXES = ("mean", "p90", "p95", "success")
ONE_PARTITION = {
    "busy-1": "{{ kind: busy_loop, threads: {lps} }}",
    "bursts-20-1": "{{ kind: bursts, every: 20 ms, threads: {lps} }}",
    "bursts-100-1": "{{ kind: bursts, every: 100 ms, threads: {lps} }}",
}
"""The default loads with a number of threads, which keeps each in one partition."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnLayout:
    """A host and what is to run on it."""

    name: str
    lps: int
    partitions: tuple[VirtualMachine, ...]
    thresholds: tuple[str, ...]  # of `apt`, one a partition
    success_within_ms: tuple[float, ...]  # 0: every answer is a success

    def manifest(self, proof: str = PROOF) -> str:
        """Return the manifest; `proof`: how long a proof may take."""
        loads = [f"  {name}: {text.format(lps=self.lps)}" for name, text in ONE_PARTITION.items()]
        lines = [
            "schema: rarms/v1",
            "application: { name: layout }",
            f"hosts: {{ onboard: {{ logical_processors: {self.lps}, memory: 16 GiB }} }}",
            f"policy: {{ measuring: {{ setting: {SETTING}, proof: {proof} }} }}",
            "interference:",
            *loads,
            "components:",
        ]
        for machine, threshold, within in zip(self.partitions, self.thresholds, self.success_within_ms, strict=True):
            (demand,) = machine.components
            arrival = f", arrival: {{ every: {demand.period_ms:.3f} ms }}" if demand.period_ms else ""
            success = f", success_within: {within:.3f} ms" if within else ""
            lines += [
                f"  {machine.name}:",
                f"    criticality: {1 + self.partitions.index(machine)}",
                f"    apt: {{ {threshold} }}",
                f"    run: {{ command: [{machine.name}], timeout: 10 min{arrival} }}",
                f"    processors: {machine.vps}",
                "    memory: 256 MiB",
                "    cpu: { reserve: measured }",
                f"    simulation: {{ work: {demand.work_ms:.3f} ms, blocked: {demand.blocked_ms:.3f} ms, "
                f"varies: {demand.varies:.0f} %, threads: {demand.threads}{success} }}",
            ]
        return "\n".join(lines) + "\n"


def draw_layout(commit: str, number: int) -> DrawnLayout:
    """Draw a layout: half of them have two LPs, where tails depend most on the number of partitions."""
    name = f"{commit[:12]}/{number}"
    chance = Random(f"thresholds/{name}")
    lps = chance.choice((1, 2, 2, 4))
    partitions = draw(name, lps)
    thresholds, within = [], []
    for machine in partitions:
        shown = slowest([machine], number, most_parts=3, lps=lps)
        index = chance.choice(INDEXES)
        limit = 1.02 * shown[machine.name, "p95" if index == "success" else index]
        within.append(limit if index == "success" else 0.0)
        at_most = f"{index}_response_time: {{ at_most: {limit:.3f} ms }}"
        thresholds.append("success_rate: { at_least: 95 % }" if index == "success" else at_most)
    return DrawnLayout(
        name=name, lps=lps, partitions=partitions, thresholds=tuple(thresholds), success_within_ms=tuple(within)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of a layout."""

    number: int
    lps: int
    planned: bool
    reserved_lp: float = 0.0
    one_partition_lp: float = 0.0  # needed with each load in one partition; 0: not known
    missed: tuple[str, ...] = ()  # component, index and load; of no plan the findings
    missed_long: tuple[str, ...] = ()  # in the long proof


def outcome_of(commit: str, folder: Path, number: int) -> Outcome:
    """Measure, plan, apply and prove a layout."""
    layout, place = draw_layout(commit, number), folder / str(number)
    rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    manifest = place / "rarms.yaml"
    manifest.write_text(layout.manifest(), encoding="utf-8")
    hosts = rarms.load(str(manifest))
    try:
        rarms.measure(hosts)
        plan = rarms.plan(hosts)
    except UseCaseError as problem:
        codes = tuple(sorted({diagnostic.code for diagnostic in problem.findings}))
        return Outcome(number=number, lps=layout.lps, planned=False, missed=codes)
    one_partition_lp = Fraction(0) if number % COMPARED_EACH else _with_one_partition(hosts)
    rarms.apply(plan)
    missed = tuple(sorted(_missed(hosts, ProveRequest())))
    reserved = sum(
        guaranteed(each.settings.reserve, each.settings.processors)
        for each in hosts.open("onboard").observe().partitions
    )
    manifest.write_text(layout.manifest(LONG_PROOF), encoding="utf-8")
    missed_long = tuple(sorted(_missed(rarms.load(str(manifest)), ProveRequest(seed=LONG_SEED))))
    return Outcome(
        number=number,
        lps=layout.lps,
        planned=True,
        reserved_lp=float(reserved),
        one_partition_lp=float(one_partition_lp),
        missed=missed,
        missed_long=missed_long,
    )


def _missed(hosts: Hosts, request: ProveRequest) -> Iterator[str]:
    for proof in rarms.prove(hosts, request).proofs:
        for verdict in proof.verdicts:
            if isinstance(verdict.verdict, Missed):
                yield f"{verdict.measured.component} {verdict.measured.index} with {proof.interference}"


def _with_one_partition(hosts: Hosts) -> Fraction:
    """Return the LPs that are enough with each load in one partition; 0 where a component has no answer."""
    request = MeasureRequest(interference=tuple(ONE_PARTITION))
    answers = [decisive(group) for group in rarms.measure(hosts, request).partitions]
    if any(answer.planned is None for answer in answers):
        return Fraction(0)
    return sum((guaranteed(each.planned or 0, each.experiment.setup.processors) for each in answers), Fraction(0))


def figures(outcomes: Sequence[Outcome]) -> list[Figure]:
    """Return how many layouts were planned, how many missed, and what the other partitions of loads cost."""
    planned = [each for each in outcomes if each.planned]
    rows = [
        Figure(name="layouts", value=len(outcomes), unit=""),
        Figure(name="without a plan", value=len(outcomes) - len(planned), unit=""),
    ]
    for lps in sorted({each.lps for each in planned}):
        own = [each for each in planned if each.lps == lps]
        rows += [
            Figure(name=f"{lps} LP: planned", value=len(own), unit=""),
            Figure(name="  missed in a proof", value=sum(bool(each.missed) for each in own), unit=""),
            Figure(name="  missed in the long one", value=sum(bool(each.missed_long) for each in own), unit=""),
        ]
    amiss = sum(bool(each.missed or each.missed_long) for each in planned)
    compared = [each for each in planned if each.one_partition_lp]
    one = sum(each.one_partition_lp for each in compared)
    return [
        *rows,
        Figure(name="missed", value=100 * amiss / max(1, len(planned)), unit="%", at_most=MOST_MISSED),
        Figure(
            name="  at most, by 95 %", value=100 * share_interval(amiss, max(1, len(planned)), error=0.1)[1], unit="%"
        ),
        Figure(name="reserved", value=sum(each.reserved_lp for each in planned) / max(1, len(planned)), unit="LP"),
        Figure(
            name="more than with loads in one partition",
            value=100 * (sum(each.reserved_lp for each in compared) / one - 1) if one else 0.0,
            unit="%",
        ),
    ]


def commit_of(folder: Path) -> str:
    """Return the commit that a folder's layouts are drawn from: the last one, when the folder is new."""
    file = folder / "commit"
    if not file.exists():
        file.write_text(commit(), encoding="utf-8")
    return file.read_text(encoding="utf-8")


def outcomes_of(folder: Path, layouts: int) -> list[Outcome]:
    """Return the outcome of each layout, in their order; those that the folder has are not run again."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "layouts.jsonl"
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    read = [json.loads(line) for line in lines]
    known = {
        each["number"]: Outcome(**{**each, "missed": (*each["missed"],), "missed_long": (*each["missed_long"],)})
        for each in read
    }
    missing = [number for number in range(layouts) if number not in known]
    with Pool(PROCESSES) as pool, file.open("a", encoding="utf-8") as written:
        for outcome in pool.imap_unordered(partial(outcome_of, commit_of(folder), folder), missing):
            written.write(f"{json.dumps(asdict(outcome))}\n")
            written.flush()
            known[outcome.number] = outcome
            ending = "no plan" if not outcome.planned else ", ".join(outcome.missed + outcome.missed_long) or "held"
            print(f"layout {outcome.number}: {ending}", flush=True)
    return [known[number] for number in range(layouts)]


def main() -> int:
    """Print a table; 1 where too many layouts miss."""
    layouts = int(sys.argv[1]) if len(sys.argv) > 1 else LAYOUTS
    folder = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("/dev/shm/rarms-layouts")
    return report(figures(outcomes_of(folder, layouts)))


if __name__ == "__main__":
    sys.exit(main())
