<#
.SYNOPSIS
    rarms apply script: plan 32cbf49236c7 of application robot, for the host itself.
.DESCRIPTION
    Host onboard of rarms.yaml, computer ONBOARD.
    0 machines added, 0 changed, 2 stopped, 2 removed; nothing deleted.
    Calls that change something: Remove-TaskRecord 1, Remove-TaskValue 1, Remove-VM 2, Stop-Partition 2, Write-TaskValue 7.
    speech: removed, stopped. It is off after 120 s at the latest, and stays off
    task/Games: changed (set Priority 4 -> 2; forget it: it is no longer ours)
    vision: removed, stopped. It is off after 120 s at the latest, and stays off
    Not undone: it starts anew: what its programs had in memory is lost
    Not undone: the machine is not made again; its disks are still there
.PARAMETER AsJson
    One JSON object a line on standard output, for a program to read.
.PARAMETER LockTimeout
    Seconds to wait for another run on this computer to end, 0 to 86400.
.PARAMETER Abandon
    Close this plan's unfinished run and change nothing else.
.PARAMETER Force
    Asks nothing before it stops, removes or deletes.
.EXAMPLE
    .\onboard.ps1 -WhatIf
    Show what it would do; nothing is changed. With -Confirm it asks before each step.
.EXAMPLE
    .\onboard.ps1
    Do it. Take it back with .\onboard.undo.ps1, which must lie beside it.
.NOTES
    Exit code 0: done, or all is as wanted already.
    Exit code 1: a call failed, a step was declined, or it was asked to stop. Run it again to go on.
    Exit code 3: the host is not as the plan saw it, another run holds it, or the plan was used.
    Manifest a2bf30ff37fc, rarms 0.1.0.
#>

#Requires -Version 5.1
#Requires -Modules Hyper-V
#Requires -RunAsAdministrator
[CmdletBinding(SupportsShouldProcess, PositionalBinding = $false, ConfirmImpact = 'High')]
[Diagnostics.CodeAnalysis.SuppressMessageAttribute('PSUseShouldProcessForStateChangingFunctions', '', Scope = 'Function',
    Target = '*', Justification = 'Every step is asked for, once, in Test-Wanted.')]
param([switch] $AsJson, [int] $LockTimeout = 0, [switch] $Abandon, [switch] $Force)

if ([string] $ExecutionContext.SessionState.LanguageMode -cne 'FullLanguage') {
    throw 'AppLocker or App Control takes the language from PowerShell here: allow this script by its signer'
}
if (-not $PSCommandPath -or $MyInvocation.InvocationName -ceq '.') { throw 'run this script as a file, not dot-sourced' }

# What a profile or a caller set must reach none of the calls below.
$PSDefaultParameterValues = @{}
$ErrorActionPreference = 'Stop'
$WarningPreference = 'SilentlyContinue'
$VerbosePreference = 'SilentlyContinue'
$DebugPreference = 'SilentlyContinue'
$InformationPreference = 'SilentlyContinue'
$ProgressPreference = 'SilentlyContinue'
$PSModuleAutoLoadingPreference = 'All'
Set-StrictMode -Version 3.0
if ($Force -and -not $PSBoundParameters.ContainsKey('Confirm')) { $ConfirmPreference = 'None' }

function Add-Plan {
    $script:Plan = @{
        Run = 'apply'; Plan = '32cbf49236c7'; Application = 'robot'; Serial = 1
        Robot = ''
        Undo = 'onboard.undo.ps1'; Guest = ''
        UndoDigest = 'c044a9c571b2b9a2a34a11e70ceae8e53c18bf5b8d6500e3899ebdd0a53cbc16'
        # The host, and what it has to give: per cent of its processors, bytes of its memory.
        Identity = 'd5f87e03212b1dc0a4dc0b9d10ddf87a'
        Computer = 'ONBOARD'; LogicalProcessors = 4
        Cores = 4; ThreadsPerCore = 1
        Percent = 360; Memory = 7516192768; AcceptScheduler = $false
        Guard = { Assert-VmHost }
    }

    # === speech: it is not wanted on this host (rarms.yaml:14:3) ==================================
    Use-Target -Address 'partition/speech' -Read { Get-DeviceReading -Machine '00000001-5ade-4000-8000-000000000001' }
    # Asks the guest to shut down, forces it after 60 s, and turns it off after 120 s: takes at least 0 s, at most 120 s.
    Add-Step -Action 'stop it (asked, after 60 s forced, after 120 s turned off)' -Before @{ state = 'running' } -After @{
        state = 'off'
    } -Set { Stop-Partition -GraceMs 120000 }
    Add-Step -Action 'remove the machine, keep its disks' -Before @{
        disks = 1; exists = $true; machine = '00000001-5ade-4000-8000-000000000001'; name = 'speech'; snapshots = 0; state = 'off'
    } -After @{
        exists = $false
    } -Set { Hyper-V\Remove-VM -VM $script:Vm -Force }

    # === vision: it is not wanted on this host (rarms.yaml:13:3) ==================================
    Use-Target -Address 'partition/vision' -Read { Get-DeviceReading -Machine '00000002-5ade-4000-8000-000000000002' }
    # Asks the guest to shut down, forces it after 60 s, and turns it off after 120 s: takes at least 0 s, at most 120 s.
    Add-Step -Action 'stop it (asked, after 60 s forced, after 120 s turned off)' -Before @{ state = 'running' } -After @{
        state = 'off'
    } -Set { Stop-Partition -GraceMs 120000 }
    Add-Step -Action 'remove the machine, keep its disks' -Before @{
        disks = 1; exists = $true; machine = '00000002-5ade-4000-8000-000000000002'; name = 'vision'; snapshots = 1; state = 'off'
    } -After @{
        exists = $false
    } -Set { Hyper-V\Remove-VM -VM $script:Vm -Force }

    # === task/Games: no component here names it any more ==========================================
    Use-Target -Address 'task/Games' -Read { Get-TaskClassReading -Task 'Games' }
    Add-Step -Action 'set Priority 4 -> 2' -Before @{
        'value:affinity' = 'dword:0'; 'value:background only' = 'sz:False'; 'value:backgroundpriority' = 'dword:4'
        'value:clock rate' = 'dword:10000'; 'value:gpu priority' = 'dword:8'; 'value:priority' = 'dword:4'
        'value:sfio priority' = 'sz:Normal'; 'value:scheduling category' = 'sz:Medium'
        values = 'affinity, background only, backgroundpriority, clock rate, gpu priority, priority, scheduling category, sfio priority'
    } -After @{
        'value:affinity' = 'dword:0'; 'value:background only' = 'sz:False'; 'value:clock rate' = 'dword:10000'
        'value:gpu priority' = 'dword:8'; 'value:priority' = 'dword:2'; 'value:sfio priority' = 'sz:Normal'
        'value:scheduling category' = 'sz:Medium'
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
    Add-Step -Action 'forget it: it is no longer ours' -Before @{ record = 'robot'; set = '87f85213b779' } -After @{
        empty = $false; record = ''; set = ''
    } -Set { Remove-TaskRecord -Task 'Games' -Application 'robot' }
}

# What follows has the same bytes in every script that carries it, but for the last line, which calls the plan.

# --- runtime: the same bytes in every script --------------------------------------------------
# Read from the top: what a run does, what a step does, how readings are compared, how it is told.
$script:Ordinal = [System.StringComparer]::Ordinal  # of tables: 5.1 compares the keys of others by culture
$script:Cmdlet = $PSCmdlet
$script:Plan = @{ Plan = '' }   # the run's facts, which Add-Plan gives
$script:Steps = @()             # those of the plan
$script:Target = $null          # address and reader of the steps that are added
$script:Whole = @{ Address = 'host'; Number = 0 }  # stands for a step where an event is about none
$script:Current = $script:Whole # the step that is read or done: what fails, fails there
$script:Wanted = @()            # the names that are read for
$script:Known = [hashtable]::new($script:Ordinal)  # by address: what was read of it, until a step changes something
$script:Looking = $false        # whether everything is looked at, and no step done
$script:Skipped = [hashtable]::new($script:Ordinal)  # addresses of steps that a declined -Confirm left out
$script:Shortage = ''           # what the host has, and what a promise needs, where the promise was refused
$script:Changed = 0             # steps that this run did
$script:Messages = @()          # what a step has to tell beside that it is done
$script:Refusal = ''            # kind of the event that ends the run with 3

function Invoke-Run {
    # Everything that a script does. Its exit code is 0, 1 or 3, and the host is given back however it ends.
    param([scriptblock] $Steps)
    try {
        & $Steps
        Open-Run
        Complete-Run
    } catch {
        # An event is given to the pipeline here, where it cannot end up in a caller's variable.
        $detail = [string] $_.Exception.Message
        if ($script:Refusal) {
            Write-RunEvent -Kind $script:Refusal -Step $script:Current -Status 'refused' -Detail $detail
            exit 3
        }
        $id = [string] $_.FullyQualifiedErrorId
        $at = $_.InvocationInfo
        if ($id -cne $detail) { $detail += ' ({0} {1}, line {2})' -f $at.MyCommand, $id, $at.ScriptLineNumber }
        Write-RunEvent -Kind 'failed' -Step $script:Current -Status 'failed' -Detail $detail
        exit 1
    } finally {
        Unlock-Host
    }
    exit 0
}

function Open-Run {
    # Lock, guard, journal. A run of this plan that was killed goes on; one that ended is only looked at.
    $plan = $script:Plan
    $guard = $plan.Guard
    if ($LockTimeout -lt 0 -or $LockTimeout -gt 86400) { throw '-LockTimeout takes 0 to 86400 seconds' }
    Lock-Host
    if (-not $Abandon) { & $guard }
    Import-Journal
    $last = $script:Started
    $open = $null -ne $last -and -not $script:Closing
    $same = $null -ne $last -and $last.plan -ceq $plan.Plan
    if ($Abandon) {
        if ($open -and -not $same) { Stop-Run -Detail ('plan {0} is unfinished here, not this one' -f $last.plan) }
        $status = if ($open) { 'abandoned' } else { 'unchanged' }
        if ($open -and -not (Test-Wanted -Address 'host' -Action 'close the unfinished run')) {
            $status = if ($WhatIfPreference) { 'previewed' } else { 'skipped' }
        } elseif ($open) {
            Add-Record -Record ([ordered] @{ closing = $status; kind = 'run_closed' })
        }
        Write-RunEvent -Kind 'run' -Status $status
        exit 0
    }
    if ($same -and $last.run -ceq $plan.Run -and $script:Closing -cne 'abandoned') { return }
    if ($plan.Run -ceq 'undo') {
        if (-not $same -or $last.run -cne 'apply') { Stop-Run -Detail 'the last run here was not what this undoes' }
    } elseif ($open) {
        Stop-Run -Detail ('plan {0} is unfinished here: run its script again, or its undo script' -f $last.plan)
    } elseif (-not $plan.Guest -and [long] $script:Serials[$plan.Application] -ne $plan.Serial) {
        Stop-Run -Detail 'this plan was used, or another was applied since it was made'
    }
    Clear-Journal
}

function Use-Target {
    # What the steps that follow are about, and how it is read.
    param([string] $Address, [scriptblock] $Read)
    $script:Target = @{ Address = $Address; Read = $Read }
}

function Add-Step {
    # A step of the plan: what is to be read before it and after it, and what makes it so.
    param(
        [string] $Action, [System.Collections.IDictionary] $Before, [System.Collections.IDictionary] $After,
        [scriptblock] $Set, [scriptblock] $Fits = $null, [string] $Undoes = '', [string] $Lost = ''
    )
    $address = $script:Target.Address
    $needs = @($address)
    $lies = $address -creplace '^([^/]+/[^/]+)/.*$', '$1'
    if ($lies -cne $address) { $needs = @($lies, $address) }
    $script:Steps += @{
        Number = $script:Steps.Count; Address = $address; Read = $script:Target.Read
        # It builds on the steps of its own address, and on those of the machine that it lies in.
        Needs = $needs
        Before = [hashtable]::new($Before, $script:Ordinal); After = [hashtable]::new($After, $script:Ordinal)
        Action = $Action; Set = $Set; Fits = $Fits; Undoes = $Undoes; Lost = $Lost
    }
}

function Complete-Run {
    # Look at everything, do the steps, look once more at everything together, and only then close the journal.
    Assert-Host
    if ($WhatIfPreference) {
        Show-Run
        return
    }
    if ($null -eq $script:Started) { Write-FirstRecord }
    foreach ($step in $script:Steps) { Invoke-Step -Step $step }
    if ($script:Skipped.Count) {
        Write-RunEvent -Kind 'run' -Status 'stopped' -Detail 'steps were left out; run it again to do them, or -Abandon'
        exit 1
    }
    if ($script:Closing -cne 'done') {
        Assert-Host -Last
        Add-Record -Record ([ordered] @{ closing = 'done'; kind = 'run_closed' })
    }
    Write-RunEvent -Kind 'run' -Status 'done' -Detail ('changed: {0}' -f $script:Changed)
}

function Assert-Host {
    # Reads everything. What was done is still so; what is to be done finds what was planned before it, unless a step
    # ahead of it is to make that so.
    param([switch] $Last)
    $made = [hashtable]::new($script:Ordinal)  # by address: what the steps that were done made of it
    $ahead = [hashtable]::new($script:Ordinal)  # addresses with names that a step is to change yet
    $script:Looking = $true
    $alive = [DateTime]::UtcNow.AddMilliseconds(10000)
    foreach ($step in $script:Steps) {
        $at = $step.Address
        $script:Current = $step
        if ([DateTime]::UtcNow -gt $alive) {
            Write-RunEvent -Kind 'step' -Step $step -Status 'reading' -Detail 'the host is still being read'
            $alive = [DateTime]::UtcNow.AddMilliseconds(10000)
        }
        $leave = Get-Leave -Step $step
        if ($leave -ceq 'done before') {
            $gone = -not $made.Contains($at) -or $step.After['exists'] -ceq $false
            $after = if ($gone) { [hashtable]::new($script:Ordinal) } else { $made[$at].After }
            foreach ($name in $step.After.Keys) { $after[$name] = $step.After[$name] }
            $made[$at] = @{ Address = $at; Number = $step.Number; Read = $step.Read; After = $after }
        }
        if ($leave) { continue }
        if (-not @(foreach ($one in $step.Needs) { if ($ahead.Contains($one + ' exists')) { $one } }).Count) {
            $live = Get-Reading -Step $step
            foreach ($name in @(Compare-Step -Step $step -Live $live)) {
                if ($ahead.Contains($at + ' ' + $name)) { continue }
                Stop-Run -Detail (Get-Difference -Name $name -Live $live -Expected $step.Before)
            }
        }
        foreach ($name in @(Compare-Reading -Live $step.Before -Expected $step.After)) {
            $ahead[$at + ' ' + $name] = $true
        }
    }
    $settled = [DateTime]::UtcNow.AddMilliseconds(300000)
    foreach ($at in @($made.Keys | Sort-Object)) {
        if ($ahead.Contains($at + ' exists')) { continue }
        $script:Current = $made[$at]
        $wanted = $made[$at].After
        # A guest puts an entry of its own ahead of its disk once it runs: that was compared when it was set.
        [void] $wanted.Remove('boots_from')
        $live = Get-Settled -Name $wanted.Keys -Until $settled
        foreach ($name in @(Compare-Reading -Live $live -Expected $wanted)) {
            # The keys above several records are cleared with the last of them.
            if ($ahead.Contains($at + ' ' + $name) -or ($name -ceq 'empty' -and $ahead.Count)) { continue }
            $detail = Get-Difference -Name $name -Live $live -Expected $wanted -Text 'is not as wanted: '
            if ($Last) { throw ('{0} {1}' -f $at, $detail) }
            Stop-Run -Detail $detail
        }
    }
    $script:Current = $script:Whole
    $script:Looking = $false
}

function Invoke-Step {
    # Read, compare, set, read again. As wanted: nothing. Neither as planned before nor as wanted: stop.
    param([System.Collections.IDictionary] $Step)
    $set = $Step.Set
    $fits = $Step.Fits
    $script:Current = $Step
    $leave = Get-Leave -Step $Step
    if ($leave) {
        Write-RunEvent -Kind 'step' -Step $Step -Status 'unchanged' -Detail $leave
        return
    }
    if (Test-Path -LiteralPath ($PSCommandPath + '.stop')) {
        # The maker of that file beside the script wants it to end before the next step.
        Write-RunEvent -Kind 'run' -Status 'stopped' -Detail 'asked to stop; run it again to go on'
        exit 1
    }
    # What was read with others, or of another, may be old by now.
    if ($script:Known.Count -gt 2 -or -not $script:Known.Contains($Step.Address)) { $script:Known.Clear() }
    $lacks = @(foreach ($one in $Step.Needs) { if ($script:Skipped.Contains($one)) { $one } })
    $live = Get-Reading -Step $Step
    # What builds on a declined step is left out and not recorded, as it would look as if it had nothing to do.
    if (-not $lacks.Count -and -not @(Compare-Reading -Live $live -Expected $Step.After).Count) {
        # One that was begun and killed has changed something.
        $status = if ($script:Recorded.Contains([string] $Step.Number)) { 'changed' } else { 'unchanged' }
        Add-StepRecord -Step $Step -Status $status
        return
    }
    $moved = @(Compare-Step -Step $Step -Live $live)
    $skip = ''
    if ($lacks.Count) {
        $skip = 'needs ' + ($lacks -join ', ')
    } elseif ($moved.Count) {
        Stop-Run -Detail (Get-Difference -Name $moved -Live $live -Expected $Step.Before)
    } elseif ($null -ne $fits -and -not (& $fits)) {
        if (-not $script:Skipped.Count) {
            throw ('{0}: the host cannot keep this promise: {1}' -f $Step.Address, $script:Shortage)
        }
        $skip = 'needs room that skipped steps would have made'
    } elseif (-not (Test-Wanted -Address $Step.Address -Action $Step.Action)) {
        $skip = 'left out'
    }
    if ($skip) {
        $script:Skipped[$Step.Address] = $true
        Write-RunEvent -Kind 'step' -Step $Step -Status 'skipped' -Detail $skip
        return
    }
    $ConfirmPreference = 'None'
    Add-StepRecord -Step $Step -Status 'begun' -Detail $Step.Action
    [void] (& $set)
    foreach ($message in $script:Messages) { Write-RunEvent -Kind 'step' -Step $Step -Status 'waited' -Detail $message }
    $script:Messages = @()
    $script:Known.Clear()
    $missed = @(Compare-Reading -Live (Get-Reading -Step $Step) -Expected $Step.After)
    if ($missed.Count) { throw ($Step.Address + ': set, but the host still shows otherwise: ' + ($missed -join ', ')) }
    Add-StepRecord -Step $Step -Status 'changed' -Detail $Step.Action
}

function Test-Wanted {
    # What -WhatIf or the user at the prompt says. -AsJson is for a program: no "What if" line between its events.
    param([string] $Address, [string] $Action)
    if ($AsJson -and $WhatIfPreference) { return $false }
    try {
        $script:Cmdlet.ShouldProcess($Address, $Action)
    } catch {
        throw 'this has to be confirmed, and no console answers here: run the script in a console, or with -Force'
    }
}

function Get-Leave {
    # Why there is nothing to do in a step; nothing where there is. The first two are for undo scripts.
    param([System.Collections.IDictionary] $Step)
    if ($Step.Undoes -cne '' -and -not $script:Touched.Contains($Step.Undoes)) { return 'was not done' }
    $lost = $script:Touched.Contains($Step.Lost)
    if ($lost -and -not (Get-Reading -Name 'exists')['exists']) { return 'went with its machine' }
    $recorded = $script:Recorded[[string] $Step.Number]
    if ($script:Closing -ceq 'done' -or @('changed', 'unchanged') -ccontains $recorded) { 'done before' }
}

function Add-StepRecord {
    param([System.Collections.IDictionary] $Step, [string] $Status, [string] $Detail = '')
    Add-Record -Record ([ordered] @{ number = $Step.Number; status = $Status; kind = 'step_recorded' })
    $script:Recorded[[string] $Step.Number] = $Status
    if ($Status -ceq 'changed') { $script:Changed += 1 }
    Write-RunEvent -Kind 'step' -Step $Step -Status $Status -Detail $Detail
}

function Get-Reading {
    # What the host shows of a step's names, or of others, at the address of the current step.
    param([System.Collections.IDictionary] $Step = $null, [string[]] $Name = @())
    $read = $script:Current.Read
    $script:Wanted = if ($null -eq $Step) { $Name } else { @($Step.Before.Keys) + @($Step.After.Keys) }
    & $read
}

function Get-Settled {
    # What the host shows of these names; a guest that restarts just now is waited for.
    param([string[]] $Name, $Until)
    $live = Get-Reading -Name $Name
    while ($live['state'] -ceq 'busy' -and [DateTime]::UtcNow -lt $Until) {
        Start-Sleep -Milliseconds 500
        $script:Known.Clear()
        $live = Get-Reading -Name $Name
    }
    $live
}

function Compare-Step {
    # The names in which the host is neither as wanted, nor as planned before, nor on the way from one to the other.
    param([System.Collections.IDictionary] $Step, [System.Collections.IDictionary] $Live)
    if (-not @(Compare-Reading -Live $Live -Expected $Step.After).Count) { return }
    # What was begun may have been killed half-way: then each value is still the old one, or already the new one.
    if ($script:Recorded.Contains([string] $Step.Number) -or $Step.Undoes -cne '') {
        $names = @($Step.Before.Keys)
        # What is not asked before a step may be anything, but not where nothing was.
        $all = $Step.Before['exists'] -ceq $false -or $names -ccontains 'values'
        if ($all) { $names += @($Step.After.Keys) + @(@($Live.Keys) -clike 'value:*') }
        # What the killed run did itself is no difference: only the odd ones are named.
        foreach ($name in $names) {
            # Names of values come and go one by one; a machine may be on its way to be off.
            $busy = @('values', 'empty') -ccontains $name -or ($name -ceq 'state' -and $Live[$name] -ceq 'busy')
            $old = Test-Agreed -Left $Live -Right $Step.Before -Name $name
            if (-not ($busy -or $old -or (Test-Agreed -Left $Live -Right $Step.After -Name $name))) { $name }
        }
        return
    }
    Compare-Reading -Live $Live -Expected $Step.Before
}

function Compare-Reading {
    # The names whose live value is not the expected one.
    param([System.Collections.IDictionary] $Live, [System.Collections.IDictionary] $Expected)
    # No cmdlet filters here: a profile's own of the same name would say that there is nothing to do.
    foreach ($name in @($Expected.Keys)) {
        if (-not (Test-Agreed -Left $Live -Right $Expected -Name $name)) { $name }
    }
}

function Get-Difference {
    # The names that differ, or that all of it is gone.
    param([string[]] $Name, $Live, $Expected, [string] $Text = 'changed since the plan: ')
    if ($Live['exists'] -ceq $false -and -not ($Expected['exists'] -ceq $false)) {
        return 'it is gone from this host: make a new plan'
    }
    $Text + ($Name -join ', ')
}

function Test-Agreed {
    # Whether two tables have the same value of a name, or both none; -ceq is blind to characters without width.
    param([System.Collections.IDictionary] $Left, [System.Collections.IDictionary] $Right, [string] $Name)
    if ($Left.Contains($Name) -ne $Right.Contains($Name)) { return $false }
    [string]::Equals([string] $Left[$Name], [string] $Right[$Name], [System.StringComparison]::Ordinal)
}

function Write-RunEvent {
    param([string] $Kind, [System.Collections.IDictionary] $Step = $script:Whole, [string] $Status, [string] $Detail)
    if ($AsJson) {
        ConvertTo-AsciiJson -Value ([ordered] @{
            format = 'rarms-event/1'; kind = $Kind; plan = $script:Plan.Plan; number = $Step.Number
            total = $script:Steps.Count; address = $Step.Address; status = $Status; detail = $Detail
        })
    } else {
        $text = '{0,-10} {1}  {2}' -f $Status, $Step.Address, $Detail
        Write-Information -MessageData $text -InformationAction Continue
    }
}

function Stop-Run {
    # The host is not as planned, busy, or the plan was used: exit code 3.
    param([string] $Kind = 'refused', [string] $Detail)
    $script:Refusal = $Kind
    throw $Detail
}

function ConvertTo-AsciiJson {
    # One line of JSON in pure ASCII; 5.1 and 7 leave different characters as they are.
    param($Value)
    $text = ConvertTo-Json -InputObject $Value -Depth 20 -Compress
    [regex]::Replace($text, '[^\x20-\x7e]', { '\u{0:x4}' -f [int] [char] $args[0].Value })
}
# --- end of the runtime ---------------------------------------------------------------------
# --- part lock: the same bytes in every script that carries it ---------------------------------
# One run at a time on this computer, in a folder that only Administrators and SYSTEM may write to.

# A service or a logon may come without the variable; Windows knows the folder all the same.
$common = if ($env:ProgramData) { $env:ProgramData } else { [Environment]::GetFolderPath('CommonApplicationData') }
$script:Folder = Join-Path -Path $common -ChildPath 'rarms'
$script:Operator = '{0}@{1}, process {2}' -f [Environment]::UserName, [Environment]::MachineName, $PID
$script:OwnerFile = Join-Path -Path $script:Folder -ChildPath 'owner.txt'
$script:Handle = $null       # of that file while this run holds the computer; it ends with its process

function Lock-Host {
    # A preview holds nothing. The folder comes first: no other account may open, and so hold, what lies in it.
    if ($WhatIfPreference) { return }
    $path = $script:OwnerFile
    # Only Administrators and SYSTEM may write what a later run trusts; a killed run may have left it open to all.
    if (Test-Path -LiteralPath $script:Folder) { Assert-Owner -Path $script:Folder }
    else { [void] [System.IO.Directory]::CreateDirectory($script:Folder) }
    if (Test-Path -LiteralPath $path) { Assert-Owner -Path $path }
    Protect-Path -Path $script:Folder -Descriptor 'O:BAG:SYD:P(A;OICI;FA;;;BA)(A;OICI;FA;;;SY)'
    $until = [DateTime]::UtcNow.AddMilliseconds(1000 * $LockTimeout)
    $mode = [System.IO.FileMode]::OpenOrCreate
    while ($null -eq $script:Handle) {
        try {
            $access = [System.IO.FileAccess]::Write
            $script:Handle = [System.IO.FileStream]::new($path, $mode, $access, [System.IO.FileShare]::Read)
        } catch [System.IO.IOException] {
            if (-not ([DateTime]::UtcNow -lt $until)) { Stop-Run -Kind 'lock' -Detail ('it is held by ' + (Get-Holder)) }
            Start-Sleep -Milliseconds 500
        }
    }
    [byte[]] $data = [System.Text.Encoding]::ASCII.GetBytes($script:Operator)
    $script:Handle.SetLength(0)
    $script:Handle.Write($data, 0, $data.Length)
    $script:Handle.Flush($true)
}

function Get-Holder {
    # Who holds this computer. It is open for writing, so it is opened shared for that.
    $text = ''
    try {
        $access = [System.IO.FileAccess]::Read
        $share = [System.IO.FileShare]::ReadWrite
        $stream = [System.IO.FileStream]::new($script:OwnerFile, [System.IO.FileMode]::Open, $access, $share)
        try {
            $data = [byte[]]::new(300)
            $text = [System.Text.Encoding]::ASCII.GetString($data, 0, $stream.Read($data, 0, 300))
        } finally {
            $stream.Dispose()
        }
    } catch {
        Write-Verbose -Message $_.Exception.Message
    }
    if ($text) { $text } else { 'an unknown user' }
}

function Unlock-Host {
    if ($null -eq $script:Handle) { return }
    $script:Handle.Dispose()
    # Another run may hold it by now.
    try { [System.IO.File]::Delete($script:OwnerFile) } catch { Write-Verbose -Message $_.Exception.Message }
}

function Protect-Path {
    # The owner is said, not left to the account: what a policy or an ssh logon makes of new files differs.
    param([string] $Path, [string] $Descriptor)
    if ($env:OS -cne 'Windows_NT') { return }
    # -Confirm asks for steps, not for what rarms keeps for itself.
    $ConfirmPreference = 'None'
    $acl = Get-Acl -LiteralPath $Path
    $acl.SetSecurityDescriptorSddlForm($Descriptor)
    Set-Acl -LiteralPath $Path -AclObject $acl
}

function Assert-Owner {
    # A planted journal or folder must not tell an administrator what to do, nor lead elsewhere.
    param([string] $Path)
    if ($env:OS -cne 'Windows_NT') { return }
    if ([System.IO.File]::GetAttributes($Path) -band [System.IO.FileAttributes]::ReparsePoint) {
        throw ('{0} is a link: look where it leads, then remove it' -f $Path)
    }
    $owner = (Get-Acl -LiteralPath $Path).GetOwner([System.Security.Principal.SecurityIdentifier]).Value
    if (@('S-1-5-32-544', 'S-1-5-18') -ccontains $owner) { return }
    throw ('{0} belongs to {1}, not to Administrators or SYSTEM: look at it, then remove it' -f $Path, $owner)
}
# --- end of the part lock ----------------------------------------------------------------------
# --- part journal: the same bytes in every script that carries it ------------------------------
# What a run did, kept on this computer: a line of JSON for each record, sealed by its length and a checksum.

$script:Journal = Join-Path -Path $script:Folder -ChildPath 'journal.jsonl'
$script:Signature = '(?<=\r\n)\s*# SIG # Begin signature block\r\n(?:# [^\r\n]*\r\n)*# SIG # End signature block\s*$'
$script:Sound = [long] 0        # bytes of the journal that are whole records
$script:Past = @()              # the runs before the one that the journal holds
$script:Started = $null         # its first record: which run was the last one here
$script:StartedAt = ''          # when that one began
$script:Closing = ''            # how it was closed: done or abandoned
$script:Recorded = [hashtable]::new($script:Ordinal)  # by number of a step: what it says of it
$script:Serials = [hashtable]::new($script:Ordinal)  # by application: how many runs there were
$script:Touched = [hashtable]::new($script:Ordinal)  # of an undo: the apply's steps that may have changed something

function Import-Journal {
    # What the last run here did, by the whole records. The first one is never torn: it gets its name when it is whole. A
    # later last one that a crash tore has no line end, or bytes that never came, and is dropped; all else is damage.
    $fresh = $script:Journal + '.new'
    # Left by a run that was killed before it began.
    if (-not $WhatIfPreference -and (Test-Path -LiteralPath $fresh)) { [System.IO.File]::Delete($fresh) }
    if (-not (Test-Path -LiteralPath $script:Journal)) { return }
    Assert-Owner -Path $script:Folder
    Assert-Owner -Path $script:Journal
    # Byte by byte: a text reader hides what an editor put before it.
    $whole = [System.Text.Encoding]::ASCII.GetString([System.IO.File]::ReadAllBytes($script:Journal))
    $damage = $script:Journal + ' is damaged: see what the last run did, then remove it'
    $torn = $false
    foreach ($line in @($whole -split '(?<=\n)')) {
        if ($torn -and $line) { throw $damage }
        if (-not $line) { continue }
        $text = $line -creplace ',"length":[0-9]+,"checksum":"[0-9a-f]{64}"\}\n$', '}'
        $torn = (Get-Sealed -Text $text) -cne $line
        $ended = $line.EndsWith([string] [char] 10) -and -not $line.Contains([string] [char] 0)
        if ($torn -and ($ended -or $null -eq $script:Started)) { throw $damage }
        if ($torn) { continue }
        $script:Sound += $line.Length
        $record = ConvertFrom-Json -InputObject $text
        if ($record.kind -ceq 'run_closed') { $script:Closing = $record.closing }
        elseif ($record.kind -ceq 'step_recorded') { $script:Recorded[[string] $record.number] = $record.status }
        else {
            $script:Started = $record
            $script:Past = @($record.history)
            $script:StartedAt = $record.started_at
            foreach ($number in @($record.touched)) { $script:Touched[[string] $number] = $true }
            foreach ($one in $record.serials.PSObject.Properties) { $script:Serials[$one.Name] = [long] $one.Value }
        }
    }
    if ($null -eq $script:Started) { throw $damage }
}

function Get-Sealed {
    param([string] $Text)
    $digest = Get-Sha256 -Data ([System.Text.Encoding]::ASCII.GetBytes($Text))
    '{0},"length":{1},"checksum":"{2}"}}{3}' -f ($Text -creplace '\}$', ''), $Text.Length, $digest, [char] 10
}

function Get-Sha256 {
    param([byte[]] $Data, [int] $Count = $Data.Length)
    $hash = [System.Security.Cryptography.SHA256]::Create()
    ([System.BitConverter]::ToString($hash.ComputeHash($Data, 0, $Count)) -replace '-', '').ToLowerInvariant()
}

function Add-Record {
    # It is on the disk when this returns. A torn end is cut off first.
    param([System.Collections.IDictionary] $Record, [string] $Path = $script:Journal)
    if ($WhatIfPreference) { return }
    [byte[]] $data = [System.Text.Encoding]::ASCII.GetBytes((Get-Sealed -Text (ConvertTo-AsciiJson -Value $Record)))
    $mode = [System.IO.FileMode]::OpenOrCreate
    $stream = [System.IO.FileStream]::new($Path, $mode, [System.IO.FileAccess]::Write)
    try {
        $stream.SetLength($script:Sound)
        $stream.Position = $script:Sound
        $stream.Write($data, 0, $data.Length)
        $stream.Flush($true)
    } finally {
        $stream.Dispose()
    }
    $script:Sound += $data.Length
}

function Clear-Journal {
    # The run that it holds becomes history, of which the last hundred are remembered; an undo takes back what it did.
    $last = $script:Started
    if ($null -eq $last) { return }
    $closing = if ($script:Closing) { $script:Closing } else { $null }
    $extra = $script:Past.Count - 99
    $script:Past = @(foreach ($one in $script:Past) { if ($extra -gt 0) { $extra -= 1 } else { $one } }) + [ordered] @{
        run = $last.run; plan = $last.plan; application = $last.application; started_by = $last.started_by
        started_at = $script:StartedAt; closing = $closing
    }
    $script:Touched.Clear()
    foreach ($number in @(if ($script:Plan.Run -ceq 'undo') { $script:Recorded.Keys })) {
        if ($script:Recorded[$number] -cne 'unchanged') { $script:Touched[$number] = $true }
    }
    $script:Started = $null
    $script:Closing = ''
    $script:Recorded.Clear()
}

function Write-FirstRecord {
    # Starts the run in one write: uses the plan, raises the serial, and holds the run whole.
    if ($WhatIfPreference) { return }
    $plan = $script:Plan
    $undo = ''
    if ($plan.Undo) {
        # It must lie beside this one, as it was made.
        $path = Join-Path -Path $PSScriptRoot -ChildPath $plan.Undo
        if (-not (Test-Path -LiteralPath $path)) { throw ('{0} must lie beside this script: put it there' -f $path) }
        $data = [System.IO.File]::ReadAllBytes($path)
        $undo = [System.Text.Encoding]::ASCII.GetString($data)
        # Who signs it adds remarks at its end; all before them is the plan's.
        $size = ($undo -creplace $script:Signature, '').Length
        if ((Get-Sha256 -Data $data -Count $size) -cne $plan.UndoDigest) {
            $line = '' + [char] 13 + [char] 10
            $text = ($undo -creplace '\r?\n', $line) -creplace $script:Signature, ''
            $same = (Get-Sha256 -Data ([System.Text.Encoding]::ASCII.GetBytes($text))) -ceq $plan.UndoDigest
            if ($same) { throw ('{0} has other line ends than it was made with: git needs "*.ps1 -text"' -f $path) }
            throw ('{0} was edited' -f $path)
        }
    }
    $script:Serials[$plan.Application] = [long] $script:Serials[$plan.Application] + 1
    $fresh = $script:Journal + '.new'
    $script:Sound = [long] 0
    Add-Record -Path $fresh -Record ([ordered] @{
        run = $plan.Run; plan = $plan.Plan; application = $plan.Application; started_by = $script:Operator
        robot = $plan.Robot; script = [System.IO.File]::ReadAllText($PSCommandPath); undo = $undo
        # As text without the T of ISO dates, which 7 would read back as a date; a cast knows no culture.
        started_at = [string] [DateTime]::UtcNow -creplace '^(..)/(..)/(....) (.*)$', '$3-$1-$2 $4 UTC'
        history = @($script:Past)
        serials = $script:Serials; touched = @($script:Touched.Keys | Sort-Object); kind = 'run_started'
    })
    Protect-Path -Path $fresh -Descriptor 'O:BAG:SYD:P(A;;FA;;;BA)(A;;FA;;;SY)'
    $old = $script:Journal + '.old'
    if (Test-Path -LiteralPath $script:Journal) { [System.IO.File]::Replace($fresh, $script:Journal, $old) }
    else { [System.IO.File]::Move($fresh, $script:Journal) }
}
# --- end of the part journal -------------------------------------------------------------------
# --- part preview: the same bytes in every script that carries it ------------------------------
# What -WhatIf shows.

function Show-Run {
    # A preview: first what is stopped, removed and deleted, then every step that is not done, with what it comes after.
    $shown = @()
    $made = [hashtable]::new($script:Ordinal)  # by address: the last action that is shown of it
    $losses = [hashtable]::new($script:Ordinal)
    foreach ($step in $script:Steps) {
        $script:Current = $step
        $fits = $step.Fits
        $after = ''
        foreach ($at in $step.Needs) { if ($made.Contains($at)) { $after = $made[$at] } }
        $leave = Get-Leave -Step $step
        if (-not $leave -and -not $after) {
            $moved = @(Compare-Reading -Live (Get-Reading -Step $step) -Expected $step.After).Count
            $leave = if ($moved) { '' } else { 'as wanted' }
        }
        if ($leave) {
            $shown += @{ Step = $step; Status = 'unchanged'; Detail = $leave }
            continue
        }
        # Room that earlier steps make is not there yet.
        if (-not $made.Count -and $null -ne $fits -and -not (& $fits)) {
            throw ('{0}: the host cannot keep this promise: {1}' -f $step.Address, $script:Shortage)
        }
        $detail = if ($after) { '{0} (after: {1})' -f $step.Action, $after } else { $step.Action }
        $shown += @{ Step = $step; Status = 'previewed'; Detail = $detail }
        $made[$step.Address] = $step.Action
        $loss = Get-Loss -Step $step
        if ($loss) { $losses[$loss] = [string] $losses[$loss] + ', ' + $step.Address }
    }
    $script:Current = $script:Whole
    $lines = @(foreach ($loss in @('stops', 'removes', 'deletes')) {
        if ($losses[$loss]) { $loss + $losses[$loss].Substring(1) }
    })
    $detail = if ($lines.Count) { $lines -join '; ' } else { 'nothing is stopped, removed or deleted' }
    Write-RunEvent -Kind 'run' -Status 'previewed' -Detail $detail
    foreach ($one in $shown) {
        if ($AsJson -or $one.Status -ceq 'unchanged') {
            Write-RunEvent -Kind 'step' -Step $one.Step -Status $one.Status -Detail $one.Detail
        } else {
            [void] (Test-Wanted -Address $one.Step.Address -Action $one.Detail)
        }
    }
    $count = @(foreach ($one in $shown) { if ($one.Status -ceq 'previewed') { $one } }).Count
    $detail = '{0} of {1} steps are to do; nothing was changed' -f $count, $shown.Count
    Write-RunEvent -Kind 'run' -Status 'previewed' -Detail $detail
}

function Get-Loss {
    # What a step takes: the machine from its users, a machine or class from the host, a file from its disk.
    param([System.Collections.IDictionary] $Step)
    if ($Step.Before['exists'] -ceq $true -and $Step.After['exists'] -ceq $false) {
        if ($Step.Address -cmatch '/disk(/|$)') { 'deletes' } else { 'removes' }
    } elseif ($Step.After['state'] -ceq 'off' -and @('', 'off') -cnotcontains [string] $Step.Before['state']) {
        'stops'
    }
}
# --- end of the part preview -------------------------------------------------------------------
# --- part host: the same bytes in every script that carries it ---------------------------------
# Whether a script runs where it was made for, and whether a reserve has any effect there.

function Assert-VmHost {
    # Is it this host, may we, and does a reserve have any effect here?
    $plan = $script:Plan
    if ([IntPtr]::Size -ne 8) { Stop-Run -Detail 'this PowerShell has 32 bits: start the one that has 64' }
    # Where 7 does not load Hyper-V itself, its objects come through 5.1 and are none that cmdlets take.
    if ([string] (Get-Command -Name 'Hyper-V\Get-VM').CommandType -cne 'Cmdlet') {
        Stop-Run -Detail 'this PowerShell does not load Hyper-V itself: start powershell.exe'
    }
    $vmHost = Hyper-V\Get-VMHost
    if ($vmHost.Name -ne $plan.Computer) {
        Stop-Run -Detail ('this is {0}, the plan is for {1}' -f $vmHost.Name, $plan.Computer)
    }
    if ($plan.Identity -and (Get-HostIdentity) -cne $plan.Identity) {
        Stop-Run -Detail ('this {0} is not the one that the plan was made for: make a plan for this one' -f $vmHost.Name)
    }
    # An undo gives back, and promises nothing.
    if ($plan.Run -ceq 'undo') { return }
    if ($vmHost.LogicalProcessorCount -ne $plan.LogicalProcessors) {
        Stop-Run -Detail ('it has {0} logical processors now' -f $vmHost.LogicalProcessorCount)
    }
    if ($plan.AcceptScheduler) { return }
    if (Test-RootScheduler) {
        throw 'the hypervisor runs its root scheduler, under which reserve, limit and weight have no effect'
    }
}

function Get-HostIdentity {
    # What tells this Windows from every other, as observe.ps1 works it out.
    $id = [string] (Get-Item -LiteralPath 'HKLM:\SOFTWARE\Microsoft\Cryptography').GetValue('MachineGuid')
    $data = [System.Text.Encoding]::ASCII.GetBytes('rarms host ' + $id.Trim().ToLowerInvariant())
    (Get-Sha256 -Data $data).Substring(0, 32)
}

function Test-RootScheduler {
    # Event 2 of the hypervisor says 4 for root. Where it has left the log: a client Windows has root, of a server it is
    # not known, which the plan told.
    try {
        $filter = @{ ProviderName = 'Microsoft-Windows-Hyper-V-Hypervisor'; ID = 2 }
        $found = @(Get-WinEvent -FilterHashtable $filter -MaxEvents 1)
        return [int] $found[0].Properties[0].Value -eq 4
    } catch {
        Write-Verbose -Message $_.Exception.Message
    }
    $windows = Get-Item -LiteralPath 'HKLM:\SOFTWARE\Microsoft\Windows NT\CurrentVersion'
    [string] $windows.GetValue('InstallationType') -ceq 'Client'
}
# --- end of the part host ----------------------------------------------------------------------
# --- part machines: the same bytes in every script that carries it -----------------------------
# How virtual machines are found, read and marked: never by their names.

$script:Vm = $null              # the one that was read last
$script:Shielded = [hashtable]::new($script:Ordinal)  # by id of a machine
$name = '[a-z0-9](?:[a-z0-9-]{0,61}[a-z0-9])?'
$form = '^rarms/1 (?<app>NAME)/(?<name>NAME(?:\.moving)?) vm=(?<vm>[0-9a-f]{8}) set=(?<set>[0-9a-f]{12}(?: stopped| measuring)?(?: robot=NAME)?(?: protected)?)\r*$'
$script:MarkForm = $form.Replace('NAME', $name)

function Get-PartitionReading {
    # What the host shows of the machine with this id.
    param([string] $Machine, [switch] $Clustered)
    Get-MachineReading -Machine $Machine -Clustered $Clustered
}

function Get-MachineReading {
    # As Get-PartitionReading, for its other callers.
    param([string] $Machine, [bool] $Clustered)
    $live = Get-Known
    if (-not $live.Count) {
        $found = @(Find-Machine -Machine $Machine)
        # Of what was done nothing is to be changed.
        if ($script:Current.Contains('Set')) { foreach ($vm in $found) { Assert-Untied -Vm $vm -Clustered $Clustered } }
        Add-MachineReading -Live $live -Found $found
    }
    Add-ProcessorReading -Live $live
    $script:Vm = $live['vm']
    $live
}

function Get-Known {
    # What was read already at the address of the current step: nothing is read twice until a step changes something.
    $at = $script:Current.Address
    if (-not $script:Known.Contains($at)) { $script:Known[$at] = [hashtable]::new($script:Ordinal) }
    $script:Known[$at]
}

function Find-Machine {
    # Where everything is looked at, all machines are listed once.
    param([string] $Machine)
    if (-not $script:Looking) {
        try { return Hyper-V\Get-VM -Id $Machine } catch { Write-Verbose -Message $_.Exception.Message }
    }
    foreach ($vm in @(Get-MachineList)) { if ([string] $vm.Id -eq $Machine) { $vm } }
}

function Get-MachineList {
    # All machines of the host, listed once for all that is read until something changes.
    if (-not $script:Known.Contains('machines')) { $script:Known['machines'] = @(Hyper-V\Get-VM) }
    $script:Known['machines']
}

function Add-MachineReading {
    # Into the reading: whether there is the machine, and what it says of itself.
    param([System.Collections.IDictionary] $Live, $Found)
    if ($Found.Count -gt 1) { Stop-Run -Detail ('{0} machines answer to it' -f $Found.Count) }
    $Live['exists'] = $Found.Count -eq 1
    $Live['vm'] = $null
    if (-not $Found.Count) { return }
    $vm = $Found[0]
    $mark = Get-Mark -Vm $vm
    $Live['vm'] = $vm
    $Live['machine'] = ([string] $vm.Id).ToLowerInvariant()
    $Live['name'] = [string] $vm.Name
    $Live['generation'] = [long] $vm.Generation
    $Live['processors'] = [long] $vm.ProcessorCount
    $Live['memory'] = [long] $vm.MemoryStartup
    $Live['dynamic_memory'] = [bool] $vm.DynamicMemoryEnabled
    $Live['start_action'] = ConvertTo-Word -Value $vm.AutomaticStartAction
    $Live['stop_action'] = ConvertTo-Word -Value $vm.AutomaticStopAction
    $Live['checkpoints'] = ConvertTo-Word -Value $vm.CheckpointType
    $Live['state'] = ConvertTo-RunState -State $vm.State
    $Live['running'] = $Live['state'] -ceq 'running'
    $Live['mark'] = if ($mark.Name) { '{0}/{1}' -f $mark.Application, $mark.Name } else { '' }
    $Live['set'] = $mark.Set
}

function Add-ProcessorReading {
    # Only where one of these is asked for: a machine that is stopped or removed needs none of them.
    param([System.Collections.IDictionary] $Live)
    if (-not $Live['exists'] -or -not (Test-Unread -Live $Live -Name 'reserve', 'limit', 'weight')) { return }
    $cpu = Hyper-V\Get-VMProcessor -VM $Live['vm']
    $Live['reserve'] = [long] $cpu.Reserve
    $Live['limit'] = [long] $cpu.Maximum
    $Live['weight'] = [long] $cpu.RelativeWeight
}

function Test-Unread {
    param([System.Collections.IDictionary] $Live, [string[]] $Name)
    foreach ($one in $Name) { if ($script:Wanted -ccontains $one -and -not $Live.Contains($one)) { return $true } }
    $false
}

function Get-Mark {
    # Our line in a machine's notes. One that names another machine's id was copied and is none; so are two of them.
    param($Vm)
    if (Test-Replica -Vm $Vm) { return @{ Application = ''; Name = ''; Set = '' } }
    $found = @(@([string] $Vm.Notes -split '\n') | Where-Object -FilterScript { $_ -cmatch $script:MarkForm })
    if ($found.Count -eq 1 -and $found[0] -cmatch $script:MarkForm -and $Matches['vm'] -ceq (Get-ShortId -Vm $Vm)) {
        return @{ Application = $Matches['app']; Name = $Matches['name']; Set = $Matches['set'] }
    }
    @{ Application = ''; Name = ''; Set = '' }
}

function Assert-Untied {
    # A replica, a shielded machine and one of a cluster are not the host's alone; a plan may accept the last.
    param($Vm, [bool] $Clustered)
    $tie = Get-Tie -Vm $Vm
    if ($tie -ceq 'of a failover cluster' -and $Clustered) { $tie = '' }
    if (-not $tie -and (Test-Shielded -Vm $Vm)) { $tie = 'shielded' }
    if ($tie) { Stop-Run -Detail ('machine {0} ({1}) is {2}, and not changed here' -f $Vm.Name, $Vm.Id, $tie) }
}

function Get-Tie {
    # What a machine says itself of who else decides over it; nothing of one that is the host's alone.
    param($Vm)
    if (Test-Replica -Vm $Vm) { return 'a replica of one on another host' }
    $clustered = $Vm.PSObject.Properties['IsClustered']
    if ($null -ne $clustered -and $clustered.Value) { return 'of a failover cluster' }
    ''
}

function Test-Replica {
    # A replica has the id and the notes of its primary, so that our mark on it says nothing.
    param($Vm)
    @('Replica', 'TestReplica', 'ExtendedReplica') -ccontains [string] $Vm.ReplicationMode
}

function Test-Shielded {
    # Asked once a run of each machine.
    param($Vm)
    $id = [string] $Vm.Id
    if (-not $script:Shielded.Contains($id)) { $script:Shielded[$id] = [bool] (Hyper-V\Get-VMSecurity -VM $Vm).Shielded }
    $script:Shielded[$id]
}

function Get-ShortId {
    param($Vm)
    ([string] $Vm.Id).ToLowerInvariant().Substring(0, 8)
}

function Write-Mark {
    # The mark that the step wants, or none, above the user's lines: the only text built around what a host says.
    $wanted = $script:Current.After
    $notes = [string] $script:Vm.Notes -creplace ('(?m)' + $script:MarkForm + '\n?'), ''
    $line = 'rarms/1 {0} vm={1} set={2}' -f $wanted['mark'], (Get-ShortId -Vm $script:Vm), $wanted['set']
    if ($wanted['mark']) { $notes = if ($notes) { $line + [char] 13 + [char] 10 + $notes } else { $line } }
    Hyper-V\Set-VM -VM $script:Vm -Notes $notes
}

function ConvertTo-RunState {
    param($State)
    $name = [string] $State
    if ($name -clike '*Critical') { return 'critical' }
    if (@('Off', 'Running', 'Paused', 'Saved') -ccontains $name) { return $name.ToLowerInvariant() }
    'busy'
}

function ConvertTo-Word {
    # An enumeration's name as plans write it: TurnOff becomes turn_off.
    param($Value)
    ([string] $Value -creplace '(?<=[a-z])(?=[A-Z])', '_').ToLowerInvariant()
}
# --- end of the part machines ------------------------------------------------------------------
# --- part devices: the same bytes in every script that carries it ------------------------------
# What a machine has beside processors and memory: one call for each kind that is wanted and was not read yet.

function Get-DeviceReading {
    param([string] $Machine, [switch] $Clustered)
    Add-DeviceReading -Live (Get-MachineReading -Machine $Machine -Clustered $Clustered)
}

function Add-DeviceReading {
    param([System.Collections.IDictionary] $Live)
    $vm = $Live['vm']
    if (-not $Live['exists']) { return $Live }
    if (Test-Unread -Live $Live -Name 'secure_boot', 'boots_from') {
        $firmware = Hyper-V\Get-VMFirmware -VM $vm
        $off = [string] $firmware.SecureBoot -ceq 'Off'
        $Live['secure_boot'] = if ($off) { 'off' } else { [string] $firmware.SecureBootTemplate }
        $Live['boots_from'] = ''
        foreach ($device in @($firmware.BootOrder)) {
            if (-not $Live['boots_from']) { $Live['boots_from'] = ConvertTo-Word -Value $device.BootType }
        }
    }
    if (Test-Unread -Live $Live -Name 'adapters') { $Live['adapters'] = @(Hyper-V\Get-VMNetworkAdapter -VM $vm).Count }
    if (Test-Unread -Live $Live -Name 'disks') { $Live['disks'] = @(Hyper-V\Get-VMHardDiskDrive -VM $vm).Count }
    if (Test-Unread -Live $Live -Name 'snapshots') { $Live['snapshots'] = @(Hyper-V\Get-VMSnapshot -VM $vm).Count }
    $Live
}
# --- end of the part devices -------------------------------------------------------------------
# --- part stop: the same bytes in every script that carries it ---------------------------------
# How a virtual machine is stopped.

function Stop-Partition {
    # Asks a guest to shut down as soon as it can be asked, forces it from half of the grace on, and turns the machine off
    # at its end. What refuses to be asked is told and waited out: a shutdown may be on its way already.
    param([long] $GraceMs)
    $vm = $script:Vm
    $begun = [DateTime]::UtcNow
    $until = $begun.AddMilliseconds($GraceMs)
    $force = $begun.AddMilliseconds($GraceMs / 2)
    # -Force gives programs five minutes and no more: a longer grace is not cut short by it.
    $last = $begun.AddMilliseconds($GraceMs - 300000)
    if ($last -gt $force) { $force = $last }
    $asked = ''
    $jobs = @()
    $now = $vm
    try {
        while ([DateTime]::UtcNow -lt $until -and @('running', 'busy') -ccontains (ConvertTo-RunState -State $now.State)) {
            $how = if ([DateTime]::UtcNow -lt $force) { 'asked' } else { 'forced' }
            if ($asked -cne $how -and [string] $now.State -ceq 'Running' -and (Test-ShutdownService -Vm $now)) {
                $asked = $how
                $jobs += @(if ($how -ceq 'forced') { Hyper-V\Stop-VM -VM $vm -Force -AsJob }
                    else { Hyper-V\Stop-VM -VM $vm -AsJob })
            }
            $jobs = @(foreach ($job in $jobs) {
                if ([string] $job.State -cne 'Failed') {
                    $job
                    continue
                }
                try { [void] (Receive-Job -Job $job) } catch {
                    $message = 'its guest could not be {0}, and is waited for: {1}' -f $asked, $_.Exception.Message
                    $script:Messages += $message
                }
                Remove-Job -Job $job -Force
            })
            Start-Sleep -Milliseconds 1000
            $now = Hyper-V\Get-VM -Id $vm.Id
        }
    } finally {
        foreach ($job in $jobs) { Remove-Job -Job $job -Force }
    }
    if ([string] $now.State -cne 'Off') { Hyper-V\Stop-VM -VM $vm -TurnOff -Force }
}

function Test-ShutdownService {
    # Whether the guest answers to what asks it to shut down; by id, as the service's name is in the host's language.
    param($Vm)
    foreach ($one in @(Hyper-V\Get-VMIntegrationService -VM $Vm)) {
        if (-not (([string] $one.Id).ToLowerInvariant() -clike '*9f8233ac-be49-4c79-8ee3-e7e1985b2077')) { continue }
        return $one.Enabled -and @('Ok', 'Degraded') -ccontains [string] $one.PrimaryOperationalStatus
    }
    $false
}
# --- end of the part stop ----------------------------------------------------------------------
# --- part tasks: the same bytes in every script that carries it --------------------------------
# How multimedia task classes are read and written, each value with its type, and what rarms keeps of them.

$script:ProfileRoot = 'HKLM:\SOFTWARE\Microsoft\Windows NT\CurrentVersion\Multimedia\SystemProfile'
$script:RecordRoot = 'HKLM:\SOFTWARE\rarms'

function Get-TaskClassReading {
    # Values with their types, and our record: whose it is and what was last written.
    param([string] $Task)
    $live = [hashtable]::new($script:Ordinal)
    $live['exists'] = $false
    foreach ($name in @('values', 'record', 'set')) { $live[$name] = '' }
    $live['empty'] = Test-EmptyKey -Task $Task
    [string[]] $names = @(foreach ($name in @(Get-TaskValueName -Task $Task)) { $name.ToLowerInvariant() })
    [Array]::Sort($names, [System.StringComparer]::Ordinal)
    foreach ($name in $names) {
        $key = Get-Item -LiteralPath (Get-TaskPath -Task $Task)
        $kind = ([string] $key.GetValueKind($name)).ToLowerInvariant()
        $data = $key.GetValue($name)
        if ($kind -ceq 'dword') { $data = [long] $data -band 4294967295 }
        $live['value:' + $name] = '{0}:{1}' -f ($kind -creplace '^string$', 'sz'), $data
        $live['exists'] = $true
        # Windows does not tell the case of a value's name apart.
        $live['values'] = $names -join ', '
    }
    if (-not (Test-Path -LiteralPath $script:RecordRoot)) { return $live }
    foreach ($application in @(Get-ChildItem -LiteralPath $script:RecordRoot)) {
        $path = Get-RecordPath -Task $Task -Application $application.PSChildName
        if (-not (Test-Path -LiteralPath $path)) { continue }
        $set = [string] (Get-Item -LiteralPath $path).GetValue('set')
        if ($set) {
            $live['record'] = [string] $application.PSChildName
            $live['set'] = $set
        }
    }
    $live
}

function Get-TaskValueName {
    # The names of a task class's values; of the key above the classes only the one that is meant.
    param([string] $Task)
    $path = Get-TaskPath -Task $Task
    if (-not (Test-Path -LiteralPath $path)) { return }
    foreach ($name in @((Get-Item -LiteralPath $path).GetValueNames())) {
        if ($path -cne $script:ProfileRoot -or $name -eq $Task) { $name }
    }
}

function Get-TaskPath {
    # SystemResponsiveness is one value of the key above the task classes; our record of it lies among theirs.
    param([string] $Task)
    if ($Task -ceq 'SystemResponsiveness') { return $script:ProfileRoot }
    '{0}\Tasks\{1}' -f $script:ProfileRoot, $Task
}

function Write-TaskValue {
    # A value that is there already is left: a step that was killed goes on where it stopped.
    param([string] $Task, [string] $Name, [string] $Type, $Value)
    $path = Get-TaskPath -Task $Task
    Add-Key -Path $path
    $wanted = '{0}:{1}' -f ($Type.ToLowerInvariant() -creplace '^string$', 'sz'), $Value
    $live = Get-TaskClassReading -Task $Task
    $there = [string] $live['value:' + $Name.ToLowerInvariant()]
    if ([string]::Equals($there, $wanted, [System.StringComparison]::Ordinal)) { return }
    [void] (New-ItemProperty -LiteralPath $path -Name $Name -PropertyType $Type -Value $Value -Force)
}

function Remove-TaskValue {
    # Takes one value away; with -Keep every value but these, whose names are joined as readings join them.
    param([string] $Task, [string] $Name = '', [string] $Keep = '')
    foreach ($one in @(Get-TaskValueName -Task $Task)) {
        $goes = if ($Keep) { @($Keep -split ', ') -notcontains $one } else { $one -eq $Name }
        if ($goes) { Remove-ItemProperty -LiteralPath (Get-TaskPath -Task $Task) -Name $one }
    }
}

function Remove-TaskClass {
    param([string] $Task)
    $path = Get-TaskPath -Task $Task
    if ($path -ceq $script:ProfileRoot) { throw 'the profile itself is no task class, and is never removed' }
    Remove-Key -Path $path
}

function Write-TaskRecord {
    # What was there before comes first, the digest last: without it the record does not count.
    param([string] $Task, [string] $Application, [string] $Digest, [string] $Before)
    $path = Get-RecordPath -Task $Task -Application $Application
    Add-Key -Path $script:RecordRoot
    Add-Key -Path ('{0}\{1}' -f $script:RecordRoot, $Application)
    Add-Key -Path $path
    foreach ($one in @(@('before', $Before), @('set', $Digest))) {
        # What is there already is left: a step that was killed goes on where it stopped.
        $there = [string] (Get-Item -LiteralPath $path).GetValue($one[0])
        if ([string]::Equals($there, $one[1], [System.StringComparison]::Ordinal)) { continue }
        [void] (New-ItemProperty -LiteralPath $path -Name $one[0] -PropertyType String -Value $one[1] -Force)
    }
}

function Remove-TaskRecord {
    # With the keys above it that hold nothing else.
    param([string] $Task, [string] $Application)
    Remove-Key -Path (Get-RecordPath -Task $Task -Application $Application)
    foreach ($path in @(('{0}\{1}' -f $script:RecordRoot, $Application), $script:RecordRoot)) {
        if (Test-BareKey -Path $path) { Remove-Key -Path $path }
    }
}

function Test-EmptyKey {
    # Whether a kill left keys that hold nothing: a class without values, a record without its digest, or ours above it.
    param([string] $Task)
    $application = '{0}\{1}' -f $script:RecordRoot, $script:Plan.Application
    $record = '{0}\{1}' -f $application, $Task
    foreach ($path in @((Get-TaskPath -Task $Task), $application, $script:RecordRoot)) {
        if (Test-BareKey -Path $path) { return $true }
    }
    (Test-Path -LiteralPath $record) -and -not (Get-Item -LiteralPath $record).GetValue('set')
}

function Test-BareKey {
    # Whether a key is there and holds neither values nor keys.
    param([string] $Path)
    if (-not (Test-Path -LiteralPath $Path)) { return $false }
    -not (@(Get-ChildItem -LiteralPath $Path).Count + @((Get-Item -LiteralPath $Path).GetValueNames()).Count)
}

function Get-RecordPath {
    # Ours, never below the multimedia keys.
    param([string] $Task, [string] $Application)
    '{0}\{1}\{2}' -f $script:RecordRoot, $Application, $Task
}

function Add-Key {
    # Never with -Force, which would empty a key that is there.
    param([string] $Path)
    if (-not (Test-Path -LiteralPath $Path)) { [void] (New-Item -Path $Path) }
}

function Remove-Key {
    param([string] $Path)
    if (Test-Path -LiteralPath $Path) { Remove-Item -LiteralPath $Path }
}
# --- end of the part tasks ---------------------------------------------------------------------
Invoke-Run -Steps { Add-Plan }
