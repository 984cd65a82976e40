"""The engines of one process of tests."""

from collections import Counter
from collections.abc import Iterator

import pytest

from tests.cases.situations import ON_POWERSHELL, WITH_SCRIPTS
from tests.effort import LONG
from tests.real_powershell.any_engine import SYSTEM
from tests.real_powershell.engines import Engine, linux_engine, windows_engine
from tests.real_powershell.runner import RealPowerShell

SAMPLES = frozenset(
    {
        "test_situation_in_every_form[create-with-image-and-switch]",
        "test_situation_in_every_form[processors-with-a-stop]",
        "test_situation_in_every_form[task-class-replaces-a-shipped-one]",
        "test_what_a_dead_process_held_is_free",
        "test_damaged_journal_is_neither_believed_nor_overwritten[apply-hello]",
        "test_only_the_named_module_is_imported[missing]",
        "test_row_confirm_asks_once[Y-40-module]",
        "test_objects_follow_the_machine",
    }
)
"""Tests of the list of runs that a usual run of all tests does, too: imported functions have no mark of their own."""

FOR_THE_LONG_RUN = frozenset(
    {
        "test_a_run_whose_last_look_disagrees_stays_unfinished",
        "test_a_second_run_calls_nothing",
        "test_a_value_of_another_type_is_written_again",
        "test_bar_is_shown_where_person_looks_on",
        "test_changed_disk_is_not_deleted",
        "test_child_disk_matches_parent_in_any_case",
        "test_class_with_default_value_is_refused_beforehand",
        "test_disk_stays_unasked_and_is_told",
        "test_existing_machine_is_known_by_id",
        "test_guests_own_boot_entry_is_accepted",
        "test_killed_run_is_finished_by_its_own_module",
        "test_later_machine_without_smt_takes_whole_cores",
        "test_plan_without_task_classes_asks_for_no_restart",
        "test_profile_functions_change_nothing",
        "test_removal_refuses_machine_that_others_changed",
        "test_restarting_guest_is_waited_for_at_end",
        "test_second_dsc_set_looks_again",
        "test_second_run_is_unchanged_and_undo_restores",
        "test_second_run_tells_no_cluster",
        "test_stopped_replica_takes_no_room",
        "test_undo_leaves_no_partition_folder",
        "test_undo_works_on_host_that_can_promise_nothing",
        "test_value_in_another_case_is_same_value",
    }
)
"""Tests of the list that show no kind of run which others do not."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the samples, and leave of each imported test its first case, but for the long run. Long tests come first."""
    cases: Counter[str] = Counter()
    kept = []
    for item in items:
        if item.name in SAMPLES and "real_powershell" in item.nodeid:
            item.add_marker("sample")
        name, _, case = item.nodeid.partition("[")
        cases[name] += bool(case)
        is_more = (
            case.removesuffix("-module]") not in ON_POWERSHELL - WITH_SCRIPTS  # the latter are run in every form
            if name.endswith("test_scripts_do_what_plan_says_and_undo")
            else (case and cases[name] > 1 and not name.endswith("test_situation_in_every_form"))
            or name.rpartition("::")[2] in FOR_THE_LONG_RUN
        )
        if LONG or not is_more or "test_runs.py" not in name or item.name in SAMPLES:
            kept.append(item)
    items[:] = sorted(kept, key=lambda item: "real_powershell/test_runs.py" in item.nodeid)


@pytest.fixture(scope="session")
def windows() -> Iterator[Engine]:
    """PowerShell for Windows; the test needs `powershell-windows`."""
    with windows_engine() as engine:
        yield engine


@pytest.fixture(scope="session")
def linux() -> Engine:
    """PowerShell for Linux; the test needs `powershell-linux`."""
    return linux_engine()


@pytest.fixture
def engine(request: pytest.FixtureRequest) -> Engine:
    """The PowerShell of this system; the test needs that of `SYSTEM`."""
    found: Engine = request.getfixturevalue(SYSTEM)
    return found


@pytest.fixture(scope="session")
def real(windows: Engine) -> Iterator[RealPowerShell]:
    """A warm process of PowerShell for Windows, which runs scripts on the model of the host."""
    running = RealPowerShell(windows)
    yield running
    running.close()
