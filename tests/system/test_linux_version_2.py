"""Linux hosts in an emulated machine: control groups of version 2; see machine.py."""

import pytest

from tests.linux_machine.machine import run_in_machine

CONTRACTS = (
    "tests/unit/providers/cgroups/test_groups.py",
    "tests/contracts/test_linux_host.py",
    "tests/contracts/test_host_contract.py",
    "tests/contracts/test_apply_crashes.py::test_second_apply_is_empty_and_undo_restores",
)
"""What runs in the machine, in one process: there, a second process takes half a minute to start."""

OWN_FILES = (
    "mark or pending or an_id or same_name or doings or journal or raises_the_serial or holder or believed "
    "or root_alone or could_fill or never_written or user_owns or umask or no_file"
)
"""What is about the files of rarms alone: they are the same under both versions, and are tried outside."""

CHOSEN = f"(linux or groups) and not simulated and not ({OWN_FILES})"

OPTIONS = "-p no:cacheprovider -p no:xdist -p no:cov -q --durations=5 --basetemp=/tmp/pytest-in-machine"


@pytest.mark.needs("linux-machine")
def test_hosts_of_version_2_keep_the_contract() -> None:
    tests = f"-k '{CHOSEN}' {' '.join(CONTRACTS)}"
    result = run_in_machine(f".venv/bin/python -m pytest {OPTIONS} {tests}", timeout_s=900)

    assert result.exit_code == 0, result.output
    assert " passed" in result.output
