"""The simulated host: a file that behaves like a Hyper-V host, with journal and lock next to it."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from rarms_iac.diff.readings import readings
from rarms_iac.model.changes import Address
from rarms_iac.model.facets import Readings
from rarms_iac.model.host import Fault, FaultEffect, Host
from rarms_iac.model.operations import (
    CreatePartition,
    MachineOperation,
    Operation,
    RemoveDisk,
    RestorePartition,
    TaskOperation,
    call_name,
)
from rarms_iac.model.plan import Scope
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import State
from rarms_iac.providers.interface import HostFailed, HostRefused
from rarms_iac.providers.journaled import JournaledHost, LocalFiles, report_damage, report_failure
from rarms_iac.providers.simulated.content import (
    Content,
    SimulatedMachine,
    address_of,
    change_machine,
    change_registry,
    empty,
    made_settings,
    next_id,
    read_content,
    to_state,
    with_new_disk,
    with_new_machine,
    with_restored_machine,
    write_content,
)
from rarms_iac.providers.simulated.refusals import (
    Refusal,
    refuse_change,
    refuse_creation,
    refuse_disk_removal,
    refuse_task_change,
    refuse_without_rights,
)
from rarms_iac.storage.writing import remove_leftovers

ROBOTS = "hosts"
"""The folder in which each set of overlays, a robot's, has a folder of its own for the states of its hosts."""


class SimulatedHostProvider(JournaledHost):
    """A `StepwiseHost` that needs nothing installed.

    `path` is the host's file, `.rarms/hosts/<name>.json` next to the manifest; the journal lies next to it as
    `<name>.journal.jsonl`, the lock as `<name>.lock`. The caller chooses another name for another set of overlays.
    """

    def __init__(self, host: Host, path: Path, sleep: Callable[[float], None] = time.sleep) -> None:
        journal, lock = (path.with_name(f"{path.stem}.{ending}") for ending in ("journal.jsonl", "lock"))
        super().__init__(host.name, journal, lock, LocalFiles())
        self._host = host
        self._path = path
        self._sleep = sleep
        self._last_content: tuple[bytes, Content] | None = None  # by its bytes: read again, they cost nothing
        self._last_state: tuple[Content, State] | None = None  # by its content

    def observe(self) -> State:
        return replace(self._state(self.load()), serials=self._serials())

    def examined(self, application: str) -> SeenHost:
        return SeenHost(host=self._host, application=application, state=self.observe())

    def _recover(self) -> None:
        for path in (self._path, self._journal_path):
            remove_leftovers(path)

    def read(self, address: Address, scope: Scope) -> Readings:
        return readings(self._state(self.load()), address, scope)

    def execute(self, operation: Operation, scope: Scope) -> None:
        """Do an operation, or let a fault strike that the manifest asks for."""
        # What the host itself would refuse comes before any fault. LATE and FAIL_AFTER do the operation first.
        before = self.load()
        try:
            after = self._after(before, operation, scope)
        except Refusal as refusal:
            raise HostRefused(self.name, refusal.message, refusal.advice) from None
        fault = self._fault(before, operation)
        if fault is None:
            self.save(after)
            return
        name, effect = fault[0], fault[1].effect
        if effect is FaultEffect.REFUSE:
            self.save(_with_strike(before, name))
            raise HostRefused(
                self.name, f"the fault {name} refuses {call_name(operation)}", "Remove it from the manifest."
            )
        self.save(_with_strike(after, name))
        if effect is FaultEffect.LATE:
            self._sleep(float(fault[1].delay) / 1000)
            return
        raise HostFailed(
            self.name, f"the fault {name} makes {call_name(operation)} fail", "Remove it from the manifest."
        )

    def load(self) -> Content:
        """Read what is on the host; an empty machine without a file.

        Raises:
            HostDamaged: the file is not as it was written.
            HostFailed: it cannot be read.
        """
        with report_damage(self.name, self._path):
            data = self._files.content(self._path)
            if data is None:
                folder = self._path.parent
                robot = f"{folder.name}/" if folder.parent.name == ROBOTS else ""
                return empty(f"{robot}{self.name}")
            if self._last_content is None or self._last_content[0] != data:
                self._last_content = (data, read_content(data, self._path))
            return self._last_content[1]

    def save(self, content: Content) -> None:
        """Write this content as the host's file, in one replacement.

        `execute` uses it; tests also use it to make machines that rarms does not manage.

        Raises:
            HostFailed: the file cannot be written; what was there before still is.
        """
        data = write_content(content)
        with report_failure(self.name, self._path):
            self._files.replace(self._path, data)
        self._last_content = (data, content)

    def _state(self, content: Content) -> State:
        if self._last_state is None or self._last_state[0] is not content:
            self._last_state = (content, to_state(content, self._host))
        return self._last_state[1]

    def _after(self, content: Content, operation: Operation, scope: Scope) -> Content:
        state = self._state(content)
        refuse_without_rights(state.facts)
        match operation:
            case CreatePartition():
                return self._after_creation(content, state, operation, scope)
            case RestorePartition():
                self.refuse_repeated(state, operation, scope)
                return with_restored_machine(content, operation)
            case RemoveDisk():
                refuse_disk_removal(content, operation)
                return content.without_disk(operation.path)
            case _ if isinstance(operation, TaskOperation):
                return self._after_task(content, state, operation, scope)
            case _:
                return self._after_machine(content, state, operation, scope)

    def _after_task(self, content: Content, state: State, operation: TaskOperation, scope: Scope) -> Content:
        machine = self._only(content, state, operation, scope).id if operation.inside else ""
        registry = content.registry(machine)
        refuse_task_change(registry, operation)
        return content.with_registry(machine, change_registry(registry, operation))

    def _after_machine(self, content: Content, state: State, operation: MachineOperation, scope: Scope) -> Content:
        machine = self._only(content, state, operation, scope)
        guest_build = self._host.simulated.guest_windows_build
        refuse_change(operation, machine, content, state.facts, guest_build)
        return change_machine(content, machine, operation)

    def _after_creation(self, content: Content, state: State, operation: CreatePartition, scope: Scope) -> Content:
        self.refuse_repeated(state, operation, scope)
        settings = made_settings(operation, scope)
        refuse_creation(operation, settings)
        after = with_new_machine(content, settings)
        if not operation.image:
            return after
        return with_new_disk(after, next_id(content, settings.name), operation, state.facts.disk_folder, scope)

    def _only(self, content: Content, state: State, operation: Operation, scope: Scope) -> SimulatedMachine:
        address = address_of(operation)
        return content.machines[self.managed(state, address.partition, scope, address.machine).id]

    def _fault(self, content: Content, operation: Operation) -> tuple[str, Fault] | None:
        address = str(address_of(operation)).lower()
        for name, fault in self._host.simulated.faults.items():
            spent = fault.times is not None and content.struck.get(name, 0) >= fault.times
            if fault.operation == call_name(operation) and fault.at.lower() in {"*", address} and not spent:
                return name, fault
        return None


def _with_strike(content: Content, fault: str) -> Content:
    return replace(content, struck={**content.struck, fault: content.struck.get(fault, 0) + 1})
