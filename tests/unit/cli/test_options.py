from datetime import date

import click
import pytest
from click.testing import CliRunner

from rarms_iac.app.requests import HostSelection, ManifestSource, PlanLimits, RunOptions, SnapshotFile
from rarms_iac.cli import options
from rarms_iac.cli.commands.help_commands import command_shapes
from rarms_iac.model.system import Disruption
from rarms_iac.views.completion import flags_of


def read_by(
    decorate: object, words: list[str], env: dict[str, str] | None = None
) -> tuple[int, dict[str, object], str]:
    """What a command of these options is called with."""
    called: dict[str, object] = {}

    def function(**given: object) -> None:
        called.update(given)

    assert callable(decorate)
    command = click.command()(decorate(function))
    result = CliRunner().invoke(command, words, env=env)
    return result.exit_code, called, result.output


def test_the_manifest_is_the_one_here_unless_an_option_or_the_environment_says_otherwise() -> None:
    today = ["--today", "2026-01-31"]
    _, default, _ = read_by(options.manifest_options, today)
    _, given, _ = read_by(options.manifest_options, ["-f", "a.yaml", "--overlay", "b.yaml", "--overlay", "c", *today])
    _, environment, _ = read_by(options.manifest_options, today, env={"RARMS_MANIFEST": "robots"})

    day = date(2026, 1, 31)
    assert default["source"] == ManifestSource(today=day)
    assert given["source"] == ManifestSource(manifest="a.yaml", overlays=("b.yaml", "c"), today=day)
    assert environment["source"] == ManifestSource(manifest="robots", today=day)


def test_hosts_and_snapshots() -> None:
    words = ["--host", "b", "--host", "a", "--host", "b", "--snapshot", "a=x.json", "--snapshot", "./y=z.json"]

    _, called, _ = read_by(options.host_or_snapshot_options, words)

    assert called["host_selection"] == HostSelection(
        hosts=("b", "a"),
        snapshots=(
            SnapshotFile(host="a", file="x.json"),
            SnapshotFile(host="", file="./y=z.json"),
        ),
    )


def test_how_far_and_how_long() -> None:
    _, limits, _ = read_by(options.change_options, ["--target", "partition/a", "--max-disruption", "live"])
    _, how, _ = read_by(options.run_options, ["--auto-approve", "--lock-timeout", "1.5s"])

    assert limits["limits"] == PlanLimits(targets=("partition/a",), max_disruption=Disruption.LIVE)
    assert how["how"] == RunOptions(auto_approve=True, lock_timeout_ms=1500)


@pytest.mark.parametrize(
    ("decorate", "words", "message"),
    [
        (options.host_options, ["--host", "Not A Name"], "cannot be the name of a host"),
        (options.host_or_snapshot_options, ["--snapshot", "a="], "names no file"),
        (options.host_or_snapshot_options, ["--snapshot", "a=x", "--snapshot", "a=y"], "more than one"),
        (options.manifest_options, ["--today", "31.1.2026"], "not a day"),
        (options.run_options, ["--lock-timeout", "60"], "units: us, ms, s, min, h"),
        (options.change_options, ["--max-disruption", "none"], "partition_stop"),
        (options.output_option, ["--output", "sraif"], "Did you mean"),
        (options.output_option, ["--output", "text", "--json"], "two outputs"),
    ],
)
def test_what_cannot_be_read_says_what_can(decorate: object, words: list[str], message: str) -> None:
    code, called, output = read_by(decorate, words)

    assert (code, called) == (2, {})
    assert message in " ".join(output.split())


@pytest.mark.parametrize(
    ("words", "stops"),
    [([], False), (["--stop-partitions"], True), (["--auto-approve"], True)],
)
def test_one_flag_approves_whatever_is_asked(words: list[str], *, stops: bool) -> None:
    _, options_read, _ = read_by(options.stop_option, words)

    assert options_read["stop_partitions"] is stops


@pytest.mark.parametrize(
    "command", ["apply", "undo", "destroy", "import", "release", "stop", "start", "measure", "tune"]
)
def test_the_flag_is_the_same_everywhere(command: str) -> None:
    shape = next(shape for shape in command_shapes() if shape.name == command)

    assert "--auto-approve" in flags_of(shape.options)
