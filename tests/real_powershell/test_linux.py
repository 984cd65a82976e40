"""What PowerShell for Linux alone can show: a person at the prompt, a profile, and an account without rights."""

from pathlib import Path

import pytest

from rarms_iac.powershell.render import render_observe
from tests.fake_powershell.cell import apply_script
from tests.fake_powershell.cells import fresh
from tests.fake_powershell.observing import seen
from tests.fake_powershell.run import put, run
from tests.real_powershell.engines import Engine
from tests.real_powershell.linux import a_host

pytestmark = [pytest.mark.needs("powershell-linux")]

SWITCHES = ("-AsJson", "-Force")
PREFERENCES = """\
$ErrorActionPreference = 'SilentlyContinue'
$WarningPreference = 'Stop'
$VerbosePreference = 'Continue'
$DebugPreference = 'Continue'
$InformationPreference = 'Stop'
$ProgressPreference = 'Stop'
$ConfirmPreference = 'Low'
$PSModuleAutoLoadingPreference = 'None'
$PSDefaultParameterValues = @{ '*:ErrorAction' = 'SilentlyContinue'; 'Set-VM:AutomaticStartAction' = 'Nothing' }
$OFS = ', '
Set-StrictMode -Off
function Where-Object { }
Set-Alias -Name Sort-Object -Value Out-Null
"""


@pytest.mark.parametrize("answers", ["YNA", "L"])
def test_answers_at_the_prompt_do_the_same(linux: Engine, tmp_path: Path, answers: str) -> None:
    prepared = fresh()
    wanted = prepared.furnished()
    asked = run(wanted, apply_script(prepared.plan), as_json=False, answers=answers)

    with a_host(linux, prepared.furnished(), tmp_path) as there:
        ran = there.answer(apply_script(prepared.plan), "-Confirm", answers=answers)

        assert (ran.code, asked.prompts) == (asked.code, len(answers)), ran
        assert there.host.effects == wanted.effects, ran
        assert seen(there.host) == seen(wanted)


def test_profile_reaches_neither_run_nor_observing(linux: Engine, tmp_path: Path) -> None:
    prepared = fresh()
    host = prepared.furnished()
    put(host, {"observe.ps1": render_observe()})

    with a_host(linux, host, tmp_path) as there:
        observed = there.run("observe.ps1")
        assert there.run("observe.ps1", profile=PREFERENCES) == observed
        assert (observed.code, '"name":"planning"' in observed.out, observed.err) == (0, False, ""), observed

        ran = there.run(apply_script(prepared.plan), *SWITCHES, profile=PREFERENCES)

        assert ran.code == 0, ran
        assert there.host.effects == prepared.effects()


def test_alias_of_a_profile_is_refused(linux: Engine, tmp_path: Path) -> None:
    prepared = fresh()

    with a_host(linux, prepared.furnished(), tmp_path) as there:
        alias = "Set-Alias -Name Test-Wanted -Value Get-Date\n"
        ran = there.run(apply_script(prepared.plan), *SWITCHES, profile=alias)

        assert (ran.code, "Test-Wanted" in str(ran)) == (1, True), ran
        assert there.host.effects == []


def test_script_is_refused_without_rights(linux: Engine, tmp_path: Path) -> None:
    prepared = fresh()

    with a_host(linux, prepared.furnished(elevated=False), tmp_path) as there:
        ran = there.run(apply_script(prepared.plan), *SWITCHES)

        assert (ran.code, "running as Administrator" in str(ran)) == (1, True), ran
        assert there.host.effects == []
