"""What a real PowerShell 7.6 did with a plan on a module, row by row, as the stand-in has learnt it.

The script and the module are the smallest that show them.
"""

import pytest

from tests.fake_powershell.host import DELETE, READ, WRITE, Vm, WindowsHost
from tests.fake_powershell.run import FOLDER, Ran, put, run

MACHINE = "00000002-5ade-4000-8000-000000000002"

MODULE = r"""
Set-StrictMode -Version 3.0
$ErrorActionPreference = 'Stop'
$PSDefaultParameterValues = @{}
$ConfirmPreference = 'None'

function Invoke-RarmsPlan {
    [CmdletBinding()]
    param(
        [Parameter(Mandatory)] [System.Management.Automation.PSCmdlet] $Caller,
        [Parameter(Mandatory)] [string] $ScriptPath,
        [Parameter(Mandatory)] [ref] $ExitCode,
        [Parameter(Mandatory)] [scriptblock] $Plan,
        [bool] $Preview,
        [System.Management.Automation.ConfirmImpact] $Confirmation = 'High',
        [switch] $AsJson
    )
    $script:Caller = $Caller
    $script:Confirmation = $Confirmation
    $script:WhatIfPreference = $Preview
    $script:Sets = @()
    $own = @(Get-Command -CommandType Function -Module $MyInvocation.MyCommand.Module.Name)
    $aliases = @(Get-Alias -Name @($own.Name) -ErrorAction Ignore)
    if ($aliases.Count) {
        Show-Line -Text ('an alias hides a function of rarms; remove it: ' + ($aliases.Name -join ', '))
        return
    }
    try {
        $bound = $MyInvocation.MyCommand.Module.NewBoundScriptBlock($Plan)
        & $bound
        foreach ($set in $script:Sets) {
            $script:Vm = Hyper-V\Get-VM -Id 'MACHINE'
            if ((Hyper-V\Get-VMProcessor -VM $script:Vm).Reserve -eq 40) { Show-Line -Text 'unchanged' }
            elseif (Test-Wanted) {
                [void] (& $set)
                Show-Line -Text 'changed'
            }
        }
        $ExitCode.Value = 0
    } catch {
        Show-Line -Text ([string] $_.Exception.Message)
    } finally {
        $script:Caller = $null
    }
}

function Add-Set {
    param([scriptblock] $Set)
    $script:Sets += $Set
}

function Test-Wanted {
    $ConfirmPreference = $script:Confirmation
    $script:Caller.ShouldProcess('vision', 'reserve 40')
}

function Show-Line {
    param([string] $Text)
    $Text
}
""".replace("MACHINE", MACHINE).replace("\n", "\r\n")

MANIFEST = "@{ RootModule = 'Rarms.psm1'; ModuleVersion = '0.1.0'; FunctionsToExport = @('Invoke-RarmsPlan') }\r\n"

SET = "Add-Set -Set { Hyper-V\\Set-VMProcessor -VM $script:Vm -Reserve 40 }"

IMPORTED = (
    "$rarms = Import-Module -Name (Join-Path -Path $PSScriptRoot -ChildPath 'Rarms\\Rarms.psd1') -Force -PassThru"
)
MADE = "$rarms = New-Module -Name Rarms -ScriptBlock {\r\n" + MODULE + "\r\n}"


def script(module: str = IMPORTED, plan: str = SET, impact: str = "Medium") -> str:
    """A script of this plan; the module beside it, or in it."""
    return f"""
[CmdletBinding(SupportsShouldProcess, ConfirmImpact = '{impact}')]
param([switch] $AsJson, [switch] $Force)
Set-StrictMode -Version 3.0
$plan = {{
    {plan}
}}
{module}
$code = 1
if ($Force -and -not $PSBoundParameters.ContainsKey('Confirm')) {{ $ConfirmPreference = 'None' }}
$run = @{{
    Caller = $PSCmdlet; ScriptPath = $PSCommandPath; ExitCode = [ref] $code; Plan = $plan
    Preview = $WhatIfPreference; Confirmation = $ConfirmPreference; AsJson = $AsJson
}}
$invoke = $rarms.ExportedFunctions['Invoke-RarmsPlan']
& $invoke @run
exit $code
""".replace("\n", "\r\n")


def a_host(text: str, module: str = MODULE, **facts: object) -> WindowsHost:
    """A host with the machine of the plan, and the script with its module on it."""
    host = WindowsHost(vms={MACHINE: Vm(id=MACHINE, name="vision", processors=2, reserve=80)})
    for name, value in facts.items():
        setattr(host, name, value)
    files = {"x.ps1": text, "Rarms\\Rarms.psd1": MANIFEST, "Rarms\\Rarms.psm1": module}
    put(host, {name: data.encode("ascii") for name, data in files.items()})
    return host


FORMS = pytest.mark.parametrize("module", [IMPORTED, MADE], ids=["module", "single file"])
WAYS = pytest.mark.parametrize("at_prompt", [False, True], ids=["-File", "&"])


def ran(host: WindowsHost, **how: object) -> Ran:
    return run(host, "x.ps1", **how)  # type: ignore[arg-type]  # names of options


def reserve(host: WindowsHost) -> int:
    return host.vms[MACHINE].reserve


@FORMS
@WAYS
def test_row_file_and_call_operator(module: str, at_prompt: bool) -> None:
    host = a_host(script(module))

    first, second = ran(host, at_prompt=at_prompt), ran(host, at_prompt=at_prompt)

    assert (first.lines, first.code, second.lines, second.code) == (("changed",), 0, ("unchanged",), 0)
    assert reserve(host) == 40


@FORMS
@WAYS
@pytest.mark.parametrize("by", ["switch", "preference"])
def test_row_what_if_and_the_callers_preference(module: str, at_prompt: bool, by: str) -> None:
    host = a_host(script(module), profile="" if by == "switch" else "$WhatIfPreference = $true")

    shown = ran(host, at_prompt=at_prompt, what_if=by == "switch")

    assert (len(shown.lines), shown.code, reserve(host)) == (1, 0, 80)
    assert shown.lines[0].startswith("What if: ")


@FORMS
@pytest.mark.parametrize(("answer", "left"), [("Y", 40), ("N", 80), ("A", 40), ("L", 80)])
def test_row_confirm_asks_once(module: str, answer: str, left: int) -> None:
    host = a_host(script(module))

    asked = ran(host, answers=answer)

    assert (asked.prompts, asked.code, reserve(host)) == (1, 0, left)


def test_row_without_modules_own_preference_cmdlet_asks_again() -> None:
    host = a_host(script(), module=MODULE.replace("$ConfirmPreference = 'None'", "$ConfirmPreference = 'Low'"))

    assert ran(host, answers="YY").prompts == 2


@FORMS
@pytest.mark.parametrize(
    ("how", "code", "left"),
    [({}, 1, 80), ({"force": True}, 0, 40), ({"force": True, "confirm": True}, 1, 80)],
    ids=["no console", "-Force", "-Force -Confirm"],
)
def test_row_high_impact_without_a_console(module: str, how: dict[str, bool], code: int, left: int) -> None:
    host = a_host(script(module, impact="High"))

    ended = ran(host, unanswered=True, **how)

    assert (ended.code, reserve(host)) == (code, left), ended.says


@FORMS
def test_row_a_callers_low_preference_without_a_console(module: str) -> None:
    host = a_host(script(module), profile="$ConfirmPreference = 'Low'")

    ended = ran(host, unanswered=True)

    assert (ended.code, reserve(host)) == (1, 80)
    assert "NonInteractive" in ended.lines[0]


@FORMS
@WAYS
def test_row_callers_preferences_have_no_effect(module: str, at_prompt: bool) -> None:
    host = a_host(
        script(module),
        profile="$ErrorActionPreference = 'SilentlyContinue'\r\nSet-StrictMode -Off",
        defaults={"*:ErrorAction": "SilentlyContinue"},
        refusals={"Set-VMProcessor": ("E1", "X", "no")},
    )

    assert ran(host, at_prompt=at_prompt).lines == ("no",)


@FORMS
def test_row_functions_of_caller_called_like_modules_own(module: str) -> None:
    host = a_host(script(module), profile="function Test-Wanted { $false }\r\nfunction Show-Line { 'hidden' }")

    assert (ran(host).lines, reserve(host)) == (("changed",), 40)


@FORMS
@WAYS
def test_row_aliases_of_caller_come_before_modules_functions(module: str, at_prompt: bool) -> None:
    profile = "function Yes { $true }"
    host = a_host(script(module), profile=profile, aliases={"test-wanted": "Yes"})
    unguarded = MODULE.replace("if ($aliases.Count)", "if ($false)")
    open_host = a_host(
        script(module.replace(MODULE, unguarded)), module=unguarded, profile=profile, aliases={"test-wanted": "Yes"}
    )

    ended = ran(host, at_prompt=at_prompt)
    passed = ran(open_host, at_prompt=at_prompt, answers="N")

    assert (ended.code, "test-wanted" in ended.lines[0], reserve(host)) == (1, True, 80)
    assert (passed.prompts, reserve(open_host)) == (0, 40)


def test_row_another_version_loaded_before() -> None:
    other = "function Invoke-RarmsPlan { 'the other' }\r\n"
    loads = "Import-Module -Name 'C:\\run\\other\\Rarms.psm1'"
    host = a_host(script(), profile=loads)
    put(host, {"other\\Rarms.psm1": other.encode("ascii")})

    assert ran(host).lines == ("changed",)


def test_only_what_the_manifest_names_is_exported() -> None:
    text = f"{IMPORTED}\r\n$rarms.ExportedFunctions.Keys\r\n$rarms.Version\r\nShow-Line -Text 'private'\r\n"

    with pytest.raises(BaseException, match="the command Show-Line"):
        ran(a_host(text))
    assert ran(a_host(text.replace("Show-Line -Text", "'no' +"))).lines[:2] == ("Invoke-RarmsPlan", "0.1.0")


@pytest.mark.parametrize("at_prompt", [False, True], ids=["-File", "&"])
def test_row_module_sees_what_if_of_file_alone(at_prompt: bool) -> None:
    """`-File x.ps1 -WhatIf` runs in the global scope, which the module sees; `.\\x.ps1 -WhatIf` does not."""
    module = (
        "function Invoke-Own {\r\n[CmdletBinding(SupportsShouldProcess)]\r\nparam()\r\n"
        "if ($PSCmdlet.ShouldProcess('a', 'b')) { 'did it' }\r\n}\r\n"
    )
    text = (
        "[CmdletBinding(SupportsShouldProcess)]\r\nparam([switch] $AsJson)\r\n"
        "$m = Import-Module -Name 'C:\\run\\Rarms\\Rarms.psm1' -PassThru\r\n"
        "$own = $m.ExportedFunctions['Invoke-Own']\r\n& $own\r\n"
    )

    shown = ran(a_host(text, module=module), what_if=True, at_prompt=at_prompt)

    assert ("did it" in shown.lines) is at_prompt


def test_row_strict_mode_is_the_modules_own() -> None:
    module = "Set-StrictMode -Version 3.0\r\nfunction Get-Missing { $table = @{}\r\n$table.Missing }\r\n"
    text = (
        "$m = Import-Module -Name 'C:\\run\\Rarms\\Rarms.psm1' -PassThru\r\n"
        "$table = @{}\r\n$a = $table.Missing\r\n'lenient'\r\n"
        "$missing = $m.ExportedFunctions['Get-Missing']\r\ntry { & $missing } catch { 'strict' }\r\n"
    )

    assert ran(a_host(text, module=module), at_prompt=True).lines == ("lenient", "strict")


def test_row_late_block_sees_no_loop_variable() -> None:
    plan = "foreach ($row in @('40')) { Add-Set -Set { Hyper-V\\Set-VMProcessor -VM $script:Vm -Reserve $row } }"

    ended = ran(a_host(script(plan=plan)))

    assert ended.lines == ("The variable '$row' cannot be retrieved because it has not been set.",)


def test_row_module_variable_reaches_late_block() -> None:
    module = """
function Add-Set {
    param($Row, [scriptblock] $Set)
    $script:Sets += @{ Row = $Row; Set = $Set }
}
function Invoke-All {
    param([scriptblock] $Plan)
    $script:Sets = @()
    $bound = $MyInvocation.MyCommand.Module.NewBoundScriptBlock($Plan)
    & $bound
    foreach ($one in $script:Sets) {
        $set = $one.Set
        $script:Row = $one.Row
        & $set
    }
}
""".replace("\n", "\r\n")
    text = r"""
$m = Import-Module -Name 'C:\run\Rarms\Rarms.psm1' -PassThru
$plan = {
    $rows = @(
        @{ Name = 'a'
            Size = 5 } # a place
        @{ Name = 'b'; Size = 6 }
    )
    foreach ($row in $rows) { Add-Set -Row $row -Set { '{0} {1}' -f $script:Row.Name, $script:Row.Size } }
}
$invoke = $m.ExportedFunctions['Invoke-All']
& $invoke -Plan $plan
""".replace("\n", "\r\n")

    assert ran(a_host(text, module=module)).lines == ("a 5", "b 6")


def test_row_the_command_path_is_the_modules() -> None:
    module = "function Get-Place { $PSCommandPath }\r\n"
    text = (
        "$m = Import-Module -Name 'C:\\run\\Rarms\\Rarms.psm1' -PassThru\r\n"
        "$place = $m.ExportedFunctions['Get-Place']\r\n& $place\r\n$PSCommandPath\r\n"
    )

    assert ran(a_host(text, module=module)).lines == (f"{FOLDER}\\Rarms\\Rarms.psm1", f"{FOLDER}\\x.ps1")


def test_row_exit_in_function_ends_the_script() -> None:
    module = "function Stop-All { exit 42 }\r\n"
    text = (
        "$m = Import-Module -Name 'C:\\run\\Rarms\\Rarms.psm1' -PassThru\r\n"
        "$stop = $m.ExportedFunctions['Stop-All']\r\n& $stop\r\n'not reached'\r\n"
    )
    ended = ran(a_host(text, module=module))

    assert (ended.code, ended.lines) == (42, ())


OPENED = "C:\\run\\held.txt"


@pytest.mark.parametrize(
    ("statement", "held", "reads"),
    [
        ("[void] [System.IO.File]::ReadAllBytes('{}')", (WRITE, READ), False),
        ("[void] [System.IO.File]::ReadAllBytes('{}')", (READ, READ), True),
        ("[System.IO.File]::Delete('{}')", (READ, READ), False),
        ("[System.IO.File]::Delete('{}')", (READ, READ | DELETE), True),
        ("[System.IO.FileStream]::new('{}', 'Open', 'Read', 'ReadWrite, Delete').Dispose()", (WRITE, READ), True),
        ("[System.IO.FileStream]::new('{}', 'Open', 'Read', 'ReadWrite').Dispose()", (WRITE, READ), True),
        ("[System.IO.FileStream]::new('{}', 'Open', 'Read', 'Read').Dispose()", (WRITE, READ), False),
        ("[System.IO.FileStream]::new('{}', 'OpenOrCreate', 'Write', 'Read').Dispose()", (WRITE, READ), False),
        ("[System.IO.FileStream]::new('{}', 'OpenOrCreate', 'Write', 'Read').Dispose()", (READ, READ), False),
    ],
)
def test_files_are_shared_as_each_process_lets_others(
    statement: str, held: tuple[frozenset[str], frozenset[str]], reads: bool
) -> None:
    text = f"try {{ {statement.format(OPENED)}\r\n'done' }} catch [System.IO.IOException] {{ 'in use' }}\r\n"
    host = a_host(text)
    host.write_file(OPENED, b"held")
    host.open(OPENED, *held, here=False)

    assert ran(host).lines[-1] == ("done" if reads else "in use")
