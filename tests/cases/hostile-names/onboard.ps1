<#
.SYNOPSIS
    rarms apply script: plan f7a53c523cbc of application robot, for host onboard of rarms.yaml, computer ONBOARD.
.DESCRIPTION
    1 machine added, 0 changed, 0 stopped, 0 removed; 0 disks deleted.
    machine  processors  reserve                weight  memory  disk  switch                                       secure boot  start
    vision   2           1.6 LP (80 % of each)  100     1 GiB   none  lab 'a' \u2018b\u2019 \u201ac\u201b $(x) `n  default      start
    Time: a few seconds for each call. The script waits at most 300 s at the end, if a guest is just restarting.
    Only these calls change something, with their numbers: Move-NewPartition 1, New-VM 1, Rename-VM 1, Set-VM 1, Set-VMMemory 1, Set-VMProcessor 1, Start-VM 1, Write-Mark 1.
.PARAMETER AsJson
    Writes one JSON object per line to standard output, for a program. Cannot be combined with -Verbose.
.PARAMETER LockTimeout
    Seconds to wait for another run on this computer, 0 to 86400.
.PARAMETER Abandon
    Closes this plan's unfinished run. Changes nothing else.
.PARAMETER Force
    Does not ask before stopping, removing or deleting.
.PARAMETER Test
    Returns an object for each step, or with -AsJson one for all, that shows whether it is done. Changes nothing.
.EXAMPLE
    .\onboard.ps1 -WhatIf
    Shows the changes. Without -WhatIf, makes them. To undo them, run .\onboard.undo.ps1 in the same folder.
.NOTES
    Exit code 0: done. 1: a step failed or was declined; run it again to continue. 3: the host is not as planned, or locked.
    Manifest b7d3c6585bb8, rarms 0.1.0. SHA-256: the undo 17e4f68c876deb97e068e375839e70483a2e3e2f9b99636c4ce7b6288ea4cc30, Rarms.psm1 047C93329B8C9BDFA3A302D8925E0BD435E0A17F6BA7301A7DBA0CC3C932073F.
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
        Run = 'apply'; Purpose = 'apply'; Plan = 'f7a53c523cbc'; Application = 'robot'; Robot = ''; Serial = 0; Guest = ''
        Undo = 'onboard.undo.ps1'; UndoDigest = '17e4f68c876deb97e068e375839e70483a2e3e2f9b99636c4ce7b6288ea4cc30'
        Computer = 'ONBOARD'; Identity = 'd5f87e03212b1dc0a4dc0b9d10ddf87a'
        LogicalProcessors = 4; Cores = 4; ThreadsPerCore = 1; Percent = 360; Memory = 7516192768; AcceptScheduler = $false
    }
    # === vision: it does not exist (rarms.yaml:15:3) ==============================================
    Use-Target -Address 'partition/vision' -Read { Get-PartitionReading -Name 'vision' }
    Add-Step -Action 'make a machine of generation 2 with 1 GiB' -Before @{ exists = $false; taken = $false } -After @{
        exists = $true; generation = 2; memory = 1073741824
    } -Set {
        Hyper-V\New-VM -Name 'vision.rarms-f7a53c523cbc' -Generation 2 -MemoryStartupBytes 1073741824 -NoVHD -SwitchName ('' + 'lab ''a'' ' + [char]0x2018 + 'b' + [char]0x2019 + ' ' + [char]0x201A + 'c' + [char]0x201B + ' $(x) `n') -Path ('' + 'D:\it''s ' + [char]0x2019 + ' $env:TEMP $(t)')
    }
    Add-Step -Action 'set all its settings, and its name last' -Before @{ taken = $false } -After @{
        checkpoints = 'disabled'; dynamic_memory = $false; limit = 100; mark = 'robot/vision'; memory = 1073741824; name = 'vision'
        processors = 2; reserve = 80; set = '361ebcdb6468'; start_action = 'start'; state = 'off'; stop_action = 'shut_down'; weight = 100
    } -Set {
        if (Test-Open -Name 'dynamic_memory', 'memory') { Hyper-V\Set-VMMemory -VM $script:Vm -DynamicMemoryEnabled $false -StartupBytes 1073741824 }
        Move-NewPartition -From ('' + 'D:\it''s ' + [char]0x2019 + ' $env:TEMP $(t)\vision.rarms-f7a53c523cbc') -To ('' + 'D:\it''s ' + [char]0x2019 + ' $env:TEMP $(t)\vision')
        if (Test-Open -Name 'mark', 'set') { Write-Mark }
        if (Test-Open -Name 'processors', 'reserve', 'limit', 'weight') { Hyper-V\Set-VMProcessor -VM $script:Vm -Count 2 -Reserve 80 -Maximum 100 -RelativeWeight 100 }
        if (Test-Open -Name 'start_action', 'stop_action', 'checkpoints') { Hyper-V\Set-VM -VM $script:Vm -AutomaticStartAction 'Start' -AutomaticStopAction 'ShutDown' -CheckpointType 'Disabled' }
        if (Test-Open -Name 'name') { Hyper-V\Rename-VM -VM $script:Vm -NewName 'vision' }
    }
    # === vision: start it (rarms.yaml:15:3) =======================================================
    Use-Target -Address 'partition/vision' -Read { Get-PartitionReading -Name 'vision' }
    Add-Step -Action 'start it' -Fits { Test-Capacity -Processors 2 -Reserve 80 -Memory 1073741824 } -Before @{ state = 'off' } -After @{
        state = 'running'
    } -Set { Hyper-V\Start-VM -VM $script:Vm }
}
#region The module of rarms 0.1.0: load it only if its two files are unchanged, except for signatures.
$folder = [System.IO.Path]::Combine($PSScriptRoot, 'Rarms')
$digests = @{
    'Rarms.psd1' = 'E34D70EEBED3B347459676463006E905A6034EF64AFBB52A35975F77E0BA1F4C'
    'Rarms.psm1' = '047C93329B8C9BDFA3A302D8925E0BD435E0A17F6BA7301A7DBA0CC3C932073F'
}
$form = '(?<=\r\n)\s*# SIG # Begin signature block\r\n(?:# [^\r\n]*\r\n)*# SIG # End signature block\s*$'
foreach ($name in @($digests.Keys)) {
    $file = [System.IO.Path]::Combine($folder, $name)
    if (-not ([System.IO.File]::Exists($file))) { throw ('{0} is missing: copy the folder Rarms next to this script' -f $file) }
    $data = [System.IO.File]::ReadAllBytes($file)
    $text = [System.Text.Encoding]::ASCII.GetString($data)
    $sum = [System.Security.Cryptography.SHA256]::Create().ComputeHash($data, 0, ($text -creplace $form, '').Length)
    if ([System.BitConverter]::ToString($sum).Replace('-', '') -ceq $digests[$name]) { continue }
    if ($text -cmatch '\r') { throw ('{0} is not from rarms 0.1.0: copy that version' -f $file) }
    throw ('{0} has changed line ends: in git, set "*.ps* -text"' -f $file)
}
$file = [WildcardPattern]::Escape([System.IO.Path]::Combine($folder, 'Rarms.psm1'))
$rarms = Import-Module -Name $file -Force -PassThru -Function '*-Rarms*' # a .psd1 fails in a folder with a bracket
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
