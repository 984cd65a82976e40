"""Linux hosts in an emulated machine: control groups of version 2; see machine.py."""

import pytest

from tests.linux_machine.machine import run_tests_in_machine

CONTRACTS = (
    "tests/unit/providers/cgroups/test_groups.py",
    "tests/contracts/test_linux_host.py",
    "tests/contracts/test_host_contract.py",
    "tests/contracts/test_apply_crashes.py::test_second_apply_is_empty_and_undo_restores",
)
"""What runs in the machine."""

OWN_FILES = (
    "mark or pending or an_id or same_name or doings or journal or raises_the_serial or holder or believed "
    "or root_alone or could_fill or never_written or user_owns or umask or no_file"
)
"""What is about the files of rarms alone: they are the same under both versions, and are tried outside."""

CHOSEN = f"(linux or groups) and not simulated and not ({OWN_FILES})"


@pytest.mark.needs("linux-machine")
def test_hosts_of_version_2_keep_the_contract() -> None:
    result = run_tests_in_machine(("-k", CHOSEN, *CONTRACTS), timeout_s=900)

    assert result.exit_code == 0, result.output
    assert " passed" in result.output
