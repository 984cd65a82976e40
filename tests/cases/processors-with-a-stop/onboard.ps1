<#
.SYNOPSIS
    rarms apply script: plan 3e46c541702b of application robot, for host onboard of rarms.yaml, computer ONBOARD.
.DESCRIPTION
    0 machines added, 1 changed, 1 stopped, 0 removed; 0 disks deleted.
    name    the running step                                                                                                    off
    speech  stopped; reserve 0.4 -> 0.4 LP (40 % of its processor -> 20 % of each of 2 processors); processors 1 -> 2; started  until it has started, at most 120 s to stop
    Time: a few seconds for each call. The script waits at most 120 s while guests stop, one after another; at most 300 s at the end, if a guest is just restarting.
    Only these calls change something, with their numbers: Set-VMProcessor 1, Start-VM 1, Stop-Partition 1, Write-Mark 1.
    Not undone: speech: undo starts it again, without its data in memory
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
    Manifest b1f15d8b63ee, rarms 0.1.0. SHA-256: the undo 1e1560cbeb51c55fffcbff84e96c10d632ebfdcfa57b0f5ed95ef6b9fd96b107, Rarms.psm1 047C93329B8C9BDFA3A302D8925E0BD435E0A17F6BA7301A7DBA0CC3C932073F.
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
        Run = 'apply'; Purpose = 'apply'; Plan = '3e46c541702b'; Application = 'robot'; Robot = ''; Serial = 1; Guest = ''
        Undo = 'onboard.undo.ps1'; UndoDigest = '1e1560cbeb51c55fffcbff84e96c10d632ebfdcfa57b0f5ed95ef6b9fd96b107'
        Computer = 'ONBOARD'; Identity = 'd5f87e03212b1dc0a4dc0b9d10ddf87a'
        LogicalProcessors = 4; Cores = 4; ThreadsPerCore = 1; Percent = 360; Memory = 7516192768; AcceptScheduler = $false
    }
    # === speech: the host differs from the manifest in processors; it is stopped to change that (rarms.yaml:13:3)
    Use-Target -Address 'partition/speech' -Read { Get-PartitionReading -Machine '00000001-5ade-4000-8000-000000000001' }
    Add-Step -Action 'stop it (shut down, after 60 s forced, turned off after 120 s)' -Before @{ state = 'running' } -After @{
        state = 'off'
    } -Set { Stop-Partition -GraceMs 120000 }
    Add-Step -Action 'reserve 0.4 -> 0.4 LP (40 % of its processor -> 20 % of each of 2 processors); processors 1 -> 2' -Same @{ limit = 100; mark = 'robot/speech'; state = 'off'; weight = 100 } -Before @{
        processors = 1; reserve = 40; set = '63f8fd0cdc73'
    } -After @{
        processors = 2; reserve = 20; set = '7c08b2c3712c'
    } -Set {
        if (Test-Open -Name 'reserve', 'processors') { Hyper-V\Set-VMProcessor -VM $script:Vm -Reserve 20 -Maximum 100 -RelativeWeight 100 -Count 2 }
        if (Test-Open -Name 'set') { Write-Mark }
    }
    # === speech: start it (rarms.yaml:13:3) =======================================================
    Use-Target -Address 'partition/speech' -Read { Get-PartitionReading -Machine '00000001-5ade-4000-8000-000000000001' }
    Add-Step -Action 'start it' -Fits { Test-Capacity -Processors 2 -Reserve 20 -Memory 536870912 } -Before @{ state = 'off' } -After @{
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
