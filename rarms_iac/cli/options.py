"""The options that several commands share, each read once into a frozen value."""

import shlex
from collections.abc import Callable
from dataclasses import replace
from datetime import date
from functools import wraps
from typing import TypeVar, cast

import click
from click.core import ParameterSource

from rarms_iac.app.requests import (
    DEFAULT_MANIFEST,
    HostSelection,
    ManifestSource,
    PlanLimits,
    RunOptions,
    SnapshotFile,
    today_utc,
)
from rarms_iac.cli.session import Session
from rarms_iac.model.names import is_name
from rarms_iac.model.quantities import NotAQuantity, Unit, parse_quantity
from rarms_iac.model.system import Disruption
from rarms_iac.model.wording import quoted
from rarms_iac.views.finding_forms import BadOutput, OutputFormat, parse_outputs

F = TypeVar("F", bound=Callable[..., object])


def manifest_option(function: F) -> F:
    """`--manifest` alone as `manifest: str`."""
    return click.option(
        "-f",
        "--manifest",
        metavar="PATH",
        default=DEFAULT_MANIFEST,
        envvar="RARMS_MANIFEST",
        help="The manifest: a file, or the folder of a rarms.yaml. RARMS_MANIFEST says it too. "
        "[default: rarms.yaml here]",
    )(function)


def manifest_options(function: F) -> F:
    """`--manifest`, `--overlay`, `--today` as one `source: ManifestSource`."""

    def collect(*args: object, manifest: str, overlay: tuple[str, ...], today: date | None, **rest: object) -> object:
        source = ManifestSource(manifest=manifest, overlays=overlay, today=today or today_utc())
        _repeat_in_advice(click.get_current_context(), source)
        return function(*args, source=source, **rest)

    return with_options(
        function,
        collect,
        manifest_option,
        click.option(
            "--overlay", metavar="FILE", multiple=True, help="A file laid over the manifest; repeatable, later wins."
        ),
        click.option(
            "--today",
            metavar="DATE",
            callback=_day,
            help="The day by which acceptances are judged, as 2026-01-31. [default: today in UTC]",
        ),
    )


def _repeat_in_advice(context: click.Context, source: ManifestSource) -> None:
    """From now on, commands that messages recommend name the same manifest and overlays."""
    session = context.find_object(Session)
    if session is None:  # options may be read without a session
        return
    words = [word for overlay in source.overlays for word in ("--overlay", overlay)]
    if context.get_parameter_source("manifest") is ParameterSource.COMMANDLINE:
        words = ["-f", source.manifest, *words]
    session.terminal.manifest_options = f" {shlex.join(words)}" if words else ""


def host_options(function: F) -> F:
    """`--host` as `host_selection: HostSelection`, without snapshots."""

    def collect(*args: object, host: tuple[str, ...], **rest: object) -> object:
        return function(*args, host_selection=HostSelection(hosts=host), **rest)

    return with_options(function, collect, _host_option())


def host_or_snapshot_options(function: F) -> F:
    """`--host` and `--snapshot` as one `host_selection: HostSelection`."""

    def collect(*args: object, host: tuple[str, ...], snapshot: tuple[SnapshotFile, ...], **rest: object) -> object:
        return function(*args, host_selection=HostSelection(hosts=host, snapshots=snapshot), **rest)

    return with_options(
        function,
        collect,
        _host_option(),
        click.option(
            "--snapshot",
            metavar="[HOST[.guest.PARTITION]=]FILE",
            multiple=True,
            callback=_snapshots,
            help="Look at this file instead of the host, as `rarms snapshot` or observe.ps1 wrote it; repeatable.",
        ),
    )


def target_option(function: F) -> F:
    """`--target` as `target: tuple[str, ...]`."""
    return click.option(
        "--target",
        metavar="ADDRESS",
        multiple=True,
        help="Only this, as partition/vision or task/MotionControl; repeatable.",
    )(function)


def change_options(function: F) -> F:
    """`--target`, `--max-disruption` as one `limits: PlanLimits`."""

    def collect(*args: object, target: tuple[str, ...], max_disruption: str | None, **rest: object) -> object:
        limit = None if max_disruption is None else Disruption(max_disruption)
        return function(*args, limits=PlanLimits(targets=target, max_disruption=limit), **rest)

    return with_options(
        function,
        collect,
        target_option,
        click.option(
            "--max-disruption",
            type=click.Choice([disruption.value for disruption in Disruption]),
            help="Hold back what disturbs more. [default: as the policy of the manifest says]",
        ),
    )


def run_options(function: F) -> F:
    """`--auto-approve`, `--lock-timeout`, `--event-timeout` as one `how: RunOptions`."""

    def collect(*args: object, auto_approve: bool, lock_timeout: int, event_timeout: int, **rest: object) -> object:
        how = RunOptions(auto_approve=auto_approve, lock_timeout_ms=lock_timeout, event_timeout_ms=event_timeout)
        return function(*args, how=how, **rest)

    return with_options(
        function,
        collect,
        auto_approve_option,
        lock_timeout_option,
        time_option(
            "--event-timeout",
            default="10 min",
            text="Wait so long for the next word of a Hyper-V host's script. [default: 10 min]",
        ),
    )


def plan_run_options(function: F) -> F:
    """The same with `--out`, for a command that makes its plan itself."""

    def collect(*args: object, how: RunOptions, out: str | None, **rest: object) -> object:
        return function(*args, how=replace(how, out=out), **rest)

    return with_options(
        function,
        collect,
        run_options,
        click.option("--out", metavar="FILE", help="Only write the plan, sealed, for `rarms apply FILE`."),
    )


def time_option(*names: str, default: str | None, text: str) -> Callable[[F], F]:
    """An option that takes a time and gives whole milliseconds; without a default it may be None."""
    return click.option(*names, metavar="TIME", default=default, callback=_time, help=text)


def lock_timeout_option(function: F) -> F:
    """`--lock-timeout` as `lock_timeout: int`, milliseconds."""
    text = "Wait so long for a host that another run holds: 60s, 5min. [default: do not wait]"
    return time_option("--lock-timeout", default="0 s", text=text)(function)


def stop_option(function: F) -> F:
    """`--stop-partitions` as `stop_partitions: bool`; `--auto-approve` says yes to whatever is asked."""

    def collect(*args: object, stop_partitions: bool, auto_approve: bool, **rest: object) -> object:
        if stop_partitions and rest.get("on_busy_host"):
            raise click.UsageError("Give one of --stop-partitions and --on-busy-host.", click.get_current_context())
        if auto_approve and rest.get("write_processors") is False:
            rest["write_processors"] = True
        stops = stop_partitions or (auto_approve and not rest.get("on_busy_host"))
        return function(*args, stop_partitions=stops, **rest)

    return with_options(
        function,
        collect,
        click.option(
            "--stop-partitions",
            is_flag=True,
            help="Stop the application's own partitions meanwhile, and start them again. [default: ask at a terminal]",
        ),
        auto_approve_option,
    )


def samples_option(function: F) -> F:
    """`--samples` as `samples: int | None`."""
    return click.option(
        "--samples", type=click.IntRange(min=2), help="So many a setting. [default: as `run.until` says]"
    )(function)


def busy_option(function: F) -> F:
    """`--on-busy-host` as `on_busy_host: bool`."""
    text = "Measure although something else runs; the data logs say so."
    return click.option("--on-busy-host", is_flag=True, help=text)(function)


def auto_approve_option(function: F) -> F:
    """`--auto-approve`, the one flag for a yes to whatever a command asks, as `auto_approve: bool`."""
    return click.option("--auto-approve", is_flag=True, help="Do not ask.")(function)


def output_option(function: F) -> F:
    """`--output` as `outputs: tuple[Output, ...]`; `--json` is short for `--output json`."""

    def collect(*args: object, output: tuple[str, ...], as_json: bool, **rest: object) -> object:
        try:
            outputs = parse_outputs((*output, "json") if as_json else output)
        except BadOutput as error:
            raise click.UsageError(f"--output: {error}", click.get_current_context()) from error
        if any(output.format is OutputFormat.JSON and output.path is None for output in outputs):
            _tell_in_json(click.get_current_context())
        return function(*args, outputs=outputs, **rest)

    return with_options(
        function,
        collect,
        click.option(
            "--output",
            metavar="FORMAT[=FILE]",
            multiple=True,
            help="How: text, json, sarif, junit, github, markdown; repeatable, each to a place of its own.",
        ),
        json_option,
    )


def json_option(function: F) -> F:
    """`--json` as `as_json: bool`."""
    return click.option(
        "--json", "as_json", is_flag=True, is_eager=True, callback=_json, help="Write JSON for programs."
    )(function)


def with_options(function: F, collect: Callable[..., object], *options: Callable[[F], F]) -> F:
    """A command with these options, in this order, which `collect` takes before it calls the command."""
    wrapped = cast(F, wraps(function)(collect))
    for option in reversed(options):
        wrapped = option(wrapped)
    return wrapped


def _host_option() -> Callable[[F], F]:
    return click.option(
        "--host", metavar="NAME", multiple=True, callback=_hosts, help="Only this host; repeatable. [default: all]"
    )


def _json(context: click.Context, _parameter: click.Parameter, value: bool) -> bool:
    if value:
        _tell_in_json(context)
    return value


def _tell_in_json(context: click.Context) -> None:
    """From now on, whatever ends the command is told in JSON, too."""
    session = context.find_object(Session)
    if session is not None:  # options may be read without a session
        session.as_json = True


def _hosts(_context: click.Context, _parameter: click.Parameter, value: tuple[str, ...]) -> tuple[str, ...]:
    for name in value:
        if not is_name(name):
            raise click.BadParameter(f"{quoted(name)} cannot be the name of a host.")
    return tuple(dict.fromkeys(value))


def _snapshots(
    _context: click.Context, _parameter: click.Parameter, value: tuple[str, ...]
) -> tuple[SnapshotFile, ...]:
    snapshots = tuple(map(_snapshot, value))
    names = [f"{option.host}{option.guest and '.guest.'}{option.guest}" for option in snapshots if option.host]
    for name in names:
        if names.count(name) > 1:
            raise click.BadParameter(f"{name} has more than one.")
    return snapshots


def _snapshot(text: str) -> SnapshotFile:
    host, equals, file = text.partition("=")
    name, _, guest = host.partition(".guest.")
    if equals and is_name(name) and (not guest or is_name(guest)):
        if not file:
            raise click.BadParameter(f"{quoted(text)} names no file: write {host}=FILE.")
        return SnapshotFile(host=name, file=file, guest=guest)
    return SnapshotFile(host="", file=text)


def _day(_context: click.Context, _parameter: click.Parameter, value: str | None) -> date | None:
    if value is None:
        return None
    try:
        return date.fromisoformat(value)
    except ValueError as error:
        raise click.BadParameter(f"{quoted(value)} is not a day as 2026-01-31.") from error


def _time(_context: click.Context, _parameter: click.Parameter, value: str | None) -> int | None:
    if value is None:
        return None
    try:
        return int(parse_quantity(value, Unit.TIME)[1])
    except NotAQuantity as error:
        raise click.BadParameter(f"{quoted(value)} is not a time as 60s; units: {', '.join(error.units)}.") from error
