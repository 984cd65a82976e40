"""What `rarms measure` is asked for, as experiments: which components together, on which host, against which load."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import click

from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.wiring import open_bench
from rarms_iac.measuring import findings
from rarms_iac.measuring.setup import Experiment, experiment_of, interference_of
from rarms_iac.model.system import Host, RunsOn
from rarms_iac.model.wording import suggestion
from rarms_iac.planner.groups import groups_of


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasureOptions:
    """What `rarms measure` was asked for."""

    components: tuple[str, ...] = ()  # none: every one with an APT
    together: bool = False
    strategy: str = "default"
    reserves: tuple[int, ...] = ()  # performance measurement mode; none: a search
    interference: str | None = None
    samples: int | None = None
    verify: bool = False
    seed: int | None = None
    again: bool = False
    on_busy_host: bool = False
    lock_timeout_ms: int = 0


def experiments_for(hosts: Hosts, options: MeasureOptions) -> tuple[Experiment, ...]:
    """What is to be measured, and where: each partition's components on one host of each platform.

    As they are named; all of them the most critical first.

    Raises:
        click.UsageError: a name is not in the manifest.
        UseCaseError: no host of theirs can be measured on (1).
    """
    system = hosts.system
    refuse_unknown(options.components, system.components, "component")
    refuse_unknown((options.interference,) if options.interference else (), system.interference, "interference")
    for name in options.components:
        if system.components[name].runs_on is RunsOn.HOST:
            says = f"{name} runs on the host itself: it has no partition, and no reservation that could be measured."
            raise click.UsageError(says, click.get_current_context())
    if not options.components and not any(component.apt for component in system.components.values()):
        raise _nothing_to_measure(hosts)
    found: list[Experiment] = []
    for members in _members(hosts, options):
        load = options.interference or interference_of(system, members)
        found += [experiment_of(system, host, members, load, options.samples) for host in _benches(hosts, members)]
    return tuple(found)


def _nothing_to_measure(hosts: Hosts) -> UseCaseError:
    advice = (
        "Say how well one must do: `apt: { mean_response_time: { at_most: 50 ms } }`; or name one with --from, --to."
    )
    place = hosts.manifest.places.key("components")
    says = "No component has an `apt`, so there is nothing to measure for."
    return UseCaseError(Outcome.NEGATIVE, [findings.NO_THRESHOLD.at(place, says, advice)], hosts.manifest.sources)


def _members(hosts: Hosts, options: MeasureOptions) -> tuple[tuple[str, ...], ...]:
    if options.components and options.together:
        return (tuple(sorted(set(options.components))),)
    if options.components:
        return tuple((name,) for name in dict.fromkeys(options.components))
    groups = sorted(groups_of(hosts.system), key=lambda group: (-group.criticality, group.name))
    return tuple(
        tuple(member.name for member in group.members) for group in groups if any(m.apt for m in group.members)
    )


def _benches(hosts: Hosts, members: tuple[str, ...]) -> Iterator[Host]:
    """The first host of each platform that all of them may run on and that can be measured on."""
    system = hosts.system
    allowed = [
        system.hosts[name]
        for name in hosts.chosen
        if all(
            system.components[member].hosts is None or name in (system.components[member].hosts or ())
            for member in members
        )
    ]
    able = [host for host in allowed if open_bench(host, hosts.folder, hosts.state_path(host.name)) is not None]
    if not able:
        names = ", ".join(host.name for host in allowed) or "none"
        raise UseCaseError(
            Outcome.FAILED,
            [
                findings.CANNOT_MEASURE.at(
                    None,
                    f"{', '.join(members)} may run on: {names}. None of them is a simulated host.",
                    "Name another with --host, or measure on a simulated host of the same platform.",
                    address=f"component/{members[0]}",
                )
            ],
        )
    platforms = dict.fromkeys(host.platform for host in able)
    yield from (next(host for host in able if host.platform == platform) for platform in platforms)


def refuse_unknown(names: Sequence[str], there: Mapping[str, object], what: str) -> None:
    """Each of these names is in the manifest.

    Raises:
        click.UsageError: one is not; the message offers the nearest.
    """
    for name in names:
        if name not in there:
            raise click.UsageError(
                f"The manifest has no {what} {name!r}.{suggestion(name, tuple(there))} "
                f"It has: {', '.join(sorted(there)) or 'none'}.",
                click.get_current_context(),
            )
