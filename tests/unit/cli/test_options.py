from dataclasses import dataclass, field, fields
from datetime import date

import click
import pytest
from click.testing import CliRunner

from rarms_iac.app.requests import (
    DatedManifestSource,
    HostSelection,
    ManifestSource,
    PlanLimits,
    RunOptions,
    SnapshotFile,
    SnapshotSelection,
    option,
)
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.cli.command import parameters_of, request_of
from rarms_iac.cli.group import all_commands
from rarms_iac.cli.messages import OutputOptions, StopOptions
from rarms_iac.cli.session import Session
from rarms_iac.measuring.measure_request import MeasureRequest
from rarms_iac.measuring.run_component import RunRequest
from rarms_iac.measuring.tune import TuneRequest
from rarms_iac.model.system import Disruption
from rarms_iac.views.terminal import this_terminal

DAY = date(2026, 1, 31)


def read_by(request: type, *words: str, env: dict[str, str] | None = None) -> object:
    """The request that these words are read into; what click says where they cannot be."""
    read: list[object] = []
    command = click.Command(
        "tried", params=parameters_of(request), callback=lambda **values: read.append(request_of(request, values))
    )
    result = CliRunner().invoke(command, words, env=env)
    if isinstance(result.exception, RequestError):
        return str(result.exception)
    return read[0] if read else " ".join(result.output.split())


def test_manifest_is_here_unless_option_or_environment_says() -> None:
    today = ("--today", DAY.isoformat())

    default = read_by(DatedManifestSource, *today)
    given = read_by(DatedManifestSource, "-f", "a.yaml", "--overlay", "b.yaml", "--overlay", "c", *today)
    environment = read_by(DatedManifestSource, *today, env={"RARMS_MANIFEST": "robots"})

    assert default == DatedManifestSource(today=DAY)
    assert given == DatedManifestSource(manifest="a.yaml", overlays=("b.yaml", "c"), today=DAY)
    assert environment == DatedManifestSource(manifest="robots", today=DAY)


def test_day_is_asked_for_only_where_it_counts() -> None:
    with_day = {
        name for name, command in all_commands().items() if any("--today" in option.opts for option in command.params)
    }

    assert with_day == {"validate", "plan", "apply"}
    assert "No such option" in str(read_by(ManifestSource, "--today", DAY.isoformat()))


def test_hosts_and_snapshots() -> None:
    words = ("--host", "b", "--host", "a", "--host", "b", "--snapshot", "a=x.json", "--snapshot", "./y=z.json")

    assert read_by(SnapshotSelection, *words) == SnapshotSelection(
        hosts=("b", "a"), snapshots=(SnapshotFile(host="a", file="x.json"), SnapshotFile(host="", file="./y=z.json"))
    )


def test_how_far_and_how_long() -> None:
    limits = read_by(PlanLimits, "--target", "partition/a", "--max-disruption", "live")

    assert limits == PlanLimits(targets=("partition/a",), max_disruption=Disruption.LIVE)
    assert isinstance(limits, PlanLimits)
    assert limits.max_disruption is Disruption.LIVE
    assert read_by(RunOptions, "--auto-approve", "--lock-timeout", "1.5s") == RunOptions(
        auto_approve=True, lock_timeout_ms=1500
    )


@pytest.mark.parametrize(
    ("request_type", "words", "message"),
    [
        (HostSelection, ["--host", "Not A Name"], "cannot be the name of a host"),
        (SnapshotSelection, ["--snapshot", "a="], "does not have a file"),
        (SnapshotSelection, ["--snapshot", "a=x", "--snapshot", "a=y"], "more than one"),
        (DatedManifestSource, ["--today", "31.1.2026"], "not a day"),
        (RunOptions, ["--lock-timeout", "60"], "Units: us, ms, s, min, h"),
        (PlanLimits, ["--max-disruption", "none"], "partition_stop"),
        (MeasureRequest, ["--samples", "1"], "1 is too small: it must be at least 2."),
        (TuneRequest, ["--repeat"], "needs --strategy paper"),
        (RunRequest, ["--for", "0s"], "at least 1 ms"),
        (RunRequest, ["--for", "1s", "--samples", "2"], "not both"),
    ],
)
def test_what_cannot_be_read_says_what_can(request_type: type, words: list[str], message: str) -> None:
    answer = read_by(request_type, *words)

    assert isinstance(answer, str)
    assert message in answer


@pytest.mark.parametrize(
    ("options", "message"),
    [(OutputOptions(output=("sraif",)), "Did you mean"), (OutputOptions(output=("text", "json")), "two outputs")],
)
def test_an_answer_goes_to_places_of_its_own(options: OutputOptions, message: str) -> None:
    with pytest.raises(RequestError, match=message):
        options.targets(Session(terminal=this_terminal()))


def test_partitions_stop_only_on_request() -> None:
    assert not StopOptions().stops(on_busy_host=False)
    assert StopOptions(stop_partitions=True).stops(on_busy_host=False)
    with pytest.raises(RequestError, match="Give only one of"):
        StopOptions(stop_partitions=True).stops(on_busy_host=True)


@pytest.mark.parametrize("name", ["apply", "undo", "destroy", "import", "release", "stop", "start"])
def test_the_flag_is_the_same_everywhere(name: str) -> None:
    command = all_commands()[name]

    assert any("--auto-approve" in option.opts for option in command.params)


@pytest.mark.parametrize("name", ["measure", "tune", "select", "prove"])
def test_measuring_commands_have_no_auto_approve(name: str) -> None:
    assert not any("--auto-approve" in option.opts for option in all_commands()[name].params)


def test_no_command_has_an_option_twice() -> None:
    for name, command in all_commands().items():
        given = [word for option in command.params for word in (option.name, *option.opts) if word]
        named = [word for word in given if word.startswith("-")]
        assert len(named) == len(set(named)), name
        assert len({option.name for option in command.params}) == len(command.params), name


def test_a_field_without_metadata_is_not_asked_for() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Asked:
        asked: int | None = option("--asked", help="A number.")
        not_asked: int = field(default=3)

    assert [parameter.name for parameter in parameters_of(Asked)] == ["asked"]
    assert read_by(Asked, "--asked", "2") == Asked(asked=2)
    assert len(fields(Asked)) == 2


@pytest.mark.parametrize("name", [name for name in all_commands() if name != "completion"])
def test_missing_required_option_is_named(name: str) -> None:
    command = all_commands()[name]
    required = [parameter for parameter in command.params if isinstance(parameter, click.Option) and parameter.required]

    for parameter in required:
        with pytest.raises(click.MissingParameter):
            parameter.process_value(click.Context(command), parameter.get_default(click.Context(command)))
