<#
.SYNOPSIS
    rarms apply script: plan 5cb75784e994 of application robot, for host onboard of rarms.yaml, computer ONBOARD.
.DESCRIPTION
    task classes: 2 changed, 0 removed; no machine is stopped or changed.
    name                what is done
    task/Localization   record that it is ours, and what was there; set Background Only False -> True, BackgroundPriority 7 -> 5, Priority 7 -> 5
    task/MotionControl  record that it is ours, and what was there; set Background Only False -> True, BackgroundPriority 8 -> 7, Priority 7 -> 7
    Time: some seconds a call. It waits for no guest.
    Only these calls change something (and how often): Write-TaskRecord 2, Write-TaskValue 16.
.PARAMETER AsJson
    One JSON object a line on standard output, for a program to read; not with -Verbose, whose lines are none.
.PARAMETER LockTimeout
    Seconds to wait for another run on this computer to end, 0 to 86400.
.PARAMETER Abandon
    Close this plan's unfinished run and change nothing else.
.PARAMETER Force
    Asks nothing before it stops, removes or deletes.
.PARAMETER Test
    Gives an object for each step, with -AsJson one for all, which tells whether it is as wanted; changes nothing.
.EXAMPLE
    .\onboard.ps1 -WhatIf
    Shows what it would do; without -WhatIf it does it. Take it back with .\onboard.undo.ps1, beside it.
.NOTES
    Exit code 0: done. 1: a step failed or was declined, run it again to go on. 3: the host is not as planned, or held.
    Manifest 9727a9818d24, rarms 0.1.0. SHA-256: the undo 04804243b5d33a29837b05185699fc00f24929b60db0e3351a19b52ee43b4094, Rarms.psm1 D3B67F9601EE621A00571AAB85B1C2E807C7ADFB19452A426282E8DD4B671112.
#>

#Requires -Version 5.1
#Requires -Modules Hyper-V
#Requires -RunAsAdministrator
[CmdletBinding(SupportsShouldProcess, PositionalBinding = $false, ConfirmImpact = 'Medium')]
param([switch] $AsJson, [int] $LockTimeout = 0, [switch] $Abandon, [switch] $Force, [switch] $Test)
if ([string] $ExecutionContext.SessionState.LanguageMode -cne 'FullLanguage') { throw 'App Control: allow this script by its signer' }
if (-not $PSCommandPath -or $MyInvocation.InvocationName -ceq '.') { throw 'run this script as a file, not dot-sourced' }
$PSDefaultParameterValues = @{}
$ErrorActionPreference = 'Stop'
$VerbosePreference = 'SilentlyContinue'
Set-StrictMode -Version 3.0
$plan = {
    $script:Plan = @{
        Run = 'apply'; Plan = '5cb75784e994'; Application = 'robot'; Robot = ''; Serial = 1; Guest = ''
        Undo = 'onboard.undo.ps1'; UndoDigest = '04804243b5d33a29837b05185699fc00f24929b60db0e3351a19b52ee43b4094'
        Computer = 'ONBOARD'; Identity = 'd5f87e03212b1dc0a4dc0b9d10ddf87a'
        LogicalProcessors = 4; Cores = 4; ThreadsPerCore = 1; Percent = 360; Memory = 7516192768; AcceptScheduler = $false
    }
    # === task/Localization and 1 more alike: its values differ ====================================
    $rows = @(
        @{ Address = 'task/Localization'; Task = 'Localization'; Set = '83ae0cee1cdc'; NewSet = 'ed6954abc738'
            Action = 'set Background Only False -> True, BackgroundPriority 7 -> 5, Priority 7 -> 5'; ValueBackgroundpriority = 'dword:7'
            ValuePriority = 'dword:7'; NewValueBackgroundpriority = 'dword:5'; Value = 5 } # rarms.yaml:13:51
        @{ Address = 'task/MotionControl'; Task = 'MotionControl'; Set = '432731d71cf4'; NewSet = '59f2d42fe4cf'
            Action = 'set Background Only False -> True, BackgroundPriority 8 -> 7, Priority 7 -> 7'; ValueBackgroundpriority = 'dword:8'
            ValuePriority = 'sz:7'; NewValueBackgroundpriority = 'dword:7'; Value = 7 } # rarms.yaml:12:51
    )
    foreach ($row in $rows) {
        Use-Target -Address $row.Address -Row $row -Read { Get-TaskClassReading -Task $script:Row.Task }
        Add-Step -Action 'record that it is ours, and what was there' -Same @{ record = 'robot'; robot = '' } -Before @{
            set = $row.Set
        } -After @{
            set = $row.NewSet
        } -Set { Write-TaskRecord -Task $script:Row.Task -Application 'robot' -Robot '' -Digest $script:Row.NewSet -Before 'null' }
        Add-Step -Action $row.Action -Same @{ 'value:affinity' = 'dword:0'; 'value:clock rate' = 'dword:10000'; 'value:gpu priority' = 'dword:8'; 'value:sfio priority' = 'sz:Normal'; 'value:scheduling category' = 'sz:Medium'; values = 'affinity, background only, backgroundpriority, clock rate, gpu priority, priority, scheduling category, sfio priority' } -Before @{
            'value:background only' = 'sz:False'; 'value:backgroundpriority' = $row.ValueBackgroundpriority
            'value:priority' = $row.ValuePriority
        } -After @{
            'value:background only' = 'sz:True'; 'value:backgroundpriority' = $row.NewValueBackgroundpriority
            'value:priority' = $row.NewValueBackgroundpriority
        } -Set {
            Write-TaskValue -Task $script:Row.Task -Name 'Affinity' -Type 'DWord' -Value 0
            Write-TaskValue -Task $script:Row.Task -Name 'Background Only' -Type 'String' -Value 'True'
            Write-TaskValue -Task $script:Row.Task -Name 'BackgroundPriority' -Type 'DWord' -Value $script:Row.Value
            Write-TaskValue -Task $script:Row.Task -Name 'Clock Rate' -Type 'DWord' -Value 10000
            Write-TaskValue -Task $script:Row.Task -Name 'GPU Priority' -Type 'DWord' -Value 8
            Write-TaskValue -Task $script:Row.Task -Name 'Priority' -Type 'DWord' -Value $script:Row.Value
            Write-TaskValue -Task $script:Row.Task -Name 'SFIO Priority' -Type 'String' -Value 'Normal'
            Write-TaskValue -Task $script:Row.Task -Name 'Scheduling Category' -Type 'String' -Value 'Medium'
        }
    }
}
#region The module of rarms 0.1.0 does this, and no other: these two files, to the byte before a signature.
$folder = [System.IO.Path]::Combine($PSScriptRoot, 'Rarms')
$digests = @{
    'Rarms.psd1' = '5C2CBC1BA045328F1A5E2263A47249E83E7774F741D7FD48A69157981965587D'
    'Rarms.psm1' = 'D3B67F9601EE621A00571AAB85B1C2E807C7ADFB19452A426282E8DD4B671112'
}
$form = '(?<=\r\n)\s*# SIG # Begin signature block\r\n(?:# [^\r\n]*\r\n)*# SIG # End signature block\s*$'
foreach ($name in @($digests.Keys)) {
    $data = [System.IO.File]::ReadAllBytes([System.IO.Path]::Combine($folder, $name))
    $size = ([System.Text.Encoding]::ASCII.GetString($data) -creplace $form, '').Length
    $sum = [System.BitConverter]::ToString([System.Security.Cryptography.SHA256]::Create().ComputeHash($data, 0, $size))
    if ($sum.Replace('-', '') -cne $digests[$name]) { throw ('{0} in {1} is not that of rarms 0.1.0: put it there' -f $name, $folder) }
}
$rarms = Import-Module -Name ([System.IO.Path]::Combine($folder, 'Rarms.psd1')) -Force -PassThru
#endregion
$code = 1
if ($Force -and -not $PSBoundParameters.ContainsKey('Confirm')) { $ConfirmPreference = 'None' }
$run = @{
    Caller = $PSCmdlet; ScriptPath = $PSCommandPath; ModulePath = $folder; ExitCode = [ref] $code; Plan = $plan
    Preview = $WhatIfPreference; Confirmation = $ConfirmPreference; AsJson = $AsJson; Test = $Test
    LockTimeout = $LockTimeout; Abandon = $Abandon
}
$invoke = $rarms.ExportedFunctions['Invoke-RarmsPlan']
& $invoke -Run $run
exit $code
