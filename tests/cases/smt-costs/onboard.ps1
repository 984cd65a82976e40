<#
.SYNOPSIS
    rarms apply script: plan 237766638b21 of application robot, for host onboard of rarms.yaml, computer ONBOARD.
.DESCRIPTION
    3 machines added, 0 changed, 0 stopped, 0 removed; nothing deleted.
    machine  processors  reserve                 memory  disk  switch  secure boot  start
    mapping  1           0.5 LP (50 % of each)   1 GiB   none  none    as made      start
    speech   3           2.85 LP (95 % of each)  1 GiB   none  none    as made      start
    vision   2           1.9 LP (95 % of each)   1 GiB   none  none    as made      start
    Time: some seconds a call. It waits 300 s at most at the end, where a guest restarts just then.
    Only these calls change something (and how often): New-VM 3, Remove-VMNetworkAdapter 3, Rename-VM 3, Set-VM 3, Set-VMMemory 3, Set-VMProcessor 3, Start-VM 3, Write-Mark 3.
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
    Manifest 591d58bc2b56, rarms 0.1.0. SHA-256: the undo c9197df545f4a094cef15bd7129a6fa05c6ab00a0f494e18ed093fdd555d9499, Rarms.psm1 D3B67F9601EE621A00571AAB85B1C2E807C7ADFB19452A426282E8DD4B671112.
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
        Run = 'apply'; Plan = '237766638b21'; Application = 'robot'; Robot = ''; Serial = 0; Guest = ''
        Undo = 'onboard.undo.ps1'; UndoDigest = 'c9197df545f4a094cef15bd7129a6fa05c6ab00a0f494e18ed093fdd555d9499'
        Computer = 'ONBOARD'; Identity = 'd5f87e03212b1dc0a4dc0b9d10ddf87a'
        LogicalProcessors = 8; Cores = 4; ThreadsPerCore = 2; Percent = 800; Memory = 17179869184; AcceptScheduler = $false
    }
    # === mapping and 2 more alike: it is not there ================================================
    $rows = @(
        @{ Address = 'partition/mapping'; Name = 'mapping'; Name2 = 'mapping.rarms-237766638b21'; NewMark = 'robot/mapping'
            NewProcessors = 1; NewReserve = 50; NewSet = 'b81e386612c8'; NewWeight = 100 } # rarms.yaml:13:3
        @{ Address = 'partition/speech'; Name = 'speech'; Name2 = 'speech.rarms-237766638b21'; NewMark = 'robot/speech'; NewProcessors = 3
            NewReserve = 95; NewSet = 'e2151f12c2ec'; NewWeight = 200 } # rarms.yaml:12:3
        @{ Address = 'partition/vision'; Name = 'vision'; Name2 = 'vision.rarms-237766638b21'; NewMark = 'robot/vision'; NewProcessors = 2
            NewReserve = 95; NewSet = '93dda9d42ef5'; NewWeight = 300 } # rarms.yaml:11:3
    )
    foreach ($row in $rows) {
        Use-Target -Address $row.Address -Row $row -Read { Get-PartitionReading -Name $script:Row.Name }
        Add-Step -Action 'make a machine of generation 2 with 1 GiB' -Before @{ exists = $false; taken = $false } -After @{
            exists = $true; generation = 2; memory = 1073741824
        } -Set { Hyper-V\New-VM -Name $script:Row.Name2 -Generation 2 -MemoryStartupBytes 1073741824 -NoVHD }
        Add-Step -Action 'give it all its settings, and its name last' -Before @{ adapters = 1; taken = $false } -After @{
            adapters = 0; checkpoints = 'disabled'; dynamic_memory = $false; limit = 100; mark = $row.NewMark; memory = 1073741824
            name = $row.Name; processors = $row.NewProcessors; reserve = $row.NewReserve; set = $row.NewSet; start_action = 'start'
            state = 'off'; stop_action = 'shut_down'; weight = $row.NewWeight
        } -Set {
            if (Test-Open -Name 'dynamic_memory', 'memory') { Hyper-V\Set-VMMemory -VM $script:Vm -DynamicMemoryEnabled $false -StartupBytes 1073741824 }
            if (Test-Open -Name 'adapters') { Hyper-V\Remove-VMNetworkAdapter -VM $script:Vm }
            if (Test-Open -Name 'mark', 'set') { Write-Mark }
            if (Test-Open -Name 'processors', 'reserve', 'limit', 'weight') { Hyper-V\Set-VMProcessor -VM $script:Vm -Count $script:Row.NewProcessors -Reserve $script:Row.NewReserve -Maximum 100 -RelativeWeight $script:Row.NewWeight }
            if (Test-Open -Name 'start_action', 'stop_action', 'checkpoints') { Hyper-V\Set-VM -VM $script:Vm -AutomaticStartAction 'Start' -AutomaticStopAction 'ShutDown' -CheckpointType 'Disabled' }
            if (Test-Open -Name 'name') { Hyper-V\Rename-VM -VM $script:Vm -NewName $script:Row.Name }
        }
    }
    # === vision and 2 more alike: start it ========================================================
    $rows = @(
        @{ Address = 'partition/vision'; Name = 'vision'; Processors = 2; Reserve = 95 } # rarms.yaml:11:3
        @{ Address = 'partition/speech'; Name = 'speech'; Processors = 3; Reserve = 95 } # rarms.yaml:12:3
        @{ Address = 'partition/mapping'; Name = 'mapping'; Processors = 1; Reserve = 50 } # rarms.yaml:13:3
    )
    foreach ($row in $rows) {
        Use-Target -Address $row.Address -Row $row -Read { Get-PartitionReading -Name $script:Row.Name }
        Add-Step -Action 'start it' -Fits { Test-Capacity -Processors $script:Row.Processors -Reserve $script:Row.Reserve -Memory 1073741824 } -Before @{
            state = 'off'
        } -After @{
            state = 'running'
        } -Set { Hyper-V\Start-VM -VM $script:Vm }
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
