"""The list of runs that the real PowerShell does as the stand-in does.

Most tests here are the stand-in's. Every run of them is done by both, on hosts that are equal before, and has to say
the same, ask the same, change the same in the same order, and leave the same. So what these tests show of the stand-in
is shown of PowerShell, and the stand-in is shown to be like it.
"""
# ruff: noqa: F401 - what is imported is the list, with its fixtures

from collections.abc import Iterator

import pytest

from tests.cases.situations import CASES, WITH_SCRIPTS, made, stand_in
from tests.cases.test_situations import test_scripts_do_what_plan_says_and_undo
from tests.fake_powershell import run as stand_in_runs
from tests.fake_powershell.cell import apply_script, files_of, undo_script
from tests.fake_powershell.run import Look, put, run
from tests.fake_powershell.test_disks import (
    test_changed_disk_is_not_deleted,
    test_child_disk_matches_parent_in_any_case,
    test_disk_is_deleted_with_machine_on_request,
    test_disk_named_like_a_pattern_is_refused,
    test_disk_stays_unasked_and_is_told,
    test_foreign_file_is_not_taken_for_the_disk,
    test_next_plan_leaves_moved_disk,
    test_undo_leaves_no_partition_folder,
)
from tests.fake_powershell.test_guests import (
    test_class_that_is_another_tools_is_left_alone,
    test_class_with_unrestorable_name_is_not_taken,
    test_classes_are_written_and_old_values_kept,
    test_earlier_run_does_not_become_the_original,
    test_existing_machine_is_known_by_id,
    test_script_does_not_run_on_host_itself,
    test_script_refuses_guest_of_another_machine,
    test_second_run_is_unchanged_and_undo_restores,
)
from tests.fake_powershell.test_interpreter import (
    test_a_rule_of_the_language,
    test_strict_mode_and_strict_binding_stop_a_script,
)
from tests.fake_powershell.test_modules import (
    test_files_are_shared_as_each_process_lets_others,
    test_row_a_callers_low_preference_without_a_console,
    test_row_aliases_of_caller_come_before_modules_functions,
    test_row_another_version_loaded_before,
    test_row_callers_preferences_have_no_effect,
    test_row_confirm_asks_once,
    test_row_exit_in_function_ends_the_script,
    test_row_file_and_call_operator,
    test_row_functions_of_caller_called_like_modules_own,
    test_row_high_impact_without_a_console,
    test_row_late_block_sees_no_loop_variable,
    test_row_module_sees_what_if_of_file_alone,
    test_row_module_variable_reaches_late_block,
    test_row_strict_mode_is_the_modules_own,
    test_row_the_command_path_is_the_modules,
    test_row_what_if_and_the_callers_preference,
    test_row_without_modules_own_preference_cmdlet_asks_again,
)
from tests.fake_powershell.test_rarms_functions import (
    host,
    prepared,
    test_a_computer_that_is_held_is_not_closed,
    test_an_unfinished_run_of_any_plan_is_closed,
    test_asked_run_stops_and_can_go_on,
    test_closed_run_is_in_the_event_log,
    test_closing_a_run_is_asked_for,
    test_destructive_script_asks_by_its_path_too,
    test_get_rarmsrun_lists_unfinished_run_without_closing,
    test_interrupted_undo_goes_on,
    test_module_folder_script_observes_the_computer,
    test_no_other_script_observes_for_the_module,
    test_path_must_be_given,
    test_plan_runs_and_tests_by_script_path,
    test_previewed_undo_holds_nothing,
    test_runs_of_computer_are_told_in_their_order,
    test_undo_is_previewed_or_nothing_to_undo,
    test_undo_uses_the_script_in_the_journal,
)
from tests.fake_powershell.test_rarms_module import (
    test_callers_alias_is_named_first,
    test_journal_keeps_module_unless_script_holds_it,
    test_killed_run_is_finished_by_its_own_module,
    test_only_the_named_module_is_imported,
    test_preview_by_file_and_at_prompt_changes_nothing,
    test_script_without_its_folder_says_where_it_belongs,
    test_test_reports_each_step_and_writes_nothing,
    test_why_module_is_refused_is_said,
)
from tests.fake_powershell.test_real_powershell import (
    test_a_value_of_another_type_is_written_again,
    test_class_with_default_value_is_refused_beforehand,
    test_confirm_without_console_is_refused,
    test_ctrl_c_leaves_the_run_open,
    test_declined_step_skips_what_builds_on_it,
    test_failed_reading_names_its_step,
    test_failure_names_step_cmdlet_and_error,
    test_impossible_wait_is_refused,
    test_journal_that_never_began_is_cleared,
    test_line_ends_that_git_changed_are_called_so,
    test_missing_undo_script_is_named,
    test_no_other_line_stands_between_the_events,
    test_preview_as_json_takes_no_lock,
    test_profile_defaults_do_not_reach_a_run,
    test_profile_preview_is_told_by_last_event,
    test_removal_refuses_machine_that_others_changed,
    test_undo_keeps_machine_that_others_changed,
    test_undo_script_may_be_signed_and_nothing_else,
    test_what_stops_and_removes_has_to_be_confirmed,
)
from tests.fake_powershell.test_scripts import (
    test_a_script_is_run_as_a_file_alone,
    test_a_second_run_calls_nothing,
    test_a_used_plan_is_refused_after_another,
    test_after_a_run_the_next_plan_is_empty,
    test_after_kill_refusal_names_what_others_changed_alone,
    test_another_plan_waits_until_unfinished_one_is_finished,
    test_change_during_run_stops_before_its_step,
    test_client_without_schedulers_event_counts_as_root,
    test_damaged_journal_is_neither_believed_nor_overwritten,
    test_events_are_ascii_json_in_order,
    test_every_action_of_plan_stands_in_its_preview,
    test_folder_is_protected_before_opening_anything,
    test_guests_own_boot_entry_is_accepted,
    test_image_boots_from_disk_with_secure_boot_template,
    test_journal_has_its_place_without_programdata,
    test_killed_or_failed_run_is_finished,
    test_killed_undo_is_finished,
    test_later_machine_without_smt_takes_whole_cores,
    test_lookalike_is_not_taken_for_pending_machine,
    test_machine_larger_than_a_node_is_refused,
    test_machine_with_wanted_name_stops_the_run,
    test_missing_room_stops_the_start,
    test_moved_host_is_not_touched,
    test_past_runs_say_which_robot_they_were_for,
    test_planted_or_damaged_record_stops_the_run,
    test_preview_begins_with_losses,
    test_profile_functions_change_nothing,
    test_record_is_written_on_where_killed_run_stopped,
    test_reinstalled_windows_is_not_the_plans_host,
    test_restarting_guest_is_waited_for_at_end,
    test_running_stranger_counts_with_all_its_memory,
    test_server_without_scheduler_event_follows_plan,
    test_stand_in_needs_a_core_for_each_machine,
    test_two_pending_lookalikes_stop_the_run,
    test_undo_restores_from_every_point,
    test_undo_works_beside_greedy_stranger,
    test_undo_works_on_host_that_can_promise_nothing,
    test_unwanted_closing_keeps_the_run_open,
    test_unwritable_verdict_does_not_fail_the_run,
    test_waiting_for_another_run_is_limited,
    test_what_a_dead_process_held_is_free,
    test_wrong_host_is_not_touched,
)
from tests.fake_powershell.test_stopping import (
    test_deaf_guest_is_turned_off_at_once,
    test_guest_has_the_grace_of_the_manifest,
    test_guest_is_asked_then_forced_then_cut,
    test_machine_in_another_state_is_not_stopped,
    test_machine_that_left_off_is_not_changed,
    test_paused_machine_is_turned_off_before_removal,
    test_script_may_be_silent_while_guest_stops,
    test_started_saved_machine_is_off_after_undo,
    test_starting_guest_is_asked_once_it_answers,
)
from tests.fake_powershell.test_ties import (
    test_a_primary_is_ours,
    test_a_run_whose_last_look_disagrees_stays_unfinished,
    test_change_after_kill_is_refused_before_finishing,
    test_clustered_machine_is_never_removed,
    test_clustered_machine_needs_permission_and_tells_cluster,
    test_late_moved_step_stops_the_first,
    test_replica_is_stranger_whose_name_is_taken,
    test_responsiveness_is_set_changed_and_restored,
    test_script_refuses_where_it_was_changed_since_plan,
    test_second_run_tells_no_cluster,
    test_stopped_replica_takes_no_room,
    test_tied_machine_is_refused_by_name,
    test_two_marks_count_for_no_partition,
    test_value_in_another_case_is_same_value,
)
from tests.fake_powershell.test_upgraded import (
    test_a_damaged_script_of_a_journal_runs_nothing,
    test_its_undo_is_told_as_its_script_says,
    test_upgraded_host_finishes_run_as_begun,
    test_upgraded_host_undoes_by_journals_script,
)
from tests.fake_powershell.test_verdict import (
    test_a_test_as_json_is_one_object,
    test_bar_is_shown_where_person_looks_on,
    test_deaf_event_log_does_not_fail_the_run,
    test_finished_run_leaves_a_verdict,
    test_interrupted_run_shows_no_earlier_verdict,
    test_link_in_place_of_verdict_is_refused,
    test_plan_without_task_classes_asks_for_no_restart,
    test_refusals_and_failures_are_verdicts_and_entries_too,
    test_second_dsc_set_looks_again,
    test_task_classes_wait_for_restart_and_service,
    test_verdict_after_ctrl_c_is_not_done,
)
from tests.real_powershell.both import differences, is_shown
from tests.real_powershell.runner import RealPowerShell

pytestmark = pytest.mark.needs("powershell-windows", "wine")
OBSERVE = "observe.ps1"


@pytest.fixture(autouse=True)
def _both(real: RealPowerShell, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Have the real PowerShell do what the stand-in does, and compare; of many observations the first in a test."""
    found: list[str] = []
    observed: list[Look] = []

    def compare(look: Look) -> None:
        if not is_shown(look) or (look.name == OBSERVE and observed):
            return
        if look.name == OBSERVE:
            observed.append(look)
        found.extend(differences(real, look))

    monkeypatch.setattr(stand_in_runs, "beside", compare)
    yield
    assert not found, "\n".join(found)


@pytest.mark.parametrize("name", sorted(WITH_SCRIPTS))
def test_situation_in_every_form(name: str) -> None:
    """What `test_scripts_do_what_plan_says_and_undo` does not run: a preview, a test, and both scripts once more."""
    folder = CASES / name
    plan, here = made(folder).plan, stand_in(folder)
    assert plan is not None
    put(here, files_of(plan))
    script, undo = apply_script(plan), undo_script(plan)
    assert run(here, script, what_if=True, as_json=False).code == 0
    assert run(here, script, test=True).code == 0
    for name in (script, script, undo, undo):
        assert run(here, name).code == 0
