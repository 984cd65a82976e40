"""The Linux host provider: control groups in the kernel; definitions, lock and journal in a folder of root."""

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from rarms_iac.diff.readings import readings
from rarms_iac.model.changes import Address
from rarms_iac.model.commands import DOCTOR, Wording, prose
from rarms_iac.model.facets import FACETS, Facet, Readings, settings_of
from rarms_iac.model.host import Host
from rarms_iac.model.operations import (
    CreatePartition,
    MachineOperation,
    Operation,
    RemoveDisk,
    RemovePartition,
    RestorePartition,
    Set,
    StartPartition,
    StopPartition,
    TaskOperation,
)
from rarms_iac.model.plan import Scope
from rarms_iac.model.seen_host import Condition, SeenHost
from rarms_iac.model.state import NO_GENERATION, HostFacts, PartitionSettings, StartAction, State
from rarms_iac.providers.cgroups.attached import AttachedState
from rarms_iac.providers.cgroups.definitions import (
    DefinitionFiles,
    GroupDefinition,
    RunningGroup,
    foreign_definition,
    is_running,
    lack_of_room,
    new_definition,
    nothing_withheld,
    off_without_stop,
    orphan_findings,
    others_running,
    out_of_range,
    restored_definition,
    slice_limit,
    to_partitions,
    values_of,
)
from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.providers.cgroups.groups import GroupTree, GroupValues
from rarms_iac.providers.cgroups.machine import orphans, read_boot, read_facts, starts_thread_watcher
from rarms_iac.providers.cgroups.trees import MissingFeatures, find_tree
from rarms_iac.providers.interface import HostFailed, HostRefused
from rarms_iac.providers.journaled import PLAN_AGAIN, JournaledHost, report_failure
from rarms_iac.providers.machines import changed, lack_of_memory
from rarms_iac.running.kernel_files import UnreadableFile
from rarms_iac.texts.messages import reason_of
from rarms_iac.texts.plans import operation_text

STATE_FOLDER = Path("/var/lib/rarms")
ASK_DOCTOR = prose("Check the kernel: ", DOCTOR, ".")


class LinuxHostProvider(JournaledHost):
    """A `StepwiseHost` whose partitions are control groups of this machine.

    What it keeps lies in `<state folder>/<slice>/`: `<id>.json` a partition, `journal.jsonl` and `lock`. Names and
    priorities of threads are in `<state folder>/<slice>.threads`.
    """

    def __init__(
        self,
        host: Host,
        state_folder: Path = STATE_FOLDER,
        tree: GroupTree | None = None,
        facts: HostFacts | None = None,
        boot: str = "",
    ) -> None:
        """Prepare; nothing is read before the first call.

        Args:
            state_folder: what all slices of the machine keep lies below it.
            tree: the control groups; None: the kernel's, below the slice of the manifest.
            facts: of the machine; None: as it shows itself.
            boot: its latest start; empty: as it shows itself.
        """
        self._linux = host.linux
        self._folder = state_folder / host.linux.slice
        self._threads = state_folder / f"{host.linux.slice}.threads"
        self._effects = LinuxEffects()
        self._definitions = DefinitionFiles(host.name, self._folder, self._effects)
        self._attached = AttachedState(host.name, self._folder, self._effects)
        super().__init__(host.name, self._folder / "journal.jsonl", self._folder / "lock", self._effects)
        self._host = host
        self._known_tree = tree
        self._is_ours = False  # known that rarms made the slice, or that it is not there
        self._described_facts = self._known_facts = facts
        self._described_boot = self._known_boot = boot

    @property
    def tree(self) -> GroupTree:
        """The control groups below the host's slice.

        Raises:
            HostRefused: this machine, or this user, lacks something that they need (the message names all of it), or
                the slice was not made by rarms.
        """
        if self._known_tree is None:
            found = find_tree(self._linux.slice, self._linux.control_groups, self._effects)
            if isinstance(found, MissingFeatures):
                raise HostRefused(
                    self.name,
                    f"missing for control groups: {'; '.join(found.names)}",
                    "Run rarms as root, and mount the controllers (docs/linux.md).",
                )
            self._known_tree = found
        if not self._is_ours:
            self._refuse_foreign_slice(self._known_tree)
            self._is_ours = True
        return self._known_tree

    def _refuse_foreign_slice(self, tree: GroupTree) -> None:
        """Refuse a slice that exists while rarms keeps neither a journal nor a definition of it: that is its mark.

        A run keeps them before it makes the slice. With the last partition rarms would remove a slice of others.

        Raises:
            HostRefused: rarms did not make it.
        """
        has_definitions = any(name.endswith(".json") for name in self._effects.files(self._folder))
        if not tree.is_there or has_definitions or self._effects.has_file(self._journal_path):
            return
        raise HostRefused(
            self.name,
            f"the control group {self._linux.slice} exists, but {self._folder} has no record that rarms created it",
            (
                "Nothing was changed. Choose another name, for example `linux: { slice: rarms }`. If rarms "
                f"created the group and its records are lost, restore {self._folder} or remove the group."
            ),
        )

    @property
    def facts(self) -> HostFacts:
        """The facts of the machine."""
        if self._known_facts is None:
            with self.kernel_errors():
                self._known_facts = read_facts(self._host, self._effects)
        return self._known_facts

    @property
    def boot(self) -> str:
        """The id of the machine's latest start; systemd keeps groups over all of them."""
        if not self._known_boot:
            with self.kernel_errors():
                self._known_boot = self.tree.boot or read_boot(self._effects)
        return self._known_boot

    def _refuse_files_of_others(self) -> None:
        self._definitions.refuse_writable_folder()

    def observe(self) -> State:
        return self._look()[0]

    def examined(self, application: str) -> SeenHost:
        """Return findings: orphaned processes, partitions off that should run, no `keep_for_host`."""
        state, definitions = self._look()
        off = [definition.settings.name for definition in self._stopped_by_no_run(definitions.values())]
        found = [*off_without_stop(self._host, off), *nothing_withheld(self._host, self._processors)]
        read = self._effects.processes()
        for partition in state.partitions:
            with self.kernel_errors(partition.settings.name):
                running = self.tree.processes(definitions[partition.id].group) if partition.settings.running else ()
                found += orphan_findings(partition.settings.name, orphans(running, read))
        has_threads = any(partition.settings.running and partition.settings.threads for partition in state.partitions)
        watched = starts_thread_watcher(self._effects, self._threads.parent) if has_threads else None
        return SeenHost(
            host=self._host,
            application=application,
            state=state,
            condition=Condition(thread_watcher=watched),
            findings=tuple(found),
        )

    def start_after_boot(self) -> tuple[str, ...]:
        """Start the partitions that are off though no run stopped them. The host is held.

        Returns:
            Their names, sorted; those that are to be started by hand are not among them.

        Raises:
            HostError: the host cannot be read, or does not start one.
        """
        state, definitions = self._seen()
        stopped = self._stopped_by_no_run(definitions.values())
        for definition in stopped:
            with self.kernel_errors(definition.settings.name):
                self._start(definition, state)
            state, _ = self._seen()
        return tuple(definition.settings.name for definition in stopped)

    def _stopped_by_no_run(self, definitions: Iterable[GroupDefinition]) -> list[GroupDefinition]:
        off = [
            definition
            for definition in definitions
            if definition.boot and not self._runs(definition) and definition.settings.start_action is StartAction.START
        ]
        return sorted(off, key=lambda definition: definition.settings.name)

    def _look(self) -> tuple[State, Mapping[str, GroupDefinition]]:
        """Look at the machine, too, which a run does not: return state and definitions as `_seen`."""
        self._known_facts, self._known_boot = self._described_facts, self._described_boot
        return self._seen()

    def _seen(self) -> tuple[State, Mapping[str, GroupDefinition]]:
        """Return the host's state, and the definition of each partition by its id."""
        with self.kernel_errors():
            return self._state_and_definitions()

    def _state_and_definitions(self) -> tuple[State, Mapping[str, GroupDefinition]]:
        tree, facts = self.tree, self.facts
        definitions = self._definitions.all()
        running = self._running(tree, definitions)
        known = [*definitions, *self._foreign(running, definitions)]
        facts = replace(facts, real_time_percent=tree.real_time_percent())
        has_all = tree.usable_processors() == facts.logical_processors
        state = State(
            facts=facts if has_all else replace(facts, deadline_percent=0),
            partitions=to_partitions(known, running, self.boot, facts.logical_processors),
            serials=self._serials(),
            attached="" if (attached := self._attached.record()) is None else attached.title,
        )
        return state, {definition.id: definition for definition in known}

    def read(self, address: Address, scope: Scope) -> Readings:
        return readings(self._seen()[0], address, scope)

    def execute(self, operation: Operation, scope: Scope) -> None:
        """Change a group, its definition first: after a kill `_recover` undoes what that says."""
        state, known = self._seen()
        with self.kernel_errors(self._linux.slice if isinstance(operation, TaskOperation) else operation.partition):
            self._do(operation, scope, state, known)

    def _do(self, operation: Operation, scope: Scope, state: State, known: Mapping[str, GroupDefinition]) -> None:
        match operation:
            case CreatePartition():
                self.refuse_repeated(state, operation, scope)
                taken = [partition.id for partition in state.partitions]
                self._add(new_definition(operation, scope.pending(operation.partition), state.facts.id, taken))
            case RestorePartition():
                self.refuse_repeated(state, operation, scope)
                self._add(restored_definition(operation))
            case Set(after=after) if after.keys().isdisjoint(settings_of(NO_GENERATION)):
                raise self._plan_again(f"a control group cannot do this: {operation_text(operation)}")
            case RemoveDisk():
                raise self._plan_again(f"control groups do not have disks: {operation_text(operation)}")
            case _ if isinstance(operation, TaskOperation):
                raise self._plan_again(f"MMCSS exists on Windows only: {operation_text(operation)}")
            case _:
                partition = self.managed(state, operation.partition, scope, operation.machine)
                self._change(known[partition.id], operation, state)

    def _add(self, definition: GroupDefinition) -> None:
        if problem := out_of_range(definition.settings):
            raise self._plan_again(f"{definition.settings.name} cannot be made: {problem}")
        self._definitions.save(definition)

    def _change(self, definition: GroupDefinition, operation: MachineOperation, state: State) -> None:
        match operation:
            case StartPartition():
                self._start(definition, state)
            case StopPartition(grace_ms=grace):
                self._stop(definition, grace)
            case RemovePartition():
                if self._runs(definition):
                    raise self._plan_again(
                        f"{definition.settings.name} is running; only a partition that is off can be removed"
                    )
                if definition.boot == self.boot:  # systemd remembers a group that is off since a restart
                    self.tree.remove(definition.group)
                self._definitions.delete(definition)
            case _:
                after = changed(definition, operation)
                problem = out_of_range(after.settings)
                facet = operation.facet if isinstance(operation, Set) else None
                if facet is Facet.MEMORY and self._runs(definition):
                    others = others_running(definition.id, state)
                    problem = problem or lack_of_memory(after.settings, others, state.facts.memory)
                if problem:
                    raise self._plan_again(f"{definition.settings.name}: {problem}")
                if facet and FACETS[facet].in_group and self._runs(definition):
                    self._redefine(definition, after)
                else:
                    if facet is Facet.ACTIONS:
                        self._start_with_machine(after)
                    self._definitions.save(after)

    def _redefine(self, before: GroupDefinition, after: GroupDefinition) -> None:
        """Change the settings of a running partition: the kernel first, then the definition.

        The kernel's values may differ from `before`, where they were changed by hand and the plan undoes that.
        """
        self._definitions.save(replace(before, changing=True))
        try:
            self._make_group(before.group)  # a group made by hand may lack a controller
            self._write(before.group, after.settings)
            self._definitions.save(after)
        except OSError as problem:
            self._restore(replace(before, changing=True))
            message = f"{after.settings.name}: the kernel refuses: {reason_of(problem)}"
            raise HostRefused(self.name, message, ASK_DOCTOR) from None
        if before.settings.threads != after.settings.threads:
            self._save_threads()

    def _start(self, definition: GroupDefinition, state: State) -> None:
        if self._runs(definition):
            return
        settings = definition.settings
        if problem := lack_of_room(settings, definition.id, state):
            raise self._plan_again(problem)
        group = self._free_name(definition)
        begun = replace(definition, group=group, boot="")
        self._definitions.save(begun)
        self._make_group(group)
        self._write(group, settings)
        started = replace(begun, boot=self.boot)
        self._start_with_machine(started)
        self._definitions.save(started)
        if settings.threads:
            self._save_threads()

    def _stop(self, definition: GroupDefinition, grace_ms: int) -> None:
        if not self._runs(definition):
            return
        self.restore_attached()  # its processes would be ended with the group
        self.tree.ask_to_end(definition.group, grace_ms)
        self._definitions.save(replace(definition, boot=""))
        self.tree.remove(definition.group)
        self._definitions.save(replace(definition, group="", boot=""))
        if definition.settings.threads:
            self._save_threads()

    def _recover(self) -> None:
        """Undo what a killed run left half done; the definitions have what was there before."""
        self._refuse_files_of_others()
        self.restore_attached()
        with self.kernel_errors(self._linux.slice):
            self.tree.limit_slice(slice_limit(self._host, self._processors))
        for definition in self._definitions.all():
            with self.kernel_errors(definition.settings.name):
                if definition.group and not definition.boot:
                    self.tree.remove(definition.group)
                    self._definitions.save(replace(definition, group=""))
                elif definition.changing:
                    self._restore(definition)
        self._save_threads()

    def _save_threads(self) -> None:
        """Write which threads get priorities in which control groups, for `running/thread_watcher.py`."""
        rules = {
            str(self.tree.place(definition.group).groups[0]): definition.settings.threads
            for definition in self._definitions.all()
            if definition.settings.threads and self._runs(definition)
        }
        content = json.dumps(rules, indent=1, sort_keys=True).encode("ascii")
        with report_failure(self.name, self._threads):
            if not rules and self._effects.has_file(self._threads):
                self._effects.delete(self._threads)
            elif rules and self._effects.content(self._threads) != content:
                self._effects.replace(self._threads, content)

    def _restore(self, definition: GroupDefinition) -> None:
        if self._runs(definition):
            with suppress(OSError):  # refused only where its processes took more memory meanwhile
                self._write(definition.group, definition.settings)
        self._definitions.save(replace(definition, changing=False))

    def restore_attached(self) -> None:
        """Give back to a service or container what it had before it was measured, where that was not done yet.

        Raises:
            HostError: it cannot be given back; its record stays.
        """
        if (record := self._attached.record()) is not None:
            with self.kernel_errors(record.title):
                self._attached.restore(self.tree, read_boot(self._effects))

    def _start_with_machine(self, definition: GroupDefinition) -> None:
        if self._runs(definition):
            starts = definition.settings.start_action is StartAction.START
            self.tree.start_with_machine(definition.group, starts)

    def _free_name(self, definition: GroupDefinition) -> str:
        name = definition.settings.name
        group = self.tree.name_for(name)
        return group if group not in self.tree.names() else self.tree.name_for(f"{name}.{definition.id[:8]}")

    def _runs(self, definition: GroupDefinition) -> bool:
        return is_running(definition, self.tree.names(), self.boot)

    @property
    def _processors(self) -> int:
        return self.facts.logical_processors

    def _make_group(self, name: str) -> None:
        self.tree.make(name)
        self.tree.limit_slice(slice_limit(self._host, self._processors))

    def _write(self, group: str, settings: PartitionSettings) -> None:
        """Give a group the values of its settings, and a budget where its threads get priorities. Raises OSError."""
        self.tree.write(group, self._values(settings))
        if settings.threads:
            self.tree.allow_real_time(group, settings.reserve)

    def _values(self, settings: PartitionSettings) -> GroupValues:
        return values_of(settings, self._processors, slice_limit(self._host, self._processors))

    def _running(self, tree: GroupTree, definitions: list[GroupDefinition]) -> dict[str, RunningGroup]:
        """Return the groups in the kernel by name, those of partitions with the values that their definitions give."""
        wanted = {
            definition.group: tree.as_kernel_shows(self._values(definition.settings)) for definition in definitions
        }
        found: dict[str, RunningGroup] = {}
        for name in tree.names():
            with suppress(FileNotFoundError):  # the group was removed meanwhile
                found[name] = RunningGroup(actual=tree.read(name), wanted=wanted.get(name))
        return found

    def _foreign(
        self, running: dict[str, RunningGroup], definitions: list[GroupDefinition]
    ) -> Iterator[GroupDefinition]:
        """Yield the groups below the slice that other tools made, as unmanaged partitions."""
        known = {definition.group for definition in definitions if definition.boot in {"", self.boot}}
        for name, group in running.items():
            if name not in known:
                yield foreign_definition(name, group, self.facts, self.boot)

    @contextmanager
    def kernel_errors(self, partition: str = "", advice: Wording = ASK_DOCTOR) -> Iterator[None]:
        """Report what the kernel refuses of a partition; without one, that a file of the kernel cannot be read."""
        try:
            yield
        except UnreadableFile as problem:
            look = (
                f"Compare {problem.file.as_posix()} with the kernel's documentation. A tool may have mounted a "
                "file over it."
            )
            raise HostFailed(self.name, f"{problem}", look) from problem
        except OSError as problem:
            message = f"a file of the kernel cannot be read: {problem}"
            if partition:
                message = f"{partition}: the kernel refuses: {reason_of(problem)}"
            raise HostFailed(self.name, message, advice) from problem

    def _plan_again(self, message: str) -> HostRefused:
        """Return the refusal of a host that differs from what the plan saw: a new plan is needed."""
        return HostRefused(self.name, message, PLAN_AGAIN)
