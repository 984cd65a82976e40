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
