"""Hosts of one plan that are one machine: what one of them reserves, the others do not know of."""

from collections import defaultdict
from collections.abc import Iterator, Mapping

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places
from rarms_iac.model.host import LinuxHost
from rarms_iac.model.state import State
from rarms_iac.model.system import System

ONE_MACHINE = Finding.warning("RARMS343", "Several hosts are one machine")


def hosts_of_one_machine(system: System, observed: Mapping[str, State], places: Places) -> Iterator[Diagnostic]:
    """Report hosts with the identity of another host of the plan.

    Args:
        observed: their states, by name; those without an identity are left out.
        places: where they stand in the manifest.

    Yields:
        A finding for each identity that several hosts have, at the first of them by name.
    """
    hosts_of: dict[str, list[str]] = defaultdict(list)
    for name, state in sorted(observed.items()):
        if state.facts.id:
            hosts_of[state.facts.id].append(name)
    for names in hosts_of.values():
        if len(names) > 1:
            slices = [
                settings.slice for name in names if isinstance(settings := system.hosts[name].settings, LinuxHost)
            ]
            make = _slices if len(set(slices)) == len(names) else _clones
            yield make(names, places)


def _clones(names: list[str], places: Places) -> Diagnostic:
    return ONE_MACHINE.at(
        places.key("hosts", names[0]),
        "The hosts {hosts:all} have the same machine id: either their addresses lead to one machine, or "
        "the machines were cloned from one image.",
        "Check the addresses under `connect`. Give each clone a machine id of its own, else proofs and journals of one "
        "count for the other.",
        address=f"host/{names[0]}",
        hosts=tuple(names),
    )


def _slices(names: list[str], places: Places) -> Diagnostic:
    return ONE_MACHINE.at(
        places.key("hosts", names[0]),
        "The hosts {hosts:all} are slices of one machine, and each reserves as if it had all processors.",
        "Make them one host, or let each keep the others' part free with `keep_for_host`.",
        address=f"host/{names[0]}",
        hosts=tuple(names),
    )
