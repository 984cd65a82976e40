"""Control groups of version 2, in a machine whose kernel has no others; see machine.py."""

import pytest

from tests.linux_machine.machine import run_in_machine

TESTS = ("tests/unit/providers/cgroups/test_groups.py",)
"""What runs in the machine, in one process: there, a second process takes half a minute to start."""


@pytest.mark.needs("linux-machine")
def test_the_tests_of_linux_hosts_pass_on_version_2() -> None:
    options = "-p no:cacheprovider -p no:xdist -p no:cov -q --durations=5 --basetemp=/tmp/pytest-in-machine"
    result = run_in_machine(f".venv/bin/python -m pytest {options} {' '.join(TESTS)}", timeout_s=600)

    assert result.exit_code == 0, result.output
    assert " passed" in result.output
