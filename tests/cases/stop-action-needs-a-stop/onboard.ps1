<#
.SYNOPSIS
    rarms apply script: plan 7daf6b46adb4 of application robot, for the host itself.
.DESCRIPTION
    Host onboard of rarms.yaml, computer ONBOARD.
    0 machines added, 1 changed, 1 stopped, 0 removed; nothing deleted.
    Calls that change something: Set-VM 1, Set-VMProcessor 1, Start-VM 1, Stop-Partition 1, Write-Mark 1.
    vision: changed, stopped, started (reserve 80 -> 40 %, weight 100 -> 200; when the host starts: start; when the host stops: shut down). It is down for at least as long as it takes to start, and at most 120 s longer
    Not undone: it starts anew: what its programs had in memory is lost
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
    Manifest 32f04b96adf3, rarms 0.1.0.
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
        Run = 'apply'; Plan = '7daf6b46adb4'; Application = 'robot'; Serial = 1
        Robot = ''
        Undo = 'onboard.undo.ps1'; Guest = ''
        UndoDigest = '0167a2e156d7b5b15ed2bd966e6639e5202f5b6927dbf708666369bea7857ecc'
        # The host, and what it has to give: per cent of its processors, bytes of its memory.
        Identity = 'd5f87e03212b1dc0a4dc0b9d10ddf87a'
        Computer = 'ONBOARD'; LogicalProcessors = 4
        Cores = 4; ThreadsPerCore = 1
        Percent = 360; Memory = 7516192768; AcceptScheduler = $false
        Guard = { Assert-VmHost }
    }

    # === vision: the host differs from the manifest in reserve, limit or weight and start, stop or checkpoint action; it is stopped to change that (rarms.yaml:12:3)
    Use-Target -Address 'partition/vision' -Read { Get-PartitionReading -Machine '00000002-5ade-4000-8000-000000000002' }
    # Asks the guest to shut down, forces it after 60 s, and turns it off after 120 s: takes at least 0 s, at most 120 s.
    Add-Step -Action 'stop it (asked, after 60 s forced, after 120 s turned off)' -Before @{ state = 'running' } -After @{
        state = 'off'
    } -Set { Stop-Partition -GraceMs 120000 }
    Add-Step -Action 'reserve 80 -> 40 %, weight 100 -> 200; when the host starts: start; when the host stops: shut down; mark it as robot/vision, set d38b532de154' -Before @{
        limit = 100; mark = 'robot/vision'; reserve = 80; set = '28cc232b41a1'; start_action = 'start_if_running'; state = 'off'
        stop_action = 'save'; weight = 100
    } -After @{
        limit = 100; mark = 'robot/vision'; reserve = 40; set = 'd38b532de154'; start_action = 'start'; state = 'off'
        stop_action = 'shut_down'; weight = 200
    } -Set {
        Hyper-V\Set-VMProcessor -VM $script:Vm -Reserve 40 -Maximum 100 -RelativeWeight 200
        Hyper-V\Set-VM -VM $script:Vm -AutomaticStartAction 'Start' -AutomaticStopAction 'ShutDown'
        Write-Mark
    }
    Add-Step -Action 'start it' -Fits { Test-Capacity -Processors 2 -Reserve 40 -Memory 1073741824 } -Before @{ state = 'off' } -After @{
        state = 'running'
    } -Set { Hyper-V\Start-VM -VM $script:Vm }
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
# --- part capacity: the same bytes in every script that carries it -----------------------------
# Whether the host can keep what it promises, its unmanaged machines included.

function Test-Capacity {
    # Whether all promises fit with this machine's new one: in sum, in memory, and each processor onto a logical one.
    param([long] $Processors, [long] $Reserve, [long] $Memory)
    $others = @(foreach ($vm in @(Get-MachineList)) {
        if ([string] $vm.Id -ceq [string] $script:Vm.Id) { continue }
        $ours = (Get-Mark -Vm $vm).Application -ceq $script:Plan.Application
        $active = @('off', 'saved') -cnotcontains (ConvertTo-RunState -State $vm.State)
        # A replica starts at a failover only.
        $starts = -not (Test-Replica -Vm $vm) -and [string] $vm.AutomaticStartAction -cne 'Nothing'
        if ($active -or (-not $ours -and $starts)) { $vm }
    })
    $cpu = if ($script:Plan.ThreadsPerCore -eq 1) { $null } else { Hyper-V\Get-VMProcessor -VM $script:Vm }
    $claims = @(@{ Cores = Get-CoreCount -Cpu $cpu -Processors $Processors; Reserve = $Reserve })
    $needed = $claims[0].Cores * $script:Plan.ThreadsPerCore * $Reserve
    $taken = [long] 0
    $promised = @()
    $bytes = $Memory
    if ($others.Count) {
        foreach ($cpu in @(Hyper-V\Get-VMProcessor -VM $others)) {
            $cores = Get-CoreCount -Cpu $cpu -Processors $cpu.Count
            $claims += @{ Cores = $cores; Reserve = [long] $cpu.Reserve }
            $share = $cores * $script:Plan.ThreadsPerCore * [long] $cpu.Reserve
            $taken += $share
            if ($share) { $promised += '{0} {1}' -f $cpu.VMName, (ConvertTo-Processor -Percent $share) }
        }
        foreach ($vm in $others) { $bytes += [long] $vm.MemoryStartup }
    }
    $room = [long] (($script:Plan.Memory - $bytes + $Memory) / 1048576)
    $free = ConvertTo-Processor -Percent ($script:Plan.Percent - $taken)
    $needed = ConvertTo-Processor -Percent $needed
    $script:Shortage = 'needs {0} and {1} MiB, free {2} and {3} MiB' -f $needed, [long] ($Memory / 1048576), $free, $room
    if ($promised.Count) { $script:Shortage += ', promised: ' + ($promised -join ', ') }
    $percent = [long] 0
    $free = @(100) * $script:Plan.Cores
    foreach ($one in $claims) {
        $percent += $one.Cores * $script:Plan.ThreadsPerCore * $one.Reserve
        if ($one.Reserve -gt 0 -and $one.Cores -gt $free.Count) { return $false }
    }
    if ($percent -gt $script:Plan.Percent -or $bytes -gt $script:Plan.Memory) { return $false }
    # Machines as wide as the host lie on every core; of the others the largest go first, each to the first place.
    $wide = 0
    $sizes = @()
    foreach ($one in $claims) {
        if ($one.Cores -eq $free.Count) { $wide += $one.Reserve }
        else { $sizes += @($one.Reserve) * $one.Cores }
    }
    for ($at = 0; $at -lt $free.Count; $at++) { $free[$at] -= $wide }
    foreach ($size in @($sizes | Sort-Object -Descending)) {
        $at = 0
        while ($at -lt $free.Count -and $free[$at] -lt $size) { $at++ }
        if ($at -eq $free.Count) { return $false }
        $free[$at] -= $size
    }
    $wide -le 100
}

function ConvertTo-Processor {
    # Per cent of logical processors as plans write them, without a culture's comma: 160 is 1.60 LP.
    param([long] $Percent)
    if ($Percent -lt 0) { return '0.00 LP' }
    ('00' + $Percent) -creplace '^0*([0-9]+)([0-9]{2})$', '$1.$2 LP'
}

function Get-CoreCount {
    # The cores that a machine takes where none runs two machines at once; elsewhere each processor counts as a core.
    param($Cpu, [long] $Processors)
    if ($script:Plan.ThreadsPerCore -eq 1) { return $Processors }
    $own = $Cpu.PSObject.Properties['HwThreadCountPerCore']
    # Without SMT of its own, it leaves the other thread of each core idle.
    if ($null -eq $own -or $own.Value -eq 1) { return $Processors }
    ($Processors + ($Processors -band 1)) / 2
}
# --- end of the part capacity ------------------------------------------------------------------
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
Invoke-Run -Steps { Add-Plan }
