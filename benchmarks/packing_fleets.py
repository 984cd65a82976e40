"""Manifests and hosts whose packing takes some thought, each from a seed: the product's shape, 5 to 30 partitions.

Every host is filled by cutting it into partitions, up to some slack: so a layout is there before anything is changed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from random import Random

from rarms_iac.model.state import Partition, State
from rarms_iac.storage.snapshot_file import write_snapshot
from tests.builders_plan import facts, partition, settings

MIB = 2**20
KINDS = ("equal", "unequal", "narrow", "pins", "running", "unmanaged", "mixed")


@dataclass(frozen=True, slots=True, kw_only=True)
class Fleet:
    """A manifest, and what its hosts look like; hosts that run nothing have no snapshot."""

    name: str
    manifest: str
    snapshots: Mapping[str, bytes]


@dataclass(slots=True, kw_only=True)
class _Host:
    name: str
    processors: int
    memory: int  # MiB
    free: int = 100  # per cent of the whole host
    free_memory: int = 0


@dataclass(slots=True, kw_only=True)
class _Part:
    name: str
    host: _Host  # that it was cut out of
    share: int  # per cent of that host
    memory: int
    processors: int = 0  # 0: as many as its host has
    pinned: Sequence[str] = ()


def fleet(seed: int, *, partitions: int = 0, hosts: int = 0) -> Fleet:
    """Draw a fleet; the kind goes by the seed in turn, the size is drawn unless given."""
    random, kind = Random(seed), KINDS[seed % len(KINDS)]
    number = hosts or random.randint(2, 12)
    machines = [_host(random, at, unequal=kind in ("unequal", "mixed")) for at in range(number)]
    unmanaged = {}
    if kind in ("unmanaged", "mixed"):
        unmanaged = {host.name: _unmanaged(random, host) for host in machines if random.random() < 0.6}
    wanted = partitions or random.randint(max(5, number), 30)
    parts = _cut(random, machines, wanted, narrow=kind in ("narrow", "mixed"))
    if kind in ("pins", "mixed"):
        for part in random.sample(parts, len(parts) // 3):
            others = [host.name for host in random.sample(machines, random.randint(0, min(3, number)))]
            part.pinned = sorted({part.host.name, *others})
    running: dict[str, list[_Part]] = {}
    if kind in ("running", "mixed"):
        for part in parts:
            if random.random() < 0.8:
                running.setdefault(part.host.name, []).append(part)
    snapshots = {
        host.name: _snapshot(host, running.get(host.name, ()), unmanaged.get(host.name))
        for host in machines
        if host.name in running or host.name in unmanaged
    }
    if running:  # what runs was made for other numbers
        for part in random.sample(parts, max(1, len(parts) // 6)):
            part.share = max(1, part.share + random.choice((-3, -2, -1, 1, 2, 3)))
    return Fleet(name=f"{kind}/{seed}", manifest=_manifest(machines, parts), snapshots=snapshots)


def _host(random: Random, at: int, *, unequal: bool) -> _Host:
    processors = random.choice((2, 4, 8)) if unequal else 4
    memory = 2048 * processors
    return _Host(name=f"host-{at:02}", processors=processors, memory=memory, free_memory=memory)


def _unmanaged(random: Random, host: _Host) -> Partition:
    percent, memory = random.randint(5, 30), random.choice((256, 512, 1024))
    host.free -= percent
    host.free_memory -= memory
    own = settings(f"other-{host.name}", processors=host.processors, reserve=percent, ram=f"{memory} MiB")
    return partition(own, application=None)


def _cut(random: Random, hosts: Sequence[_Host], number: int, *, narrow: bool) -> list[_Part]:
    """As many pieces on each host, up to one; what is left over is up to a tenth of it."""
    parts: list[_Part] = []
    for at, host in enumerate(hosts):
        pieces = number // len(hosts) + (at < number % len(hosts))
        slack = random.choice((0, 1, 2, 3, 5, 10))
        room, memory = max(pieces, host.free - slack), host.free_memory * (100 - slack) // 100 // 64
        if narrow and random.random() < 0.7:
            parts += _narrow(random, host, pieces, memory)
            continue
        shares, memories = _pieces(random, room, pieces), _pieces(random, memory, pieces)
        parts += [
            _Part(name="", host=host, share=share, memory=64 * each)
            for share, each in zip(shares, memories, strict=True)
        ]
    random.shuffle(parts)
    for at, part in enumerate(parts):
        part.name = f"part-{at:03}"
    return parts


def _pieces(random: Random, whole: int, number: int) -> list[int]:
    """A whole number in so many parts, none of them less than 1."""
    cuts = [0, *sorted(random.sample(range(1, max(whole, number + 1)), number - 1)), max(whole, number)]
    return [high - low for low, high in pairwise(cuts)]


def _narrow(random: Random, host: _Host, pieces: int, memory: int) -> list[_Part]:
    """Partitions of one or two virtual processors, laid onto logical ones while there is room."""
    level = [host.free] * host.processors
    parts = []
    for each in _pieces(random, memory, pieces):
        processors = random.choice((1, 1, 2))
        free = sorted(range(host.processors), key=lambda at: -level[at])[:processors]
        most = min(level[at] for at in free)
        reserve = random.randint(max(1, most // 3), most) if most > 0 else 0
        for at in free:
            level[at] -= reserve
        share = reserve * processors // host.processors  # rounded up again by as little as a point
        parts.append(_Part(name="", host=host, share=share, memory=64 * each, processors=processors))
    return parts


def _snapshot(host: _Host, running: Sequence[_Part], other: Partition | None) -> bytes:
    ours = [
        partition(
            settings(
                part.name,
                processors=part.processors or host.processors,
                reserve=max(0, part.share * host.processors // (part.processors or host.processors)),
                ram=f"{part.memory} MiB",
            ),
            application="fleet",
        )
        for part in running
    ]
    seen = facts(host.name, logical_processors=host.processors, ram=f"{host.memory} MiB")
    machines = sorted([*ours, *([other] if other else [])], key=lambda machine: machine.settings.name)
    return write_snapshot(State(facts=seen, partitions=tuple(machines)))


def _manifest(hosts: Sequence[_Host], parts: Sequence[_Part]) -> str:
    lines = ["schema: rarms/v1", "", "application:", "  name: fleet", "", "hosts:"]
    for host in hosts:
        lines += [f"  {host.name}:", "    provider: simulated", f"    platform: cell-{host.processors}"]
        lines += [f"    logical_processors: {host.processors}", f"    memory: {host.memory} MiB"]
    lines += ["", "components:"]
    for part in parts:
        amount = f"{part.share * part.host.processors / 100:g} LP"
        lines += [f"  {part.name}:", "    criticality: 1", f"    memory: {part.memory} MiB"]
        lines += ["    run: { command: [python3, part.py], samples: { from: per_run }, until: { samples: 20 } }"]
        lines += [f"    cpu: {{ reserve: {amount} }}"]
        lines += [f"    processors: {part.processors}"] if part.processors else []
        lines += [f"    hosts: [{', '.join(part.pinned)}]"] if part.pinned else []
    return "\n".join(lines) + "\n"
