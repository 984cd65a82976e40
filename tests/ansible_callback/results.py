"""A callback of Ansible that appends each robot's result to the file that RARMS_TEST_RESULTS names, a line each."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from ansible.plugins.callback import CallbackBase

DOCUMENTATION = """
name: results
type: notification
short_description: Results as JSON Lines, for tests
description: Appends each result to the file that RARMS_TEST_RESULTS names.
"""


class CallbackModule(CallbackBase):  # type: ignore[misc]
    """Told of each result by Ansible."""

    CALLBACK_VERSION = 2.0
    CALLBACK_TYPE = "notification"
    CALLBACK_NAME = "results"

    def v2_runner_on_ok(self, result: Any) -> None:
        """A task ended well."""
        self._append("ok", result)

    def v2_runner_on_failed(self, result: Any, ignore_errors: bool = False) -> None:
        """A task failed."""
        self._append("failed", result)

    def v2_runner_on_unreachable(self, result: Any) -> None:
        """A robot is unreachable for Ansible."""
        self._append("unreachable", result)

    def _append(self, status: str, result: Any) -> None:
        row = {"robot": result._host.get_name(), "status": status, "result": result._result}
        with Path(os.environ["RARMS_TEST_RESULTS"]).open("a", encoding="utf-8") as file:
            file.write(json.dumps(row, default=str) + "\n")
