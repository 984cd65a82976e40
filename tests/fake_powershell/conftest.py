"""What a usual run takes of the tests that PowerShell itself does, too: each once."""

import pytest

from tests.real_powershell import test_runs


@pytest.hookimpl(tryfirst=True)  # before the tests are chosen by their marks
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark all but the first case of each test in the list of runs."""
    met: set[str] = set()
    for item in items:
        name, _, case = item.nodeid.partition("[")
        if "fake_powershell" in name and case and hasattr(test_runs, name.rpartition("::")[2]):
            if name in met:
                item.add_marker("system")
            met.add(name)
