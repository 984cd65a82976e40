<#
.SYNOPSIS
    rarms undo script: plan 7d9c284f7444 of application robot, for host onboard of rarms.yaml, computer ONBOARD.
.DESCRIPTION
    0 machines added, 2 changed, 0 stopped, 0 removed; 0 disks deleted; task classes: 1 changed, 0 removed.
    name        the running step
    speech      started, if the run ended before the machine was removed
    task/Games  record it as managed, with its earlier values; set Affinity 0, Background Only False, BackgroundPriority 4, Clock Rate 10000, GPU Priority 8, Priority 4, SFIO Priority Normal, Scheduling Category Medium
    vision      started, if the run ended before the machine was removed
    Time: a few seconds for each call. The script waits at most 300 s at the end, if a guest is just restarting.
    Only these calls change something, with their numbers: Start-VM 2, Write-TaskRecord 1, Write-TaskValue 8.
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
    .\onboard.undo.ps1 -WhatIf
    Shows the changes. Without -WhatIf, undoes the completed steps, the last one first.
.NOTES
    Exit code 0: done. 1: a step failed or was declined; run it again to continue. 3: the host is not as planned, or locked.
    Manifest a2bf30ff37fc, rarms 0.1.0. SHA-256: Rarms.psm1 047C93329B8C9BDFA3A302D8925E0BD435E0A17F6BA7301A7DBA0CC3C932073F.
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
        Run = 'undo'; Purpose = 'destroy'; Plan = '7d9c284f7444'; Application = 'robot'; Robot = ''; Serial = 1; Guest = ''
        Undo = ''; UndoDigest = ''
        Computer = 'ONBOARD'; Identity = 'd5f87e03212b1dc0a4dc0b9d10ddf87a'
    }
    # === task/Games: undoes the steps of the apply script, the last one first =====================
    Use-Target -Address 'task/Games' -Read { Get-TaskClassReading -Task 'Games' }
    Add-Step -Action 'record it as managed, with its earlier values' -Undoes 6 -Same @{ robot = '' } -Before @{
        record = ''; set = ''
    } -After @{
        record = 'robot'; set = '87f85213b779'
    } -Set {
        Write-TaskRecord -Task 'Games' -Application 'robot' -Robot '' -Digest '87f85213b779' -Before '{"Affinity":{"data":0,"kind":"dword"},"Background Only":{"data":"False","kind":"sz"},"Clock Rate":{"data":10000,"kind":"dword"},"GPU Priority":{"data":8,"kind":"dword"},"Priority":{"data":2,"kind":"dword"},"SFIO Priority":{"data":"Normal","kind":"sz"},"Scheduling Category":{"data":"Medium","kind":"sz"}}'
    }
    Add-Step -Action 'set Affinity 0, Background Only False, BackgroundPriority 4, Clock Rate 10000, GPU Priority 8, Priority 4, SFIO Priority Normal, Scheduling Category Medium' -Undoes 5 -Same @{ 'value:affinity' = 'dword:0'; 'value:background only' = 'sz:False'; 'value:clock rate' = 'dword:10000'; 'value:gpu priority' = 'dword:8'; 'value:sfio priority' = 'sz:Normal'; 'value:scheduling category' = 'sz:Medium' } -Before @{
        'value:priority' = 'dword:2'
        values = 'affinity, background only, clock rate, gpu priority, priority, scheduling category, sfio priority'
    } -After @{
        'value:backgroundpriority' = 'dword:4'; 'value:priority' = 'dword:4'
        values = 'affinity, background only, backgroundpriority, clock rate, gpu priority, priority, scheduling category, sfio priority'
    } -Set {
        Write-TaskValue -Task 'Games' -Name 'Affinity' -Type 'DWord' -Value 0
        Write-TaskValue -Task 'Games' -Name 'Background Only' -Type 'String' -Value 'False'
        Write-TaskValue -Task 'Games' -Name 'BackgroundPriority' -Type 'DWord' -Value 4
        Write-TaskValue -Task 'Games' -Name 'Clock Rate' -Type 'DWord' -Value 10000
        Write-TaskValue -Task 'Games' -Name 'GPU Priority' -Type 'DWord' -Value 8
        Write-TaskValue -Task 'Games' -Name 'Priority' -Type 'DWord' -Value 4
        Write-TaskValue -Task 'Games' -Name 'SFIO Priority' -Type 'String' -Value 'Normal'
        Write-TaskValue -Task 'Games' -Name 'Scheduling Category' -Type 'String' -Value 'Medium'
    }

    # === vision: undoes the steps of the apply script, the last one first (rarms.yaml:13:3) =======
    Use-Target -Address 'partition/vision' -Read { Get-PartitionReading -Machine '00000002-5ade-4000-8000-000000000002' }
    Add-Step -Action 'start it' -Undoes 2 -Lost 3 -Before @{ state = 'off' } -After @{ state = 'running' } -Set {
        Hyper-V\Start-VM -VM $script:Vm
    }

    # === speech: undoes the steps of the apply script, the last one first (rarms.yaml:14:3) =======
    Use-Target -Address 'partition/speech' -Read { Get-PartitionReading -Machine '00000001-5ade-4000-8000-000000000001' }
    Add-Step -Action 'start it' -Undoes 0 -Lost 1 -Before @{ state = 'off' } -After @{ state = 'running' } -Set {
        Hyper-V\Start-VM -VM $script:Vm
    }
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
