<#
.SYNOPSIS
    rarms apply script: plan 2d41b4e75ed0 of application robot, for host onboard of rarms.yaml, computer ONBOARD.
.DESCRIPTION
    2 machines added, 0 changed, 0 stopped, 0 removed; 0 disks deleted.
    machine  processors  reserve                weight  memory   disk  switch  secure boot  start
    door     1           1 LP (100 % of each)   100     256 MiB  none  none    default      start
    speech   1           0.8 LP (80 % of each)  200     512 MiB  none  none    default      start
    Time: a few seconds for each call. The script waits 60 s while machines start, one after another; at most 300 s at the end, if a guest is just restarting.
    Only these calls change something, with their numbers: New-VM 2, Remove-VMNetworkAdapter 2, Rename-VM 2, Set-VM 2, Set-VMMemory 2, Set-VMProcessor 4, Start-VM 2, Write-Mark 2.
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
    Manifest ee4efea13b84, rarms 0.1.0. SHA-256: the undo cd148999a82b7ebefd62f16db4c2bb264d2dc0eb8b684b5a9be130de5c971848, Rarms.psm1 047C93329B8C9BDFA3A302D8925E0BD435E0A17F6BA7301A7DBA0CC3C932073F.
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
        Run = 'apply'; Purpose = 'apply'; Plan = '2d41b4e75ed0'; Application = 'robot'; Robot = ''; Serial = 0; Guest = ''
        Undo = 'onboard.undo.ps1'; UndoDigest = 'cd148999a82b7ebefd62f16db4c2bb264d2dc0eb8b684b5a9be130de5c971848'
        Computer = 'ONBOARD'; Identity = 'd5f87e03212b1dc0a4dc0b9d10ddf87a'
        LogicalProcessors = 4; Cores = 4; ThreadsPerCore = 1; Percent = 360; Memory = 7516192768; AcceptScheduler = $false
    }
    # === door: it does not exist (rarms.yaml:14:3) ================================================
    Use-Target -Address 'partition/door' -Read { Get-PartitionReading -Name 'door' }
    Add-Step -Action 'make a machine of generation 2 with 256 MiB' -Before @{ exists = $false; taken = $false } -After @{
        exists = $true; generation = 2; memory = 268435456
    } -Set { Hyper-V\New-VM -Name 'door.rarms-2d41b4e75ed0' -Generation 2 -MemoryStartupBytes 268435456 -NoVHD }
    Add-Step -Action 'set all its settings, and its name last' -Before @{ adapters = 1; taken = $false } -After @{
        adapters = 0; checkpoints = 'disabled'; dynamic_memory = $false; limit = 100; mark = 'robot/door'; memory = 268435456; name = 'door'
        processors = 1; reserve = 100; set = '5805e8f8f9bc'; start_action = 'start'; state = 'off'; stop_action = 'shut_down'; weight = 100
    } -Set {
        if (Test-Open -Name 'dynamic_memory', 'memory') { Hyper-V\Set-VMMemory -VM $script:Vm -DynamicMemoryEnabled $false -StartupBytes 268435456 }
        if (Test-Open -Name 'adapters') { Hyper-V\Remove-VMNetworkAdapter -VM $script:Vm }
        if (Test-Open -Name 'mark', 'set') { Write-Mark }
        if (Test-Open -Name 'processors', 'reserve', 'limit', 'weight') { Hyper-V\Set-VMProcessor -VM $script:Vm -Count 1 -Reserve 100 -Maximum 100 -RelativeWeight 100 }
        if (Test-Open -Name 'start_action', 'stop_action', 'checkpoints') { Hyper-V\Set-VM -VM $script:Vm -AutomaticStartAction 'Start' -AutomaticStopAction 'ShutDown' -CheckpointType 'Disabled' }
        if (Test-Open -Name 'name') { Hyper-V\Rename-VM -VM $script:Vm -NewName 'door' }
    }

    # === speech: it does not exist (rarms.yaml:13:3) ==============================================
    Use-Target -Address 'partition/speech' -Read { Get-PartitionReading -Name 'speech' }
    Add-Step -Action 'make a machine of generation 2 with 512 MiB' -Before @{ exists = $false; taken = $false } -After @{
        exists = $true; generation = 2; memory = 536870912
    } -Set { Hyper-V\New-VM -Name 'speech.rarms-2d41b4e75ed0' -Generation 2 -MemoryStartupBytes 536870912 -NoVHD }
    Add-Step -Action 'set all its settings, and its name last' -Before @{ adapters = 1; taken = $false } -After @{
        adapters = 0; checkpoints = 'disabled'; dynamic_memory = $false; limit = 100; mark = 'robot/speech'; memory = 536870912
        name = 'speech'; processors = 1; reserve = 80; set = '6e07bbd865ca'; start_action = 'start'; state = 'off'
        stop_action = 'shut_down'; weight = 200
    } -Set {
        if (Test-Open -Name 'dynamic_memory', 'memory') { Hyper-V\Set-VMMemory -VM $script:Vm -DynamicMemoryEnabled $false -StartupBytes 536870912 }
        if (Test-Open -Name 'adapters') { Hyper-V\Remove-VMNetworkAdapter -VM $script:Vm }
        if (Test-Open -Name 'mark', 'set') { Write-Mark }
        if (Test-Open -Name 'processors', 'reserve', 'limit', 'weight') { Hyper-V\Set-VMProcessor -VM $script:Vm -Count 1 -Reserve 80 -Maximum 100 -RelativeWeight 200 }
        if (Test-Open -Name 'start_action', 'stop_action', 'checkpoints') { Hyper-V\Set-VM -VM $script:Vm -AutomaticStartAction 'Start' -AutomaticStopAction 'ShutDown' -CheckpointType 'Disabled' }
        if (Test-Open -Name 'name') { Hyper-V\Rename-VM -VM $script:Vm -NewName 'speech' }
    }
    Add-Step -Action 'for its start: reserve 0.8 -> 1 LP (80 -> 100 % of its processor)' -Before @{ exists = $true } -After @{
        limit = 100; reserve = 100; weight = 200
    } -Set { Hyper-V\Set-VMProcessor -VM $script:Vm -Reserve 100 -Maximum 100 -RelativeWeight 200 }
    # === speech: start it (rarms.yaml:13:3) =======================================================
    Use-Target -Address 'partition/speech' -Read { Get-PartitionReading -Name 'speech' }
    Add-Step -Action 'start it' -Fits { Test-Capacity -Processors 1 -Reserve 100 -Memory 536870912 } -Before @{ state = 'off' } -After @{
        state = 'running'
    } -Set { Hyper-V\Start-VM -VM $script:Vm }
    Use-Target -Address 'partition/speech' -Read { Get-PartitionReading -Name 'speech' }
    Add-Step -Action '60 s after its start: reserve 1 -> 0.8 LP (100 -> 80 % of its processor)' -Before @{ exists = $true } -After @{
        limit = 100; reserve = 80; weight = 200
    } -Set {
        Wait-Start -Milliseconds 60000
        Hyper-V\Set-VMProcessor -VM $script:Vm -Reserve 80 -Maximum 100 -RelativeWeight 200
    }
    # === door: start it (rarms.yaml:14:3) =========================================================
    Use-Target -Address 'partition/door' -Read { Get-PartitionReading -Name 'door' }
    Add-Step -Action 'start it' -Fits { Test-Capacity -Processors 1 -Reserve 100 -Memory 268435456 } -Before @{ state = 'off' } -After @{
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
