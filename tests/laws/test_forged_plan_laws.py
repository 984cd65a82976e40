"""A plan that was edited and sealed anew does not show one thing and do another: it is refused, value by value.

What is shown above the line of the file's own words follows from what is done, so both change together or not at all.
"""

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import chdir
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.app.files import plan_in
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.applying.scripts import with_scripts
from rarms_iac.applying.state_after import partitions_after, promised
from rarms_iac.diff.order import Deadlock, order
from rarms_iac.diff.steps import plan_changes
from rarms_iac.model.capacity import capacity_of
from rarms_iac.model.changes import Update
from rarms_iac.model.host import LinuxHost
from rarms_iac.model.plan import FILE_WORDS as JSON_WORDS
from rarms_iac.model.plan import HostPlan, Plan
from rarms_iac.model.plan_basis import PlanBasis
from rarms_iac.model.state import Partition, State
from rarms_iac.storage.codec import NotDecodable, decode
from rarms_iac.storage.digest import digest
from rarms_iac.storage.plan_file import identified, plan_id, write_plan
from rarms_iac.storage.shipped import shipped
from rarms_iac.views.console import render
from rarms_iac.views.json_output import json_of
from rarms_iac.views.plan import FILE_WORDS, plan_text
from tests.cases.situations import CASES, made
from tests.effort import Attempt, every_few, tried
from tests.laws.test_damaged_file_laws import changed, paths_in
from tests.unit.cli.running import rarms

CELL = shipped("manifests/hyperv-cell")
SIMULATED = """\
schema: rarms/v1
application: { name: cell }
hosts: { onboard: { logical_processors: 4, memory: 8 GiB } }
policy: { max_disruption: live }
components:
  vision: { criticality: 30, memory: 512 MiB, cpu: { reserve: RESERVE } }
  speech: { criticality: 5, memory: MEMORY, cpu: { reserve: 20 % } }
UNUSED"""
UNUSED = "  radio: { criticality: 1, memory: 512 MiB, cpu: { reserve: 10 % } }\n"


def hyperv_cell(folder: Path) -> Plan:
    """The shipped example: three machines to make, two guests that were not looked into."""
    path = folder / "cell.plan"
    words = ("plan", "-f", str(CELL), "--snapshot", f"cell={CELL / 'host.json'}", "--out", str(path))
    assert rarms(*words).code == 0
    return read(path.read_bytes())


def simulated(folder: Path) -> Plan:
    """A reservation that grows, a change that is held back, a partition that the manifest names no more."""
    file = folder / "rarms.yaml"
    with chdir(folder):
        write_simulated(file, "30 %", "512 MiB", UNUSED)
        assert rarms("apply", "--auto-approve").code == 0
        write_simulated(file, "40 %", "1 GiB", "")
        assert rarms("plan", "--out", "cell.plan").code == 0
        return read(Path("cell.plan").read_bytes())


def write_simulated(file: Path, reserve: str, memory: str, unused: str) -> None:
    text = SIMULATED.replace("RESERVE", reserve).replace("MEMORY", memory).replace("UNUSED", unused)
    file.write_text(text, encoding="utf-8")


def situation(name: str) -> Callable[[Path], Plan]:
    """The plan of a folder of `tests/cases`."""

    def of_folder(_: Path) -> Plan:
        plan = made(CASES / name).plan
        assert plan is not None
        return plan

    return of_folder


PLANS = {
    "hyperv-cell": hyperv_cell,
    "simulated": simulated,
    **{name: situation(name) for name in ("held-back", "create-linux", "reserves-swap", "remove", "task-classes-new")},
}


def read(data: bytes) -> Plan:
    return plan_in("forged.plan", data)


def another(value: Any) -> Any:
    match value:
        case bool():
            return not value
        case int():
            return value + 1
        case str():
            return f"{value}x"
        case None:
            return "x"
        case list():
            return value[1:]
        case _:
            return {}


def value_at(document: Any, path: tuple[Any, ...]) -> Any:
    for key in path:
        document = document[key]
    return document


def forged(document: dict[str, Any], path: tuple[Any, ...]) -> dict[str, Any] | None:
    """The document with one value changed, and an id and a seal that fit; None where no plan has such a value."""
    document = dict(changed(document, path, another(value_at(document, path))))
    del document["seal"]
    try:
        document["id"] = plan_id(decode(Plan, document))
    except (NotDecodable, LookupError, TypeError, AttributeError):
        return None
    return {**document, "seal": digest(document)}


def shown(plan: Plan) -> str:
    """What stands above the words of the file, without the plan's id."""
    text = render(plan_text(plan, verbose=True, is_read=True), 10_000)
    return text.partition(FILE_WORDS)[0].replace(plan.id, "ID")


def done(plan: Plan) -> object:
    """What `rarms apply` takes from a plan, beside the digests by which it refuses."""

    def of_host(part: HostPlan) -> object:
        settings = part.host.settings
        where = (settings.slice, settings.control_groups) if isinstance(settings, LinuxHost) else ()
        scripts = {name: text.replace(plan.id, "ID") for name, text in part.scripts.items()}
        return part.host.name, part.host.connect, where, part.state_path, part.steps, scripts

    parts = [of_host(part) for part in plan.hosts]
    return plan.application, plan.robot, plan.purpose, plan.manifest, plan.max_disruption, parts


def places_that_differ(own: Any, forgery: Any, place: str = "") -> Iterator[str]:
    """Places in two answers, as `file_words` writes them: the shortest that hold all that differs."""
    if isinstance(own, dict) and isinstance(forgery, dict) and own.keys() == forgery.keys():
        for key in own:
            yield from places_that_differ(own[key], forgery[key], f"{place}.{key}" if place else key)
    elif isinstance(own, list) and isinstance(forgery, list) and len(own) == len(forgery):
        for left, right in zip(own, forgery, strict=True):
            yield from places_that_differ(left, right, f"{place}.*")
    elif own != forgery:
        yield place


def is_word_of_file(place: str) -> bool:
    return place == "id" or any(fnmatchcase(f"{place}.", f"{words}.*") for words in JSON_WORDS)


@pytest.mark.parametrize("place", ["hosts.*.steps.*.operation", "hosts.*.changes.*.after.Partition.settings", "counts"])
def test_what_is_done_is_no_word_of_the_file(place: str) -> None:
    assert not is_word_of_file(place)


@pytest.mark.parametrize("name", PLANS)
def test_what_is_shown_and_what_is_done_change_together_or_not_at_all(tmp_path: Path, name: str) -> None:
    plan = PLANS[name](tmp_path)
    document: dict[str, Any] = json.loads(write_plan(plan))
    own_text, own_effect = shown(plan), done(plan)
    paths = [path for path in paths_in(document) if path[0] not in {"seal", "id"}]
    bad, refused, tried_here = [], 0, 0
    for number in every_few(len(paths), 40):
        path = paths[number]
        candidate = forged(document, path)
        if candidate is None:
            continue
        tried(Attempt.FORGERY)
        tried_here += 1
        try:
            other = read(json.dumps(candidate).encode())
        except UseCaseError:
            refused += 1
            continue
        if (shown(other) != own_text) is not (done(other) != own_effect):
            bad.append((path, value_at(document, path)))
        if done(other) == own_effect:
            answers = (json.loads(json_of(each)) for each in (plan, other))
            bad += [(path, place) for place in places_that_differ(*answers) if not is_word_of_file(place)]

    assert bad == []
    assert refused > tried_here / 3


def consistent(plan: Plan, part: HostPlan) -> Plan:
    """The plan with a host's part that an expert changed: all that follows from it is made again, as a reader does."""
    basis = part.basis
    assert basis is not None
    steps = order(plan_changes(part.changes, basis.context), basis.budget)
    assert not isinstance(steps, Deadlock)
    machines = tuple(machine for _, machine in sorted(basis.budget.managed.items()))
    own = partitions_after(State(facts=part.facts, partitions=machines), plan.application, part.changes)
    totals = promised(own, basis.others, basis.named)
    other, wrong = with_scripts(identified(replace(plan, hosts=(replace(part, steps=steps.steps, totals=totals),))))
    assert not wrong
    return other


def with_managed(basis: PlanBasis, managed: Iterable[Partition]) -> PlanBasis:
    return replace(basis, budget=replace(basis.budget, managed={machine.id: machine for machine in managed}))


def without_a_machine_that_stays(part: HostPlan, basis: PlanBasis) -> HostPlan:
    changing = {change.address.partition for change in part.changes}
    machines = basis.budget.managed.values()
    stays = next(machine for machine in machines if machine.mark and machine.mark.name not in changing)
    return replace(part, basis=with_managed(basis, (machine for machine in machines if machine != stays)))


def with_more_processors(part: HostPlan, basis: PlanBasis) -> HostPlan:
    facts = replace(part.facts, logical_processors=2 * part.facts.logical_processors)
    host = replace(part.host, logical_processors=facts.logical_processors)
    context = replace(basis.context, facts=facts)
    budget = replace(basis.budget, capacity=capacity_of(host, facts))
    return replace(part, host=host, facts=facts, basis=replace(basis, context=context, budget=budget))


def with_less_before_the_change(part: HostPlan, basis: PlanBasis) -> HostPlan:
    """A reservation that the plan lowers then seems to be raised."""
    change = next(change for change in part.changes if isinstance(change, Update))
    assert isinstance(change.before, Partition)
    before = replace(change.before, settings=replace(change.before.settings, reserve=1))
    changes = tuple(replace(change, before=before) if each == change else each for each in part.changes)
    managed = {**basis.budget.managed, before.id: before}
    return replace(part, changes=changes, basis=with_managed(basis, managed.values()))


def with_the_changed_machine_as_it_is_wanted(part: HostPlan, basis: PlanBasis) -> HostPlan:
    """The machines that the sums are of, beside what a change finds."""
    change = next(change for change in part.changes if isinstance(change, Update))
    assert isinstance(change.after, Partition)
    managed = {**basis.budget.managed, change.after.id: change.after}
    return replace(part, basis=with_managed(basis, managed.values()))


EXPERT = (
    without_a_machine_that_stays,
    with_more_processors,
    with_less_before_the_change,
    with_the_changed_machine_as_it_is_wanted,
)


@pytest.mark.parametrize("forge", EXPERT, ids=[forge.__name__ for forge in EXPERT])
def test_what_was_found_before_is_what_the_digests_are_of(
    tmp_path: Path, forge: Callable[[HostPlan, PlanBasis], HostPlan]
) -> None:
    plan = simulated(tmp_path)
    [part] = plan.hosts
    assert part.basis is not None

    tried(Attempt.FORGERY)
    assert read(write_plan(consistent(plan, part))) == plan
    with pytest.raises(UseCaseError):
        read(write_plan(consistent(plan, forge(part, part.basis))))


def test_which_partitions_the_manifest_names_changes_nothing_above_the_words_of_the_file(tmp_path: Path) -> None:
    plan = read(write_plan(situation("stopped-stays")(tmp_path)))
    [part] = plan.hosts
    assert part.basis is not None
    forged_part = replace(part, basis=replace(part.basis, named=frozenset()))

    other = read(write_plan(consistent(plan, forged_part)))

    assert other.hosts[0].totals != part.totals
    assert shown(other) == shown(plan)
