"""A run that another version of rarms began: its journal holds that version's script, which is finished as it is."""

import hashlib
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.applying.execute import finish_unfinished
from rarms_iac.applying.run_report import RunEnding, RunReport
from rarms_iac.applying.undo import abandon, script_undone, undo
from rarms_iac.model.journal import RunOrigin
from rarms_iac.model.plan import Plan
from rarms_iac.providers.hyperv.provider import LiveHypervHost
from rarms_iac.storage.records import records_in, sealed_line
from tests.builders import a_host
from tests.fake_powershell.cell import apply
from tests.fake_powershell.cells import everything
from tests.fake_powershell.host import WindowsHost
from tests.fake_powershell.observing import JOURNAL, seen
from tests.fake_powershell.transport import FakePowerShellTransport

ORIGIN = RunOrigin(by="engineer", at="2026-11-21T08:00:00Z")


def of_an_older_version(plan: Plan) -> Plan:
    """The plan with scripts that no template of today makes: another fact, default and way to find its module."""
    (part,) = plan.hosts
    changes = {
        "        Run = '": "        Silence = 5; Run = '",
        "[int] $LockTimeout = 0": "[int] $LockTimeout = 1",
        "[System.IO.Path]::Combine($PSScriptRoot, 'Rarms')": "Join-Path -Path $PSScriptRoot -ChildPath 'Rarms'",
    }
    older = dict(part.scripts)
    for name in sorted(older, key=lambda name: ".undo." not in name):
        for old, new in changes.items():
            assert old in older[name]
            older[name] = older[name].replace(old, new)
        if ".undo." not in name:
            undo_digest = hashlib.sha256(older[name.replace(".ps1", ".undo.ps1")].encode("ascii")).hexdigest()
            older[name] = re.sub("UndoDigest = '[0-9a-f]{64}'", f"UndoDigest = '{undo_digest}'", older[name])
    return replace(plan, hosts=(replace(part, scripts=older),))


def killed_in_the_middle() -> tuple[WindowsHost, Plan]:
    prepared = everything()
    plan = of_an_older_version(prepared.plan)
    host = prepared.copy(kill_after=25)
    assert apply(host, plan).code is None
    return host.copy(), plan


def live(host: WindowsHost) -> LiveHypervHost:
    return LiveHypervHost(a_host("onboard"), FakePowerShellTransport(host))


def finished(host: WindowsHost) -> RunReport | None:
    return finish_unfinished([live(host)])


def test_upgraded_host_finishes_run_as_begun() -> None:
    host, _ = killed_in_the_middle()
    undisturbed = everything().copy()
    apply(undisturbed, everything().plan)

    report = finished(host)

    assert report is not None
    assert (report.ending, report.findings) == (RunEnding.DONE, ())
    assert seen(host) == seen(undisturbed)
    assert live(host).unfinished() is None


def test_upgraded_host_undoes_by_journals_script() -> None:
    host, _ = killed_in_the_middle()
    same = everything().after_a_run(kill_after=25)

    report = undo(live(host), ORIGIN)
    undo(live(same), ORIGIN)

    assert report.ending is RunEnding.DONE
    assert seen(host) == seen(same)


def test_its_undo_is_told_as_its_script_says() -> None:
    host, _ = killed_in_the_middle()
    journal = live(host).journal()
    assert journal is not None

    told = script_undone(journal)

    assert any(line.startswith("vision ") for line in told)
    assert not any(line.startswith("Not undone") for line in told)


def forge_journal(host: WindowsHost, old: str, new: str) -> None:
    """In its script and in its undo, with lengths and checksums that fit."""
    first, *records = records_in(host.data(JOURNAL), Path("journal.jsonl"))
    assert old in str(first["undo"])
    for name in ("script", "undo"):
        first[name] = str(first[name]).replace(old, new)
    host.write_file(JOURNAL, b"".join(map(sealed_line, [first, *records])))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("    Use-Target", "    # wäit\r\n    Use-Target"),
        ("    Use-Target", "    }\r\n    Use-Target"),
    ],
)
@pytest.mark.parametrize(
    "ask",
    [
        finished,
        lambda host: undo(live(host), ORIGIN),
        lambda host: abandon(live(host)),
    ],
    ids=["finish", "undo", "abandon"],
)
def test_a_damaged_script_of_a_journal_runs_nothing(
    ask: Callable[[WindowsHost], RunReport], old: str, new: str
) -> None:
    host, _ = killed_in_the_middle()
    forge_journal(host, old, new)
    before = list(host.effects)

    report = ask(host)

    assert report.ending is RunEnding.FAILED
    (problem,) = report.findings
    assert "in its journal is damaged: line" in problem.detail
    assert host.effects == before
