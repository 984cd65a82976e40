<#
.SYNOPSIS
    rarms apply script: plan 7d9c284f7444 of application robot, for host onboard of rarms.yaml, computer ONBOARD.
.DESCRIPTION
    0 machines added, 0 changed, 2 stopped, 2 removed; 1 disk deleted; task classes: 1 changed, 0 removed.
    name        the running step                                                    off
    speech      stopped; removed                                                    for good, after at most 120 s
    task/Games  set Priority 4 -> 2; delete its record: rarms no longer manages it
    vision      stopped; removed; delete its disk D:\vms\vision-0123456789ab.vhdx   for good, after at most 120 s
    Time: a few seconds for each call. The script waits at most 240 s while guests stop, one after another; at most 300 s at the end, if a guest is just restarting.
    Only these calls change something, with their numbers: Remove-Item 1, Remove-TaskRecord 1, Remove-TaskValue 1, Remove-VM 2, Stop-Partition 2, Write-TaskValue 7.
    Not undone: speech, vision: the partition cannot be created again
    Not undone: vision: the data on the disk is lost
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
    Manifest a2bf30ff37fc, rarms 0.1.0. SHA-256: the undo 27bb513e593959430f895ec10acbbb14cedf152807120dede04b7f14c2e98ad5, Rarms.psm1 047C93329B8C9BDFA3A302D8925E0BD435E0A17F6BA7301A7DBA0CC3C932073F.
#>

#Requires -Version 5.1
#Requires -Modules Hyper-V
#Requires -RunAsAdministrator
[CmdletBinding(SupportsShouldProcess, PositionalBinding = $false, ConfirmImpact = 'High')]
param([switch] $AsJson, [int] $LockTimeout = 0, [switch] $Abandon, [switch] $Force, [switch] $Test)
if ([string] $ExecutionContext.SessionState.LanguageMode -cne 'FullLanguage') { throw 'App Control: allow this script by its signer' }
if (-not $PSCommandPath -or $MyInvocation.InvocationName -ceq '.') { throw 'run this script as a file, not dot-sourced' }
$PSDefaultParameterValues = @{}
$ErrorActionPreference = 'Stop'
$VerbosePreference = 'SilentlyContinue'
Set-StrictMode -Version 3.0
$plan = {
    $script:Plan = @{
        Run = 'apply'; Purpose = 'destroy'; Plan = '7d9c284f7444'; Application = 'robot'; Robot = ''; Serial = 1; Guest = ''
        Undo = 'onboard.undo.ps1'; UndoDigest = '27bb513e593959430f895ec10acbbb14cedf152807120dede04b7f14c2e98ad5'
        Computer = 'ONBOARD'; Identity = 'd5f87e03212b1dc0a4dc0b9d10ddf87a'
        LogicalProcessors = 4; Cores = 4; ThreadsPerCore = 1; Percent = 360; Memory = 7516192768; AcceptScheduler = $false
    }
    # === speech: it is not planned for this host (rarms.yaml:14:3) ================================
    Use-Target -Address 'partition/speech' -Read { Get-PartitionReading -Machine '00000001-5ade-4000-8000-000000000001' }
    Add-Step -Action 'stop it (shut down, after 60 s forced, turned off after 120 s)' -Before @{ state = 'running' } -After @{
        state = 'off'
    } -Set { Stop-Partition -GraceMs 120000 }
    Add-Step -Action 'remove it' -Before @{
        disks = 0; exists = $true; machine = '00000001-5ade-4000-8000-000000000001'; name = 'speech'; snapshots = 0; state = 'off'
    } -After @{
        exists = $false
    } -Set { Hyper-V\Remove-VM -VM $script:Vm -Force }

    # === vision: it is not planned for this host (rarms.yaml:13:3) ================================
    Use-Target -Address 'partition/vision' -Read { Get-PartitionReading -Machine '00000002-5ade-4000-8000-000000000002' }
    Add-Step -Action 'stop it (shut down, after 60 s forced, turned off after 120 s)' -Before @{ state = 'running' } -After @{
        state = 'off'
    } -Set { Stop-Partition -GraceMs 120000 }
    Add-Step -Action 'remove it, keep its other disks' -Before @{
        disks = 2; exists = $true; machine = '00000002-5ade-4000-8000-000000000002'; name = 'vision'; snapshots = 0; state = 'off'
    } -After @{
        exists = $false
    } -Set { Hyper-V\Remove-VM -VM $script:Vm -Force }
    Use-Target -Address 'partition/vision/disk/vision-0123456789ab.vhdx' -Read { Get-DiskReading -Path 'D:\vms\vision-0123456789ab.vhdx' -Parent 'D:\images\robot.vhdx' -Everywhere }
    Add-Step -Action 'delete its disk D:\vms\vision-0123456789ab.vhdx' -Before @{ child = $true; exists = $true; used = $false } -After @{
        exists = $false
    } -Set { Remove-Item -LiteralPath 'D:\vms\vision-0123456789ab.vhdx' }

    # === task/Games: no component of this system uses it now ======================================
    Use-Target -Address 'task/Games' -Read { Get-TaskClassReading -Task 'Games' }
    Add-Step -Action 'set Priority 4 -> 2' -Same @{ 'value:affinity' = 'dword:0'; 'value:background only' = 'sz:False'; 'value:clock rate' = 'dword:10000'; 'value:gpu priority' = 'dword:8'; 'value:sfio priority' = 'sz:Normal'; 'value:scheduling category' = 'sz:Medium' } -Before @{
        'value:backgroundpriority' = 'dword:4'; 'value:priority' = 'dword:4'
        values = 'affinity, background only, backgroundpriority, clock rate, gpu priority, priority, scheduling category, sfio priority'
    } -After @{
        'value:priority' = 'dword:2'
        values = 'affinity, background only, clock rate, gpu priority, priority, scheduling category, sfio priority'
    } -Set {
        Write-TaskValue -Task 'Games' -Name 'Affinity' -Type 'DWord' -Value 0
        Write-TaskValue -Task 'Games' -Name 'Background Only' -Type 'String' -Value 'False'
        Write-TaskValue -Task 'Games' -Name 'Clock Rate' -Type 'DWord' -Value 10000
        Write-TaskValue -Task 'Games' -Name 'GPU Priority' -Type 'DWord' -Value 8
        Write-TaskValue -Task 'Games' -Name 'Priority' -Type 'DWord' -Value 2
        Write-TaskValue -Task 'Games' -Name 'SFIO Priority' -Type 'String' -Value 'Normal'
        Write-TaskValue -Task 'Games' -Name 'Scheduling Category' -Type 'String' -Value 'Medium'
        Remove-TaskValue -Task 'Games' -Name 'BackgroundPriority'
    }
    Add-Step -Action 'delete its record: rarms no longer manages it' -Same @{ robot = '' } -Before @{
        record = 'robot'; set = '87f85213b779'
    } -After @{
        empty = $false; record = ''; set = ''
    } -Set { Remove-TaskRecord -Task 'Games' -Application 'robot' }
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
