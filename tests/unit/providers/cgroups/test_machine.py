"""The processors of a Linux machine, from a copy of its `/sys`."""

from pathlib import Path

import pytest

from rarms_iac.model.state import ProcessorKind
from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.providers.cgroups.machine import read_facts
from tests.builders import a_host

pytestmark = pytest.mark.needs("linux")


class _Copy(LinuxEffects):
    """This machine, with other files about its processors."""

    def __init__(self, files: dict[str, str]) -> None:
        self._files = {Path("/sys/devices/system/cpu") / name: text for name, text in files.items()}

    def has_file(self, path: Path) -> bool:
        return path in self._files if "cpu" in path.parts else super().has_file(path)

    def read(self, path: Path) -> str:
        return self._files[path] if "cpu" in path.parts else super().read(path)


FOUR = {"online": "0-3"}
PAIR = {f"cpu{number}/topology/thread_siblings_list": "0-1" for number in (0, 1)}
SINGLE = {f"cpu{number}/topology/thread_siblings_list": str(number) for number in (2, 3)}


@pytest.mark.parametrize(
    ("files", "kinds"),
    [
        ({}, ()),
        ({f"cpu{number}/cpu_capacity": "1024" for number in range(4)}, ()),
        (PAIR | SINGLE, (ProcessorKind(processors=2, threads=1), ProcessorKind(processors=2, threads=2))),
        (
            {f"cpu{number}/cpu_capacity": "446" if number else "1024" for number in range(4)},
            (ProcessorKind(processors=1, capacity=1024), ProcessorKind(processors=3, capacity=446)),
        ),
        (
            {f"cpu{number}/cpufreq/base_frequency": "2400000" if number else "3200000" for number in range(4)},
            (ProcessorKind(processors=1, base_mhz=3200), ProcessorKind(processors=3, base_mhz=2400)),
        ),
    ],
    ids=["unknown", "alike", "threads", "capacity", "frequency"],
)
def test_processors_that_differ_are_told_by_kind(files: dict[str, str], kinds: tuple[ProcessorKind, ...]) -> None:
    assert read_facts(a_host(), _Copy(FOUR | files)).processor_kinds == kinds
