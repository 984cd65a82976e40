"""What holds for every test: hypothesis' counts, the needs of tests, and no silent skips in CI."""

import os
import re
from collections import defaultdict
from collections.abc import Generator, Iterator, Sequence
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.providers.interface import HostError
from rarms_iac.texts.findings import Finding
from tests import needs
from tests.effort import LONG, examples

# The usual run tries the same examples everywhere, so that a failure is one for everybody; the long run explores.
settings.register_profile(
    "rarms",
    max_examples=examples(60),
    deadline=None,
    derandomize=not LONG,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("rarms")

# What a shell or a test runner says of its own terminal is nothing to the commands that tests start.
os.environ.pop("COLUMNS", None)
SYSTEM = [needs.CHECKOUT / "tests" / name for name in ("system", "real_powershell")]
NO_SKIPS = os.environ.get("RARMS_NO_SKIPS") == "1"


def _needed_by(item: pytest.Item) -> list[str]:
    return [str(name) for marker in item.iter_markers("needs") for name in marker.args]


@pytest.hookimpl(tryfirst=True)  # before the tests are chosen by their marks
def pytest_collection_modifyitems(items: Sequence[pytest.Item]) -> None:
    """Mark the tests of `SYSTEM`, and refuse a misspelt need, which would skip nothing and say nothing."""
    for item in items:
        if any(folder in item.path.parents for folder in SYSTEM):
            item.add_marker("system")
        if unknown := sorted(set(_needed_by(item)) - needs.NEEDS.keys()):
            known = ", ".join(needs.NEEDS)
            raise pytest.UsageError(f"{item.nodeid} needs {', '.join(unknown)}, which tests/needs.py lacks ({known})")


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skips, before any fixture, what this machine cannot run."""
    needs.require(*_needed_by(item))


@pytest.fixture(autouse=True, scope="session")
def _no_message_without_a_reason() -> Iterator[None]:
    """Every finding and every error of a host that a test meets has its reason, in the sentence and for programs."""
    at, made = Finding.at, HostError.__init__

    def with_reason(self: Finding, *given: Any, **facts: Any) -> Diagnostic:
        found = at(self, *given, **facts)
        assert not re.search(r"[:,]\s*\.?$", found.detail), found.detail
        assert found.values.get("reason") != "", found.detail
        return found

    def with_message(self: HostError, host: str, message: str, advice: Any) -> None:
        assert message, host
        assert not message.rstrip(". ").endswith(":"), message
        made(self, host, message, advice)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Finding, "at", with_reason)
        patched.setattr(HostError, "__init__", with_message)
        yield


_PROCESSOR_S = "processor_s"
_last_s = [0.0]  # processor time of this process and of its ended children when the last phase ended
_SHOWN_FILES = 8


def _processor_s() -> float:
    return sum(os.times()[:4])


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_logstart() -> None:
    """Begins to count the processor time of a test."""
    _last_s[0] = _processor_s()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Gives each report the processor time of its phase; a process that was not waited for does not count."""
    report = yield
    now = _processor_s()
    report.user_properties.append((_PROCESSOR_S, now - _last_s[0]))
    _last_s[0] = now
    return report


def _processor_time(reporter: pytest.TerminalReporter) -> list[str]:
    """Where the processor time of the tests went, as lines; none: nothing ran."""
    files: defaultdict[str, float] = defaultdict(float)
    for reports in reporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                file = report.nodeid.partition("::")[0]
                files[file] += sum(float(str(value)) for name, value in report.user_properties if name == _PROCESSOR_S)
    if not files:
        return []
    most = [
        f"{seconds:7.1f} s  {file}" for file, seconds in sorted(files.items(), key=lambda item: -item[1])[:_SHOWN_FILES]
    ]
    return [f"Processor time of the tests: {sum(files.values()):.0f} s, most of it in:", *most]


def _reason(report: pytest.TestReport | pytest.CollectReport) -> str:
    return str(report.longrepr[2]) if isinstance(report.longrepr, tuple) else str(report.longrepr)


def _avoidable(config: pytest.Config) -> list[str]:
    """The skips that a machine like this one need not have had, as lines."""
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if not NO_SKIPS or reporter is None:  # a worker of xdist has no reporter: its controller decides
        return []
    skipped: list[pytest.TestReport | pytest.CollectReport] = reporter.stats.get("skipped", [])
    return [f"{report.nodeid}: {_reason(report)}" for report in skipped if not needs.is_excused(_reason(report))]


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Under RARMS_NO_SKIPS=1 a skip that could be avoided is a failure of the run."""
    if _avoidable(session.config) and session.exitstatus in {pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED}:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Print where the processor time went, and the skips that failed the run."""
    for line in _processor_time(terminalreporter):
        terminalreporter.write_line(line)
    if avoidable := _avoidable(config):
        terminalreporter.section("skips that fail this run (RARMS_NO_SKIPS=1)")
        for line in avoidable:
            terminalreporter.line(line)
