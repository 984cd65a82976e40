"""How often a distant host is gone to: a plan, drift and status look once, and an apply has a batch a partition."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import pytest

from rarms_iac.app.applying import apply
from rarms_iac.app.drift import look_for_drift
from rarms_iac.app.hosts import Hosts, load
from rarms_iac.app.planning import plan
from rarms_iac.app.status import overview_of
from rarms_iac.applying.run_report import RunEnding
from rarms_iac.providers.cgroups.provider import STATE_FOLDER
from rarms_iac.providers.channel import CommandResult
from tests.contracts.benches import forget_groups, shell_channel, slice_of
from tests.system.test_linux_walk import MANIFEST

pytestmark = [pytest.mark.needs("control-groups")]


@dataclass
class Counter:
    """A channel to this machine that counts the commands it runs."""

    commands: int = 0
    target: str = "ann@onboard"

    def run(self, command: str, data: bytes, silence_s: float) -> CommandResult:
        self.commands += 1
        return shell_channel().run(command, data, silence_s)

    def taken(self) -> int:
        """How many commands since this was asked last."""
        taken, self.commands = self.commands, 0
        return taken


@pytest.fixture
def channel() -> Counter:
    return Counter()


@pytest.fixture
def robot(tmp_path: Path, channel: Counter) -> Iterator[Hosts]:
    (tmp_path / "rarms.yaml").write_text(MANIFEST.format(slice=slice_of(tmp_path)), encoding="utf-8")
    yield load(str(tmp_path), channels={"onboard": channel})
    forget_groups(tmp_path)
    shutil.rmtree(STATE_FOLDER / slice_of(tmp_path), ignore_errors=True)


def test_a_distant_host_is_looked_at_once(robot: Hosts, channel: Counter) -> None:
    made = plan(robot)
    assert channel.taken() == 1

    assert apply(made, channels=robot.channels).ending is RunEnding.DONE
    channel.taken()

    look_for_drift(robot)
    assert channel.taken() == 1
    overview_of(robot)
    assert channel.taken() == 1
    assert not plan(robot).has_changes, "a new look sees what was applied"


def test_neighbouring_steps_of_one_partition_go_in_one_round_trip(robot: Hosts, channel: Counter) -> None:
    made = plan(robot)
    batches = [name for name, _ in groupby(step.address.partition for step in made.hosts[0].steps)]
    channel.taken()

    apply(made, channels=robot.channels)

    assert len(made.hosts[0].steps) > 2 * len(batches)
    assert channel.taken() <= len(batches) + 6, "six take the host, tidy it, begin, close, look and let go"
