"""What holds for every test holds for these."""

from tests.conftest import (
    pytest_collection_modifyitems,
    pytest_runtest_setup,
    pytest_sessionfinish,
    pytest_terminal_summary,
)

__all__ = ["pytest_collection_modifyitems", "pytest_runtest_setup", "pytest_sessionfinish", "pytest_terminal_summary"]
