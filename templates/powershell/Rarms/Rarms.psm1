# The module Rarms: functions that all scripts of rarms call. Importing it runs nothing.
# Order: runs, steps, comparison of readings, events, then one section for each kind of resource.

[Diagnostics.CodeAnalysis.SuppressMessageAttribute('PSUseShouldProcessForStateChangingFunctions', '', Scope = 'Function',
    Target = '*', Justification = 'Test-Wanted asks once before each step.')]
param()

# Ignore preferences set by a profile or the caller.
Set-StrictMode -Version 3.0
$PSDefaultParameterValues = @{}
$ErrorActionPreference = 'Stop'
$WarningPreference = 'SilentlyContinue'
$VerbosePreference = 'SilentlyContinue'
$DebugPreference = 'SilentlyContinue'
$InformationPreference = 'SilentlyContinue'
$ProgressPreference = 'SilentlyContinue'
$PSModuleAutoLoadingPreference = 'All'
# Test-Wanted asks for confirmation. The cmdlets that a step calls do not ask again.
$ConfirmPreference = 'None'

$script:Whole = @{ Address = 'host'; Number = 0 }  # used in events that are not about a step
$script:Signature = '(?<=\r\n)\s*# SIG # Begin signature block\r\n(?:# [^\r\n]*\r\n)*# SIG # End signature block\s*$'
# SHA-256 of observe.ps1 in this folder, to the byte before a signature.
$script:Observe = '461cdc62967a0377d1e48cb60d3007bd65b1a71e873dadc17275cf9bef36b0b3'
$script:ProfileRoot = 'HKLM:\SOFTWARE\Microsoft\Windows NT\CurrentVersion\Multimedia\SystemProfile'
$script:RecordRoot = 'HKLM:\SOFTWARE\rarms'

function Invoke-RarmsPlan {
    <#
    .SYNOPSIS
        Runs the steps of a plan and writes their events to the pipeline.
    .PARAMETER Path
        The script of a plan. The script runs unchanged.
    .PARAMETER Run
        Values from the script: its $PSCmdlet, paths, preferences and plan, and a reference for its exit code.
    #>
    [CmdletBinding(PositionalBinding = $false)]
    param([string] $Path = '', [switch] $AsJson, [System.Collections.IDictionary] $Run = $null)
    if ($null -eq $Run) { return Invoke-Script -Path $Path -AsJson $AsJson }
    # Remove aliases of the caller first: an alias has priority over this module's functions.
    $own = @(Microsoft.PowerShell.Core\Get-Command -CommandType Function -Module $MyInvocation.MyCommand.Module.Name)
    $aliases = @(Microsoft.PowerShell.Utility\Get-Alias -Name @($own.Name) -ErrorAction Ignore)
    if ($aliases.Count) { throw ('an alias hides a function of rarms; remove it: ' + ($aliases.Name -join ', ')) }
    try {
        Initialize-Run -Run $Run
        if ($Run.AsJson -and $Run.Caller.MyInvocation.BoundParameters['Verbose']) { throw '-AsJson excludes -Verbose' }
        # Bind the blocks to this module, so that they see its variables and functions.
        $bound = $MyInvocation.MyCommand.Module.NewBoundScriptBlock($Run.Plan)
        & $bound
        if ($Run.Abandon) {
            Close-Run
        } else {
            Open-Run
            Assert-Host
            if ($Run.Test) { Show-State } elseif ($script:Preview) { Show-Run } else { Complete-Run }
        }
        $script:Code = 0
    } catch {
        # Write events to the pipeline here, so that no caller's variable receives them.
        Write-Failure -Failure $_
    } finally {
        # After Ctrl-C, the run stays unfinished.
        try { if ($script:Outcome.Status -cne 'begun') { Write-Verdict } } catch {
            Write-RunEvent -Kind 'run' -Status 'noted' -Detail ('the verdict is not written: ' + $_.Exception.Message)
        }
        Unlock-Host
        $Run.ExitCode.Value = $script:Code
    }
}

function Test-RarmsPlan {
    <#
    .SYNOPSIS
        Returns an object for each step of a plan: Address, Action, InDesiredState, Disruption. Changes nothing.
    .PARAMETER AsJson
        With -Path: returns one JSON object for all steps, as a DSC resource does.
    #>
    [CmdletBinding(PositionalBinding = $false)]
    param([string] $Path = '', [switch] $AsJson, [System.Collections.IDictionary] $Run = $null)
    if ($null -eq $Run) { return Invoke-Script -Path $Path -Test $true -AsJson $AsJson }
    $Run['Test'] = $true
    Invoke-RarmsPlan -Run $Run
}

function Get-RarmsObservation {
    <#
    .SYNOPSIS
        Returns the state of this computer as one line of JSON, a snapshot for rarms. Changes nothing.
    .EXAMPLE
        Get-RarmsObservation | Set-Content -Path .\cell.json -Encoding Ascii
    #>
    [CmdletBinding(PositionalBinding = $false)]
    param()
    $look = [System.IO.Path]::Combine($PSScriptRoot, 'observe.ps1')
    [void] (Read-MadeFile -Path $look -Digest $script:Observe)
    & $look
}

function Get-RarmsRun {
    <#
    .SYNOPSIS
        Returns the recorded runs of this computer, the last run at the end. A run without a closing is unfinished.
    #>
    [CmdletBinding(PositionalBinding = $false)]
    param()
    Initialize-Run
    $script:Preview = $true
    Import-Journal
    Clear-Journal
    foreach ($one in $script:Past) { [pscustomobject] $one }
}

function Undo-RarmsRun {
    <#
    .SYNOPSIS
        Undoes the last run of a plan on this computer, with the undo script from its journal.
    #>
    [Diagnostics.CodeAnalysis.SuppressMessageAttribute('PSShouldProcess', '', Justification = 'The undo script asks.')]
    [CmdletBinding(SupportsShouldProcess, PositionalBinding = $false)]
    param([switch] $AsJson, [switch] $Force)
    $WhatIfPreference = $false
    $preview = [bool] $PSBoundParameters['WhatIf']
    Initialize-Run -Run @{ Preview = $preview; Test = $false; AsJson = $false; LockTimeout = 0 }
    Lock-Host
    try { Import-Journal } finally { Unlock-Host }
    $last = $script:Started
    # Continue an interrupted undo.
    $text = if ($last) { if ($last.run -ceq 'undo' -and -not $script:Closing) { $last.script } else { $last.undo } }
    if (-not $text) { throw 'there is nothing to undo: the last run here was not of a plan, or was a complete undo' }
    # Use a folder that only administrators may write to. Remove it also after a preview. A single file has no module.
    $dir = Join-Path -Path $script:Folder -ChildPath ('undo-' + $PID)
    Add-Folder -Path $dir
    try {
        Write-SharedFile -Path ($dir + '\undo.ps1') -Text $text
        foreach ($file in @(if ($last.PSObject.Properties['module']) { $last.module.PSObject.Properties })) {
            Add-Folder -Path ($dir + '\Rarms')
            Write-SharedFile -Path ($dir + '\Rarms\' + $file.Name) -Text $file.Value
        }
        Invoke-Script -Path ($dir + '\undo.ps1') -AsJson $AsJson -Force $Force -Preview $preview
    } finally { Use-SharedFile -Writing -Path $dir -Do { [System.IO.Directory]::Delete($dir, $true) } }
}

function Stop-RarmsRun {
    <#
    .SYNOPSIS
        Stops the run of this script before its next step. Run the script again to continue.
    #>
    [CmdletBinding(SupportsShouldProcess, PositionalBinding = $false)]
    param([Parameter(Mandatory)] [string] $Path)
    $whole = Resolve-Script -Path $Path
    if ($PSCmdlet.ShouldProcess($whole, 'ask it to stop')) { Write-SharedFile -Path ($whole + '.stop') -Text 's' }
}

function Close-RarmsRun {
    <#
    .SYNOPSIS
        Closes the unfinished run on this computer, of any plan. Changes nothing else.
    #>
    [CmdletBinding(SupportsShouldProcess, PositionalBinding = $false, ConfirmImpact = 'High')]
    param([switch] $Force)
    Initialize-Run -Run @{
        Caller = $PSCmdlet; Confirmation = if ($Force) { 'None' } else { 'High' }
        Preview = [bool] $PSBoundParameters['WhatIf']; Test = $false; AsJson = $false; LockTimeout = 0; ScriptPath = ''
    }
    try {
        Close-Run
        $script:Code = 0
        Write-Verdict
    } finally { Unlock-Host }
}

function Invoke-Script {
    # Restore PowerShell's preferences for the script: with those of this module it would not ask.
    param([string] $Path, [bool] $AsJson, [bool] $Force, [bool] $Test, [bool] $Preview)
    $Path = Resolve-Script -Path $Path
    $ConfirmPreference = 'High'
    $WhatIfPreference = $false
    & $Path -AsJson:$AsJson -Force:$Force -Test:$Test -WhatIf:$Preview
}

function Resolve-Script {
    # Use the full path: .NET does not use the location of PowerShell.
    [CmdletBinding(PositionalBinding = $false)]
    param([string] $Path)
    if (-not $Path) { throw '-Path is missing: give the script of a plan' }
    $whole = $PSCmdlet.GetUnresolvedProviderPathFromPSPath($Path)
    if ([System.IO.File]::Exists($whole)) { return $whole }
    throw ('the script {0} does not exist: give the script of a plan' -f $whole)
}

function Initialize-Run {
    param([System.Collections.IDictionary] $Run = @{ Preview = $false; Test = $false; AsJson = $false; LockTimeout = 0 })
    $script:Code = 1                # the exit code: 0, 1 or 3
    $script:Current = $script:Whole # the current step, for errors
    $script:Outcome = @{ Status = 'begun'; Detail = '' } # from the last event about the whole run
    $script:Ending = $null          # the last event, if the run itself ends
    $script:Plan = @{ Plan = ''; Run = '' }  # facts of the run, from the plan
    $script:Steps = @()             # from the plan
    $script:Handle = $null          # of the owner's file while this run holds the lock; it closes with the process
    $script:Run = $Run              # values from the script
    $script:Result = if ($Run['ScriptPath']) { $Run.ScriptPath + '.result.json' } else { '' }
    $script:Preview = $Run.Preview -or $Run.Test  # in a preview, a call by mistake changes nothing
    $script:WhatIfPreference = $script:Preview
    $script:Known = Get-OrdinalTable  # by address: the reading, until a step changes something
    $script:Listing = $false        # whether to search all machines instead of asking for one id
    $script:Skipped = Get-OrdinalTable  # by address: the declined step
    $script:Nodes = @()             # NUMA nodes, if a machine must fit on one
    $script:Changed = 0             # steps that this run did
    $script:Messages = @()          # messages of a step
    # The variable may be missing in a service or a logon. GetFolderPath returns the folder without it.
    $common = if ($env:ProgramData) { $env:ProgramData } else { [Environment]::GetFolderPath('CommonApplicationData') }
    $script:Folder = Join-Path -Path $common -ChildPath 'rarms'
    $script:Operator = '{0}@{1}, process {2}' -f [Environment]::UserName, [Environment]::MachineName, $PID
    $script:OwnerFile = Join-Path -Path $script:Folder -ChildPath 'owner.txt'
    $script:Journal = Join-Path -Path $script:Folder -ChildPath 'journal.jsonl'
    $script:Sound = [long] 0        # bytes of complete records in the journal
    $script:Past = @()              # earlier runs
    $script:Started = $null         # its first record: the last run on this computer
    $script:Closing = ''            # done or abandoned
    $script:Recorded = Get-OrdinalTable  # by number of a step: its record
    $script:Serials = Get-OrdinalTable  # by application: the number of runs
    $script:Called = Get-OrdinalTable  # by number of a step: called in this run
    $script:Touched = Get-OrdinalTable  # in an undo: steps of the apply that may have changed something
    $script:Shielded = Get-OrdinalTable  # by id of a machine
    $name = '[a-z0-9](?:[a-z0-9-]{0,61}[a-z0-9])?'
    $set = '[0-9a-f]{12}(?: stopped| measuring)?(?: robot=NAME)?(?: protected)?'
    $form = '^rarms/1 (?<app>NAME)/(?<name>NAME(?:\.moving)?) vm=(?<vm>[0-9a-f]{8}) set=(?<set>SET)\r*$'
    $script:MarkForm = $form.Replace('SET', $set).Replace('NAME', $name)
    $script:Machines = Get-OrdinalTable  # by partition: the id of the machine that this plan creates
}

function Write-Failure {
    param($Failure)
    $detail = [string] $Failure.Exception.Message
    $id = [string] $Failure.FullyQualifiedErrorId
    $at = $Failure.InvocationInfo  # messages of a guest may have none
    $ending = $script:Ending
    if ($null -eq $ending) {
        $ending = @{ Kind = 'failed'; Status = 'failed'; Code = 1 }
        if ($id -cne $detail -and $at) { $detail += ' ({0} {1}, line {2})' -f $at.MyCommand, $id, $at.ScriptLineNumber }
    }
    $script:Code = $ending.Code
    Write-RunEvent -Kind $ending.Kind -Step $script:Current -Status $ending.Status -Detail $detail
}

function Open-Run {
    $plan = $script:Plan
    Lock-Host
    Write-Verdict
    if ([IntPtr]::Size -ne 8) { Exit-Run -Detail 'this PowerShell has 32 bits: start the PowerShell with 64 bits' }
    if ($plan.Guest) { Assert-Guest } else { Assert-VmHost }
    Import-Journal
    $last = $script:Started
    $same = $null -ne $last -and $last.plan -ceq $plan.Plan
    if ($same -and $last.run -ceq $plan.Run -and $script:Closing -cne 'abandoned') { return }
    if ($plan.Run -ceq 'undo') {
        if (-not $same -or $last.run -cne 'apply') { Exit-Run -Detail 'the last run here was another: undo that run first' }
    } elseif ($null -ne $last -and -not $script:Closing) {
        Exit-Run -Detail ('plan {0} is unfinished here: run its script again, or its undo script' -f $last.plan)
    } elseif (-not $plan.Guest -and [long] $script:Serials[$plan.Application] -ne $plan.Serial) {
        Exit-Run -Detail 'this plan was already used, or another plan was applied later: make a new plan'
    }
    Clear-Journal
}

function Close-Run {
    # Close the unfinished run, of this plan if there is one. The host is not changed.
    Lock-Host
    Write-Verdict
    Import-Journal
    $last = $script:Started
    if ($null -eq $last -or $script:Closing) { return Write-RunEvent -Kind 'run' -Status 'unchanged' }
    $other = 'the unfinished plan here is {0}: run the script of that plan with -Abandon'
    if ($script:Plan.Plan -and $last.plan -cne $script:Plan.Plan) { Exit-Run -Detail ($other -f $last.plan) }
    $script:Plan = @{ Plan = $last.plan; Run = $last.run }
    $wanted = Test-Wanted -Address 'host' -Action 'close the unfinished run'
    $status = if ($wanted) { 'abandoned' } elseif ($script:Preview) { 'previewed' } else { 'skipped' }
    if ($wanted) { Add-Record -Record ([ordered] @{ closing = $status; kind = 'run_closed' }) }
    Write-RunEvent -Kind 'run' -Status $status
}

function Use-Target {
    param([string] $Address, [scriptblock] $Read, [System.Collections.IDictionary] $Row = $null)
    $script:Target = @{ Address = $Address; Read = $Read; Row = $Row }
}

function Add-Step {
    param(
        [string] $Action, [System.Collections.IDictionary] $Before, [System.Collections.IDictionary] $After,
        [scriptblock] $Set, [scriptblock] $Fits = $null, [string] $Undoes = '', [string] $Lost = '', $Same = $null
    )
    $address = $script:Target.Address
    if ($Same) { foreach ($name in $Same.Keys) { foreach ($one in @($Before, $After)) { $one[$name] = $Same[$name] } } }
    $script:Steps += @{
        Number = $script:Steps.Count; Address = $address; Read = $script:Target.Read; Row = $script:Target.Row
        # A step depends on the steps of its own address and of its machine.
        Needs = @(($address -creplace '^([^/]+/[^/]+)/.*$', '$1'), $address) # the same value twice without a machine
        Before = (Get-OrdinalTable -From $Before); After = (Get-OrdinalTable -From $After)
        Action = $Action; Set = $Set; Fits = $Fits; Undoes = $Undoes; Lost = $Lost
    }
}

function Complete-Run {
    if ($null -eq $script:Started) { Write-FirstRecord }
    foreach ($step in $script:Steps) { Invoke-Step -Step $step }
    if ($script:Skipped.Count) {
        $script:Current = $script:Whole
        Exit-Run -Kind 'run' -Status 'stopped' -Code 1 -Detail 'steps were skipped: run the script again, or use -Abandon'
    }
    if ($script:Closing -cne 'done') {
        Assert-Host -Last
        Add-Record -Record ([ordered] @{ closing = 'done'; kind = 'run_closed' })
        $all = @(foreach ($one in $script:Steps) { if ($one.Address -cmatch '(^|/)task/') { [string] $one.Number } })
        if (@(foreach ($number in $all) { $script:Recorded[$number] }) -ccontains 'changed') {
            $start = Get-KeyValue -Path 'HKLM:\SYSTEM\CurrentControlSet\Services\MMCSS' -Name 'Start'
            $lack = 'the service MMCSS is missing or disabled here: classes have no effect until the service starts'
            if ($null -eq $start -or $start -eq 4) { Write-RunEvent -Kind 'run' -Status 'noted' -Detail $lack }
            Write-RunEvent -Kind 'run' -Status 'noted' -Detail 'restart Windows: MMCSS reads the classes at the start'
        }
    }
    Write-RunEvent -Kind 'run' -Status 'done' -Detail ('changed: {0}' -f $script:Changed)
}

function Assert-Host {
    # Read everything. Finished steps must still be in effect. The other steps must find the planned state.
    param([switch] $Last)
    $made = Get-OrdinalTable  # by address: the state after the finished steps
    $ahead = Get-OrdinalTable  # addresses that a later step renames
    $script:Listing = $true
    $script:Fresh = [DateTime]::UtcNow.AddMilliseconds(10000)
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
            $after = if ($gone) { Get-OrdinalTable } else { $made[$at].After }
            foreach ($name in $step.After.Keys) { $after[$name] = $step.After[$name] }
            $made[$at] = @{ Address = $at; Number = $step.Number; Read = $step.Read; Row = $step.Row; After = $after }
        }
        if ($leave) { continue }
        if (-not @(foreach ($one in $step.Needs) { if ($ahead.Contains($one + ' exists')) { $one } }).Count) {
            $live = Get-Reading -Step $step
            $moved = @(Compare-Step -Step $step -Live $live)
            $moved = @(foreach ($name in $moved) { if (-not $ahead.Contains($at + ' ' + $name)) { $name } })
            if ($moved.Count) { Exit-Run -Detail (Get-Difference -Name $moved -Live $live -Expected $step.Before) }
        }
        foreach ($name in @(Compare-Reading -Live $step.Before -Expected $step.After)) { $ahead[$at + ' ' + $name] = $true }
    }
    $settled = [DateTime]::UtcNow.AddMilliseconds(300000)
    foreach ($at in @(Get-Sorted -Text @($made.Keys))) {
        if ($ahead.Contains($at + ' exists')) { continue }
        $script:Current = $made[$at]
        $wanted = $made[$at].After
        # A running guest puts its own entry before its disk. The boot order was compared when it was set.
        [void] $wanted.Remove('boots_from')
        $live = Get-Reading -Name $wanted.Keys
        while ($live['state'] -ceq 'busy' -and [DateTime]::UtcNow -lt $settled) {
            Start-Sleep -Milliseconds 500
            $script:Known.Clear()
            $live = Get-Reading -Name $wanted.Keys
        }
        foreach ($name in @(Compare-Reading -Live $live -Expected $wanted)) {
            # The parent keys of several records are removed with the last record.
            if ($ahead.Contains($at + ' ' + $name) -or ($name -ceq 'empty' -and $ahead.Count)) { continue }
            $detail = Get-Difference -Name $name -Live $live -Expected $wanted -Text 'is not as wanted: '
            if ($Last) { throw ('{0} {1}' -f $at, $detail) }
            Exit-Run -Detail $detail
        }
    }
    $script:Current = $script:Whole
}

function Invoke-Step {
    # Read, compare, set, read again. Do nothing if the state is as wanted. Stop if it differs from both states.
    param([System.Collections.IDictionary] $Step)
    $set = $Step.Set
    $fits = $Step.Fits
    $script:Current = $Step
    $leave = Get-Leave -Step $Step
    if ($leave) { return Write-RunEvent -Kind 'step' -Step $Step -Status 'unchanged' -Detail $leave }
    $stop = $script:Run.ScriptPath + '.stop'
    if (Microsoft.PowerShell.Management\Test-Path -LiteralPath $stop) {
        # This file next to the script requests one stop before the next step.
        Use-SharedFile -Writing -Path $stop -Do { [System.IO.File]::Delete($stop) }
        $script:Current = $script:Whole
        Exit-Run -Kind 'run' -Status 'stopped' -Code 1 -Detail 'stopped on request: run the script again to continue'
    }
    # Readings expire after ten seconds. A reservation counts all machines.
    if ([DateTime]::UtcNow -gt $script:Fresh) { $script:Known.Clear() }
    $script:Listing = $null -ne $fits
    $lack = ''
    foreach ($one in $Step.Needs) { if (-not $lack -and $script:Skipped.Contains($one)) { $lack = $script:Skipped[$one] } }
    $live = Get-Reading -Step $Step
    $script:Open = @(Compare-Reading -Live $live -Expected $Step.After)
    # Skip steps that depend on a declined step, and do not record them: a record would show them as not needed.
    if (-not $lack -and -not $script:Open.Count) {
        # An interrupted step has changed something.
        $status = if ($script:Recorded.Contains([string] $Step.Number)) { 'changed' } else { 'unchanged' }
        return Add-StepRecord -Step $Step -Status $status
    }
    $moved = @(Compare-Step -Step $Step -Live $live)
    $skip = ''
    if ($lack) {
        $skip = 'needs ' + $lack
    } elseif ($moved.Count) {
        Exit-Run -Detail (Get-Difference -Name $moved -Live $live -Expected $Step.Before)
    } elseif ($null -ne $fits -and -not (& $fits)) {
        if (-not $script:Skipped.Count) {
            throw ('{0}: the host cannot honour this reservation: {1}' -f $Step.Address, $script:Shortage)
        }
        $skip = 'needs capacity that skipped steps would have freed'
    } elseif (-not (Test-Wanted -Address $Step.Address -Action $Step.Action)) {
        $skip = 'left out'
    }
    if ($skip) {
        if (-not $lack) { $lack = '{0}, {1}' -f $Step.Address, $Step.Action }
        # Do not set up a machine without its disk.
        foreach ($one in $Step.Needs) { $script:Skipped[$one] = $lack }
        return Write-RunEvent -Kind 'step' -Step $Step -Status 'skipped' -Detail $skip
    }
    $script:WasBegun = $script:Recorded.Contains([string] $Step.Number)
    Add-StepRecord -Step $Step -Status 'begun' -Detail $Step.Action
    [void] (& $set)
    $script:Called[[string] $Step.Number] = $true
    foreach ($message in $script:Messages) { Write-RunEvent -Kind 'step' -Step $Step -Status 'waited' -Detail $message }
    $script:Messages = @()
    $script:Known.Clear()
    $allFollow = $Step.Number -eq $script:Steps.Count - 1 -and $Step.Address -cne $script:Steps[0].Address
    $script:Listing = $allFollow -or $Step.After['exists'] -ceq $false
    $missed = @(Compare-Reading -Live (Get-Reading -Step $Step) -Expected $Step.After)
    $text = '{0}: after the change, the host shows a different {1}: find the cause, then run the script again'
    if ($missed.Count) { throw ($text -f $Step.Address, ($missed -join ', ')) }
    Add-StepRecord -Step $Step -Status 'changed' -Detail $Step.Action
}

function Test-Open {
    # Whether one of these values differs from the wanted state. A new run does not repeat the changes of an interrupted run.
    param([string[]] $Name)
    @(foreach ($one in $Name) { if ($script:Open -ccontains $one) { $one } }).Count -gt 0
}

function Test-Wanted {
    # Whether -WhatIf or the user allows the step. With -AsJson, no "What if" line is written between events.
    [Diagnostics.CodeAnalysis.SuppressMessageAttribute('PSShouldProcess', '', Justification = 'It asks for the script.')]
    param([string] $Address, [string] $Action)
    if ($script:Run.AsJson -and $script:Preview) { return $false }
    $ConfirmPreference = $script:Run.Confirmation
    try { $script:Run.Caller.ShouldProcess($Address, $Action) }
    catch { throw 'no console is available to confirm this step: run the script in a console, or with -Force' }
}

function Get-Leave {
    # Return the reason why a step is not needed, or nothing if it is needed. The first two reasons are for undo scripts.
    param([System.Collections.IDictionary] $Step)
    if ($Step.Undoes -cne '' -and -not $script:Touched.Contains($Step.Undoes)) { return 'was not done' }
    $lost = $script:Touched.Contains($Step.Lost) -and -not (Get-Reading -Name 'exists')['exists']
    if ($lost) { return 'removed with its machine' }
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
    param([System.Collections.IDictionary] $Step = $null, [string[]] $Name = @())
    $read = $script:Current.Read
    $script:Row = $script:Current.Row  # for its blocks, which do not see variables of the plan
    $script:Wanted = if ($null -eq $Step) { $Name } else { @($Step.Before.Keys) + @($Step.After.Keys) }
    & $read
}

function Compare-Step {
    # Names of values that are neither as wanted, nor as planned before, nor in between.
    param([System.Collections.IDictionary] $Step, [System.Collections.IDictionary] $Live)
    if (-not @(Compare-Reading -Live $Live -Expected $Step.After).Count) { return }
    # An interrupted step can leave each value old or new.
    if ($script:Recorded.Contains([string] $Step.Number) -or $Step.Undoes -cne '') {
        $names = @($Step.Before.Keys)
        # A value that is not compared before a step may be anything, but it must exist.
        $all = $Step.Before['exists'] -ceq $false -or $names -ccontains 'values'
        if ($all) { $names += @($Step.After.Keys) + @(@($Live.Keys) -clike 'value:*') }
        foreach ($name in $names) {
            # Values are added and removed one by one; a machine may be shutting down.
            $busy = @('values', 'empty') -ccontains $name -or ($name -ceq 'state' -and $Live[$name] -ceq 'busy')
            $old = Test-Agreed -Left $Live -Right $Step.Before -Name $name
            if (-not ($busy -or $old -or (Test-Agreed -Left $Live -Right $Step.After -Name $name))) { $name }
        }
        return
    }
    Compare-Reading -Live $Live -Expected $Step.Before
}

function Compare-Reading {
    param([System.Collections.IDictionary] $Live, [System.Collections.IDictionary] $Expected)
    # Do not filter with cmdlets here: a profile may replace them.
    foreach ($name in @($Expected.Keys)) { if (-not (Test-Agreed -Left $Live -Right $Expected -Name $name)) { $name } }
}

function Get-Difference {
    param([string[]] $Name, $Live, $Expected, [string] $Text = 'changed since the plan: ')
    if ($Live['exists'] -ceq $false -and -not ($Expected['exists'] -ceq $false)) {
        return 'it does not exist on this host any more: make a new plan'
    }
    $Text + (@(Get-Sorted -Text $Name) -join ', ') + '; make a new plan'
}

function Get-OrdinalTable {
    [Diagnostics.CodeAnalysis.SuppressMessageAttribute('PSUseLiteralInitializerForHashtable', '',
        Justification = '5.1 compares the keys of a literal by the culture of the user.')]
    param([System.Collections.IDictionary] $From = @{})
    [hashtable]::new($From, [System.StringComparer]::Ordinal)
}

function Get-Sorted {
    param([string[]] $Text)  # Sort-Object compares by the culture of the user
    [Array]::Sort($Text, [System.StringComparer]::Ordinal)
    $Text
}

function Test-Agreed {
    param([System.Collections.IDictionary] $Left, [System.Collections.IDictionary] $Right, [string] $Name)
    if ($Left.Contains($Name) -ne $Right.Contains($Name)) { return $false }
    Test-Same -Left ([string] $Left[$Name]) -Right ([string] $Right[$Name])
}

function Test-Same {
    # -ceq and -eq ignore characters without width, and are slow with long texts.
    param([string] $Left, [string] $Right, [switch] $AnyCase)
    $how = if ($AnyCase) { [System.StringComparison]::OrdinalIgnoreCase } else { [System.StringComparison]::Ordinal }
    [string]::Equals($Left, $Right, $how)
}

function Write-RunEvent {
    param([string] $Kind, [System.Collections.IDictionary] $Step = $script:Whole, [string] $Status, [string] $Detail)
    if ($Kind -cne 'step') { $script:Outcome = @{ Status = $Status; Detail = $Detail } }
    if ($script:Run.AsJson) {
        return ConvertTo-AsciiJson -Value ([ordered] @{
            format = 'rarms-event/1'; kind = $Kind; plan = $script:Plan.Plan; number = $Step.Number
            total = $script:Steps.Count; address = $Step.Address; status = $Status; detail = $Detail
            changed = $script:Changed
        })
    }
    $text = '{0,-10} {1}  {2}' -f $Status, $Step.Address, $Detail
    Write-Information -MessageData $text -InformationAction Continue
    if ($script:Preview) { return }
    $ProgressPreference = 'Continue'
    if ($Kind -cne 'step') { return Write-Progress -Activity 'rarms' -Completed }
    Write-Progress -Activity 'rarms' -Status $text -PercentComplete ([int] (100 * $Step.Number / ($script:Steps.Count + 1)))
}

function Write-Verdict {
    # Write the status of this run next to its script, because Ctrl-C gives the code 0, and to the event log of Windows,
    # if possible.
    if ($script:Preview) { return }
    $text = ConvertTo-AsciiJson -Value ([ordered] @{
        format = 'rarms-result/1'; plan = $script:Plan.Plan; run = $script:Plan.Run; operator = $script:Operator
        status = $script:Outcome.Status; exit_code = $script:Code; changed = $script:Changed; detail = $script:Outcome.Detail
    })
    if ($null -ne $script:Handle -and $script:Result) { Write-ResultFile -Text $text }
    $id = if ($script:Outcome.Status -ceq 'begun') { 1 } else { 2 + $script:Code }
    $type = if ($id -gt 2) { 'Warning' } else { 'Information' }
    try { [System.Diagnostics.EventLog]::WriteEntry('rarms', $text, $type, $id) }
    catch { Write-Verbose -Message $_.Exception.Message }
}

function Write-ResultFile {
    # Use ProgramData if the script's folder or the file cannot be written. Do not try again after an error.
    param([string] $Text)
    $path = $script:Result
    $script:Result = ''
    if (Microsoft.PowerShell.Management\Test-Path -LiteralPath $path) { Assert-NoLink -Path $path }
    try { Write-SharedFile -Path $path -Text $Text } catch {
        $why = $_.Exception.Message
        $path = Join-Path -Path $script:Folder -ChildPath ([System.IO.Path]::GetFileName($path))
        Write-SharedFile -Path $path -Text $Text
        $earlier = $script:Outcome
        Write-RunEvent -Kind 'run' -Status 'noted' -Detail ('the verdict is in {0}: {1}' -f $path, $why)
        $script:Outcome = $earlier
    }
    $script:Result = $path
}

function Exit-Run {
    # The default exit code is 3: the host differs from the plan, the host is busy, or the plan was already used.
    param([string] $Kind = 'refused', [string] $Status = 'refused', [int] $Code = 3, [string] $Detail)
    $script:Ending = @{ Kind = $Kind; Status = $Status; Code = $Code }
    throw $Detail
}

function ConvertTo-AsciiJson {
    # Return one line of ASCII JSON. 5.1 and 7 escape different characters.
    param($Value)
    $text = ConvertTo-Json -InputObject $Value -Depth 20 -Compress
    [regex]::Replace($text, '[^\x20-\x7e]', { '\u{0:x4}' -f [int] [char] $args[0].Value })
}

# === preview: output of -WhatIf.
function Show-Run {
    # Show stops, removals and deletions first, then every remaining step with the state before it.
    $shown = @(Get-Preview)
    $ahead = @(foreach ($one in $shown) { if ($one.Status -ceq 'previewed') { $one } })
    $lines = @(foreach ($loss in @('stops', 'removes', 'deletes')) {
        $at = @(foreach ($one in $ahead) { if ((Get-Loss -Step $one.Step) -ceq $loss) { $one.Step.Address } })
        if ($at.Count) { $loss + ' ' + ($at -join ', ') }
    })
    $detail = if ($lines.Count) { $lines -join '; ' } else { 'nothing is stopped, removed or deleted' }
    Write-RunEvent -Kind 'run' -Status 'previewed' -Detail $detail
    foreach ($one in $shown) {
        if ($script:Run.AsJson -or $one.Status -ceq 'unchanged') {
            Write-RunEvent -Kind 'step' -Step $one.Step -Status $one.Status -Detail $one.Detail
        } else {
            [void] (Test-Wanted -Address $one.Step.Address -Action $one.Detail)
        }
    }
    $detail = '{0} of {1} steps remain; nothing was changed' -f $ahead.Count, $shown.Count
    Write-RunEvent -Kind 'run' -Status 'previewed' -Detail $detail
}

function Show-State {
    $all = @(foreach ($one in @(Get-Preview)) {
        [pscustomobject] @{
            Address = $one.Step.Address; Action = $one.Step.Action
            InDesiredState = $one.Status -ceq 'unchanged'; Disruption = '' + (Get-Loss -Step $one.Step)
        }
    })
    if (-not $script:Run.AsJson) { return $all }
    $wanted = @(foreach ($one in $all) { $one.InDesiredState }) -cnotcontains $false
    ConvertTo-AsciiJson -Value ([ordered] @{
        script = $script:Run.ScriptPath; plan = $script:Plan.Plan; _inDesiredState = $wanted; steps = $all
    })
}

function Get-Preview {
    $made = Get-OrdinalTable  # by address: the last action shown
    foreach ($step in $script:Steps) {
        $script:Current = $step
        $fits = $step.Fits
        $after = ''
        foreach ($at in $step.Needs) { if ($made.Contains($at)) { $after = $made[$at] } }
        $leave = Get-Leave -Step $step
        if (-not $leave -and -not $after) {
            if (-not @(Compare-Reading -Live (Get-Reading -Step $step) -Expected $step.After).Count) { $leave = 'as wanted' }
        }
        if ($leave) {
            @{ Step = $step; Status = 'unchanged'; Detail = $leave }
            continue
        }
        if (-not $made.Count -and $null -ne $fits -and -not (& $fits)) {
            throw ('{0}: the host cannot honour this reservation: {1}' -f $step.Address, $script:Shortage)
        }
        $detail = if ($after) { '{0} (after: {1})' -f $step.Action, $after } else { $step.Action }
        @{ Step = $step; Status = 'previewed'; Detail = $detail }
        $made[$step.Address] = $step.Action
    }
    $script:Current = $script:Whole
}

function Get-Loss {
    param([System.Collections.IDictionary] $Step)
    if ($Step.Before['exists'] -ceq $true -and $Step.After['exists'] -ceq $false) {
        if ($Step.Address -cmatch '/disk(/|$)') { 'deletes' } else { 'removes' }
    } elseif ($Step.After['state'] -ceq 'off' -and @('', 'off') -cnotcontains [string] $Step.Before['state']) {
        'stops'
    }
}

# === lock: one run at a time on this computer, in a folder that only Administrators and SYSTEM may write to.
function Lock-Host {
    # A preview does not lock. Secure the folder first, so that no other account can open, and so lock, its files.
    $wait = $script:Run.LockTimeout
    if ($wait -lt 0 -or $wait -gt 86400) { throw '-LockTimeout must be 0 to 86400 seconds' }
    if ($script:Preview) { return }
    if (Microsoft.PowerShell.Management\Test-Path -LiteralPath $script:Folder) { Assert-Owner -Path $script:Folder }
    else { Add-Folder -Path $script:Folder }
    if (Microsoft.PowerShell.Management\Test-Path -LiteralPath $script:OwnerFile) { Assert-Owner -Path $script:OwnerFile }
    Protect-Path -Path $script:Folder -Descriptor 'O:BAG:SYD:P(A;OICI;FA;;;BA)(A;OICI;FA;;;SY)'
    # A reader has the file open only for a moment.
    if ($wait -lt 2) { $wait = 2 }
    $until = [DateTime]::UtcNow.AddMilliseconds(1000 * $wait)
    while ($null -eq $script:Handle) {
        try {
            $script:Handle = [System.IO.FileStream]::new($script:OwnerFile, 'OpenOrCreate', 'Write', 'Read')
        } catch [System.UnauthorizedAccessException] {
            if (-not ([DateTime]::UtcNow -lt $until)) { throw }
        } catch [System.IO.IOException] {
            if (-not ([DateTime]::UtcNow -lt $until)) {
                try { $holder = '' + (Read-SharedFile -Path $script:OwnerFile) } catch { $holder = '' }
                if (-not $holder) { $holder = 'an unknown user' }
                $text = 'locked by {0}, who has {1} open: wait, or set -LockTimeout'
                Exit-Run -Kind 'lock' -Detail ($text -f $holder, $script:OwnerFile)
            }
        }
        if ($null -eq $script:Handle) { Start-Sleep -Milliseconds 500 }
    }
    [byte[]] $data = [System.Text.Encoding]::ASCII.GetBytes($script:Operator)
    $script:Handle.SetLength(0)
    $script:Handle.Write($data, 0, $data.Length)
    $script:Handle.Flush($true)
}

function Unlock-Host {
    if ($null -eq $script:Handle) { return }
    $script:Handle.Dispose()
    try { [System.IO.File]::Delete($script:OwnerFile) } catch { Write-Verbose -Message $_.Exception.Message }
}

function Assert-NoLink {
    param([string] $Path)
    $attributes = Use-SharedFile -Path $Path -Do { [System.IO.File]::GetAttributes($Path) }
    $link = $attributes -band [System.IO.FileAttributes]::ReparsePoint
    if ($link) { throw ('{0} is a link: check its target, then remove the link' -f $Path) }
}

function Assert-Owner {
    # A journal or folder of another user must not control an administrator or redirect files.
    param([string] $Path)
    if ($env:OS -cne 'Windows_NT') { return }
    Assert-NoLink -Path $Path
    $owner = Use-SharedFile -Path $Path -Do {
        (Get-Acl -LiteralPath $Path).GetOwner([System.Security.Principal.SecurityIdentifier]).Value
    }
    if (@('S-1-5-32-544', 'S-1-5-18') -ccontains $owner) { return }
    # The run of the owner's file may have ended meanwhile.
    if ($Path -ceq $script:OwnerFile -and -not (Microsoft.PowerShell.Management\Test-Path -LiteralPath $Path)) { return }
    throw ('{0} belongs to {1}, not to Administrators or SYSTEM: check the file, then remove it' -f $Path, $owner)
}

# === journal: the record of a run on this computer: one line of JSON per record, with its length and a checksum.
function Import-Journal {
    # Read the complete records of the last run. Drop an incomplete last record; anything else is damage.
    if (-not $script:Preview) { Remove-Unused }
    $whole = Read-SharedFile -Path $script:Journal
    if ($null -eq $whole) { return }
    foreach ($path in @($script:Folder, $script:Journal)) { Assert-Owner -Path $path }
    $damage = $script:Journal + ' is damaged: check the result of the last run, then remove the file'
    $torn = $false
    foreach ($line in @($whole -csplit '(?<=\n)')) {
        if ($torn -and $line) { throw $damage }
        if (-not $line) { continue }
        $text = $line -creplace ',"length":[0-9]+,"checksum":"[0-9a-f]{64}"\}\n$', '}'
        $torn = -not (Test-Same -Left (Get-Sealed -Text $text) -Right $line)
        $ended = $line -cmatch '\n\z' -and -not $line.Contains([string] [char] 0)
        if ($torn -and ($ended -or $null -eq $script:Started)) { throw $damage }
        if ($torn) { continue }
        $script:Sound += $line.Length
        $record = ConvertFrom-Json -InputObject $text
        if ($record.kind -ceq 'run_closed') { $script:Closing = $record.closing }
        elseif ($record.kind -ceq 'step_recorded') { $script:Recorded[[string] $record.number] = $record.status }
        else {
            $script:Started = $record
            $script:Past = @($record.history)
            foreach ($number in @($record.touched)) { $script:Touched[[string] $number] = $true }
            foreach ($one in $record.serials.PSObject.Properties) { $script:Serials[$one.Name] = [long] $one.Value }
        }
    }
    if ($null -eq $script:Started) { throw $damage }
}

function Remove-Unused {
    # A run that was killed at its beginning left its first record, and may have moved the old journal.
    $fresh = $script:Journal + '.new'
    $old = $script:Journal + '.old'
    if (-not ([System.IO.File]::Exists($fresh))) { return }
    if (-not ([System.IO.File]::Exists($script:Journal)) -and [System.IO.File]::Exists($old)) {
        Use-SharedFile -Writing -Path $old -Do { [System.IO.File]::Move($old, $script:Journal) }
    }
    Use-SharedFile -Writing -Path $fresh -Do { [System.IO.File]::Delete($fresh) }
}

function Get-Sealed {
    param([string] $Text)
    $digest = Get-Sha256 -Data ([System.Text.Encoding]::ASCII.GetBytes($Text))
    '{0},"length":{1},"checksum":"{2}"}}{3}' -f ($Text -creplace '\}$', ''), $Text.Length, $digest, [char] 10
}

function Add-Record {
    # Flush to disk before returning. Remove an incomplete last record first.
    param([System.Collections.IDictionary] $Record, [string] $Path = $script:Journal)
    if ($script:Preview) { return }
    $line = Get-Sealed -Text (ConvertTo-AsciiJson -Value $Record)
    Write-SharedFile -Path $Path -Text $line -From $script:Sound
    $script:Sound += $line.Length
}

function Clear-Journal {
    # Move its run to the history, which keeps the last hundred. An undo reverses this.
    $last = $script:Started
    if ($null -eq $last) { return }
    $extra = $script:Past.Count - 99
    $script:Past = @(foreach ($one in $script:Past) { if ($extra -gt 0) { $extra -= 1 } else { $one } }) + [ordered] @{
        run = $last.run; plan = $last.plan; application = $last.application; started_by = $last.started_by
        started_at = $last.started_at; closing = if ($script:Closing) { $script:Closing } else { $null }
        robot = $last.robot; purpose = $last.purpose
    }
    $script:Touched.Clear()
    foreach ($number in @(if ($script:Plan.Run -ceq 'undo') { $script:Recorded.Keys })) {
        if ($script:Recorded[$number] -cne 'unchanged') { $script:Touched[$number] = $true }
    }
    $script:Started = $null
    $script:Closing = ''
    $script:Recorded.Clear()
}

function Read-MadeFile {
    # Return the text of a file of rarms, if it was not edited.
    param([string] $Path, [string] $Digest)
    $text = Read-SharedFile -Path $Path
    if ($null -eq $text) { throw ('{0} is missing: restore the file that rarms wrote' -f $Path) }
    if ((Get-UnsignedDigest -Text $text) -ceq $Digest) { return $text }
    $text = $text -creplace '\r?\n', ('' + [char] 13 + [char] 10)
    if ((Get-UnsignedDigest -Text $text) -ceq $Digest) {
        throw ('{0} has changed line ends: in git, set "*.ps* -text"' -f $Path)
    }
    throw ('{0} was edited: restore the file that rarms wrote' -f $Path)
}

function Get-UnsignedDigest {
    # A signature adds comments at the end. Everything before them is from rarms.
    param([string] $Text)
    Get-Sha256 -Data ([System.Text.Encoding]::GetEncoding(28591).GetBytes(($Text -creplace $script:Signature, '')))
}

function Write-FirstRecord {
    $plan = $script:Plan
    $undo = ''
    if ($plan.Undo) {
        $path = [System.IO.Path]::Combine([System.IO.Path]::GetDirectoryName($script:Run.ScriptPath), $plan.Undo)
        $undo = Read-MadeFile -Path $path -Digest $plan.UndoDigest
    }
    $script:Serials[$plan.Application] = [long] $script:Serials[$plan.Application] + 1
    $fresh = $script:Journal + '.new'
    $script:Sound = [long] 0
    $record = [ordered] @{
        run = $plan.Run; plan = $plan.Plan; application = $plan.Application; started_by = $script:Operator
        robot = $plan.Robot; purpose = $plan.Purpose
        script = Read-SharedFile -Path $script:Run.ScriptPath; undo = $undo
        # Write text without the T of ISO dates, which 7 would read as a date. A cast does not depend on the culture.
        started_at = [string] [DateTime]::UtcNow -creplace '^(..)/(..)/(....) (.*)$', '$3-$1-$2 $4 UTC'
        history = @($script:Past); serials = $script:Serials
        touched = @(Get-Sorted -Text @($script:Touched.Keys)); kind = 'run_started'
    }
    if ($script:Run.ModulePath) {
        $record['module'] = Get-OrdinalTable
        foreach ($one in @('Rarms.psd1', 'Rarms.psm1')) {
            $record['module'][$one] = Read-SharedFile -Path ([System.IO.Path]::Combine($script:Run.ModulePath, $one))
        }
    }
    Add-Record -Path $fresh -Record $record
    Protect-Path -Path $fresh -Descriptor 'O:BAG:SYD:P(A;;FA;;;BA)(A;;FA;;;SY)'
    Use-SharedFile -Writing -Path $script:Journal -Do {
        # A failed replacement may already have removed the old file.
        if ([System.IO.File]::Exists($script:Journal)) {
            [System.IO.File]::Replace($fresh, $script:Journal, $script:Journal + '.old')
        } else { [System.IO.File]::Move($fresh, $script:Journal) }
    }
}

# === host: checks that this is the right host and that reserves have an effect.
function Assert-VmHost {
    $plan = $script:Plan
    # If 7 loads Hyper-V through 5.1, its cmdlets do not accept their own objects.
    $command = Get-Command -Name 'Hyper-V\Get-VM'
    if ([string] $command.CommandType -cne 'Cmdlet' -or $command.Version.Major -lt 2) {
        Exit-Run -Detail 'this PowerShell does not load Hyper-V 2.0.0.0 itself: start powershell.exe of Server 2016 or later'
    }
    $vmHost = Hyper-V\Get-VMHost
    if (-not (Test-Same -AnyCase -Left $vmHost.Name -Right $plan.Computer)) {
        Exit-Run -Detail ('this computer is {0}, the plan is for {1}: run it on {1}' -f $vmHost.Name, $plan.Computer)
    }
    if ($plan.Identity) {
        # The identity of this Windows, as observe.ps1 computes it.
        $id = '' + (Get-KeyValue -Path 'HKLM:\SOFTWARE\Microsoft\Cryptography' -Name 'MachineGuid')
        $id = Get-Sha256 -Data ([System.Text.Encoding]::ASCII.GetBytes('rarms host ' + $id.Trim().ToLowerInvariant()))
        if ($id.Substring(0, 32) -cne $plan.Identity) {
            Exit-Run -Detail ('the plan is for another computer named {0}: make a plan for this computer' -f $vmHost.Name)
        }
    }
    # An undo reserves nothing new.
    if ($plan.Run -ceq 'undo') { return }
    if ($vmHost.LogicalProcessorCount -ne $plan.LogicalProcessors) {
        Exit-Run -Detail ('the host now has {0} logical processors: make a new plan' -f $vmHost.LogicalProcessorCount)
    }
    if (-not $vmHost.NumaSpanningEnabled) { $script:Nodes = @(Hyper-V\Get-VMHostNumaNode) }
    if ($plan.AcceptScheduler) { return }
    if (Test-RootScheduler) {
        throw 'reserves have no effect with the root scheduler: select the core scheduler, or accept RARMS159'
    }
}

function Test-RootScheduler {
    # Event 2 has 4 for root. Without the event, a client Windows has root; for a server the plan has a finding.
    try {
        $asked = @{ ProviderName = 'Microsoft-Windows-Hyper-V-Hypervisor'; ID = 2 }
        return [int] @(Get-WinEvent -FilterHashtable $asked -MaxEvents 1)[0].Properties[0].Value -eq 4
    } catch { Write-Verbose -Message $_.Exception.Message }
    (Get-KeyValue -Path 'HKLM:\SOFTWARE\Microsoft\Windows NT\CurrentVersion' -Name 'InstallationType') -ceq 'Client'
}

# === guest: checks for the script of a guest.
function Assert-Guest {
    $path = 'HKLM:\SOFTWARE\Microsoft\Virtual Machine\Guest\Parameters'
    $id = ('' + (Get-KeyValue -Path $path -Name 'VirtualMachineId')).ToLowerInvariant()
    if (-not $id) { Exit-Run -Detail 'this Windows is not a guest, or its service vmickvpexchange never ran: start it' }
    $name = '' + (Get-KeyValue -Path $path -Name 'VirtualMachineName')
    foreach ($one in @($id, $name)) { if (Test-Same -Left $one -Right $script:Plan.Guest) { return } }
    Exit-Run -Detail ('this is the guest of {0} ({1}), not of {2}: run it in that guest' -f $name, $id, $script:Plan.Guest)
}

# === machines: find, read and mark virtual machines, never by their names.
function Get-PartitionReading {
    # Read the machine with this id, or the one that this plan creates with this name. Also tell whether the new one got
    # more than this disk later, because an undo must not remove it then.
    param([string] $Machine = '', [string] $Name = '', [string] $Disk = '', [switch] $Clustered)
    # Read only once until a step changes something.
    $at = $script:Current.Address
    if (-not $script:Known.Contains($at)) { $script:Known[$at] = Get-OrdinalTable }
    $live = $script:Known[$at]
    if (-not $live.Count) {
        if ($Name) { $Machine = $script:Machines[$Name] }
        $found = @(if ($Machine) { Find-Machine -Machine $Machine } else { Find-NewMachine -Name $Name })
        foreach ($vm in $found) {
            # A finished step is not changed.
            $tie = if (-not $Name -and $script:Current.Contains('Set')) { Get-Tie -Vm $vm -Clustered $Clustered }
            if (-not $tie) { continue }
            Exit-Run -Detail ('{0} ({1}) is {2} and is not changed: exclude it from the plan' -f $vm.Name, $vm.Id, $tie)
        }
        $many = '{0} machines have this mark of rarms: remove it from the notes of all but one'
        if ($found.Count -gt 1) { Exit-Run -Detail ($many -f $found.Count) }
        $live['exists'] = $found.Count -eq 1
        foreach ($vm in $found) { Add-MachineReading -Live $live -Vm $vm }
        if ($Name -and $live['exists']) { $script:Machines[$Name] = $live['machine'] }
    }
    $script:Vm = $live['vm']
    if ($live['exists']) { Add-DeviceReading -Live $live }
    if (Test-Unread -Live $live -Name 'taken') {
        $live['taken'] = $false
        foreach ($vm in @(Get-MachineList)) {
            $named = Test-Same -Left $vm.Name -Right $Name
            if ($named -and (Get-Mark -Vm $vm).Application -cne $script:Plan.Application) { $live['taken'] = $true }
        }
    }
    if ($live['exists'] -and (Test-Unread -Live $live -Name 'added')) {
        # Other than this disk: more disks, a different name, a checkpoint.
        $live['added'] = @(
            foreach ($drive in @(Hyper-V\Get-VMHardDiskDrive -VM $script:Vm)) {
                if (-not (Test-SamePath -Left $drive.Path -Right $Disk)) { 'disk ' + $drive.Path }
            }
            $kept = Test-Same -Left $Name -Right $live['name']
            $kept = $kept -or (Test-Same -Left (Get-PendingName -Name $Name) -Right $live['name'])
            if (-not $kept) { 'name ' + $live['name'] }
            if (@(Hyper-V\Get-VMSnapshot -VM $script:Vm).Count) { 'a checkpoint' }
        ) -join ', '
    }
    $live
}

function Find-Machine {
    param([string] $Machine)
    if (-not $script:Listing -and -not $script:Known.Contains('machines')) {
        try { return Hyper-V\Get-VM -Id $Machine } catch { Write-Verbose -Message $_.Exception.Message }
    }
    foreach ($vm in @(Get-MachineList)) { if (Test-Same -AnyCase -Left ([string] $vm.Id) -Right $Machine) { $vm } }
}

function Get-MachineList {
    if (-not $script:Known.Contains('machines')) { $script:Known['machines'] = @(Hyper-V\Get-VM) }
    $script:Known['machines']
}

function Get-Device {
    # Read a device of a machine; of all machines at once if they are listed. An error of one does not affect others.
    param([string] $Kind, $Vm)
    if (-not $script:Known.Contains('machines')) { return Read-Device -Kind $Kind -Machine $Vm }
    if (-not $script:Known.Contains($Kind)) {
        $script:Known[$Kind] = $null
        try { $script:Known[$Kind] = @(Read-Device -Kind $Kind -Machine $script:Known['machines']) }
        catch { Write-Verbose -Message $_.Exception.Message }
    }
    if ($null -eq $script:Known[$Kind]) { return Read-Device -Kind $Kind -Machine $Vm }
    foreach ($one in $script:Known[$Kind]) { if ([string] $one.VMId -ceq [string] $Vm.Id) { $one } }
}

function Read-Device {
    param([string] $Kind, $Machine)
    if ($Kind -ceq 'disks') { return Hyper-V\Get-VMHardDiskDrive -VM $Machine }
    if ($Kind -ceq 'snapshots') { return Hyper-V\Get-VMSnapshot -VM $Machine }
    Hyper-V\Get-VMProcessor -VM $Machine
}

function Test-Unread {
    param([System.Collections.IDictionary] $Live, [string[]] $Name)
    @(foreach ($one in $Name) { if ($script:Wanted -ccontains $one -and -not $Live.Contains($one)) { $one } }).Count -gt 0
}

function Get-Mark {
    # The mark in a machine's notes. A mark with the id of another machine, or two marks, do not count.
    param($Vm)
    $found = @(foreach ($line in @([string] $Vm.Notes -csplit '\n')) { if ($line -cmatch $script:MarkForm) { $line } })
    $sound = $found.Count -eq 1 -and -not (Test-Replica -Vm $Vm) -and $found[0] -cmatch $script:MarkForm
    if ($sound -and $Matches['vm'] -ceq ([string] $Vm.Id).Substring(0, 8).ToLowerInvariant()) {
        return @{ Application = $Matches['app']; Name = $Matches['name']; Set = $Matches['set'] }
    }
    @{ Application = ''; Name = ''; Set = '' }
}

function Get-Tie {
    # The other manager of a machine, which is then not changed here. A plan may accept a cluster. Read once per run.
    param($Vm, [bool] $Clustered = $false)
    if (Test-Replica -Vm $Vm) { return 'a replica of a machine on another host' }
    $known = $Vm.PSObject.Properties['IsClustered']
    if (-not $Clustered -and $null -ne $known -and $known.Value) { return 'part of a failover cluster' }
    $id = [string] $Vm.Id
    if (-not $script:Shielded.Contains($id)) { $script:Shielded[$id] = [bool] (Hyper-V\Get-VMSecurity -VM $Vm).Shielded }
    if ($script:Shielded[$id]) { 'shielded' }
}

function Test-Replica {
    # A replica has the id and the notes of its primary, so its mark does not count.
    param($Vm)
    @('Replica', 'TestReplica', 'ExtendedReplica') -ccontains [string] $Vm.ReplicationMode
}

function Write-Mark {
    # Write the mark of the step, or none, above the user's lines. Only this text contains values from the host.
    $wanted = $script:Current.After
    $notes = [string] $script:Vm.Notes -creplace ('(?m)' + $script:MarkForm + '\n?'), ''
    $id = ([string] $script:Vm.Id).Substring(0, 8).ToLowerInvariant()
    $line = 'rarms/1 {0} vm={1} set={2}' -f $wanted['mark'], $id, $wanted['set']
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
    param($Value)
    ([string] $Value -creplace '(?<=[a-z])(?=[A-Z])', '_').ToLowerInvariant()
}

function Add-MachineReading {
    param([System.Collections.IDictionary] $Live, $Vm)
    $mark = Get-Mark -Vm $Vm
    $Live['vm'] = $Vm
    $Live['machine'] = ([string] $Vm.Id).ToLowerInvariant()
    $Live['name'] = [string] $Vm.Name
    $Live['generation'] = [long] $Vm.Generation
    $Live['processors'] = [long] $Vm.ProcessorCount
    $Live['memory'] = [long] $Vm.MemoryStartup
    $Live['dynamic_memory'] = [bool] $Vm.DynamicMemoryEnabled
    $Live['start_action'] = ConvertTo-Word -Value $Vm.AutomaticStartAction
    $Live['stop_action'] = ConvertTo-Word -Value $Vm.AutomaticStopAction
    $Live['checkpoints'] = ConvertTo-Word -Value $Vm.CheckpointType
    $Live['state'] = ConvertTo-RunState -State $Vm.State
    $Live['running'] = $Live['state'] -ceq 'running'
    $Live['mark'] = if ($mark.Name) { '{0}/{1}' -f $mark.Application, $mark.Name } else { '' }
    $Live['set'] = $mark.Set
}

function Add-DeviceReading {
    # Call once for each kind that is needed and not read yet. A removed machine needs none.
    param([System.Collections.IDictionary] $Live)
    $vm = $Live['vm']
    if (Test-Unread -Live $Live -Name 'reserve', 'limit', 'weight') {
        $cpu = Get-Device -Kind 'processors' -Vm $vm
        $Live['reserve'] = [long] $cpu.Reserve
        $Live['limit'] = [long] $cpu.Maximum
        $Live['weight'] = [long] $cpu.RelativeWeight
    }
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
    foreach ($kind in @('disks', 'snapshots')) {
        if (Test-Unread -Live $Live -Name $kind) { $Live[$kind] = @(Get-Device -Kind $kind -Vm $vm).Count }
    }
}

function Get-ClusterReading {
    # Whether the cluster has the changes that this run made to the machine of this step.
    $own = $script:Current.Number
    $machine = $script:Current.Address -creplace '/cluster$', ''
    $recorded = $script:Recorded[[string] $own]
    $updated = $script:Called.Contains([string] $own) -or @('changed', 'unchanged') -ccontains $recorded
    $changed = @(foreach ($step in $script:Steps) {
        if ($step.Number -eq $own -or $step.Needs -cnotcontains $machine) { continue }
        if (@('begun', 'changed') -ccontains $script:Recorded[[string] $step.Number]) { $step.Number }
    })
    @{ updated = $updated -or -not $changed.Count }
}

# === creation: the machine that this plan creates has the mark, or at first the plan's temporary name.
function Find-NewMachine {
    param([string] $Name)
    $pending = Get-PendingName -Name $Name
    foreach ($vm in @(Get-MachineList)) {
        $mark = Get-Mark -Vm $vm
        $ours = $mark.Name -ceq $Name -and $mark.Application -ceq $script:Plan.Application
        if ($ours -or (Test-Same -Left $vm.Name -Right $pending)) { $vm }
    }
}

function Get-PendingName {
    param([string] $Name)
    '{0}.rarms-{1}' -f $Name, $script:Plan.Plan
}

function Move-NewPartition {
    # Hyper-V created a folder with the temporary name, and a rename keeps that folder. Files already moved stay.
    param([string] $From, [string] $To)
    if (-not (Test-SamePath -Left $script:Vm.Path -Right $To)) {
        Hyper-V\Move-VMStorage -VM $script:Vm -VirtualMachinePath $To -SnapshotFilePath $To -SmartPagingFilePath $To
    }
    Remove-PartitionFolder -From $From -To $To
}

function Get-FolderReading {
    param([string] $From, [string] $To)
    @{ folders = @(Get-EmptyFolder -Path $From, $To).Count }
}

function Remove-PartitionFolder {
    param([string] $From, [string] $To)
    foreach ($path in @(Get-EmptyFolder -Path $From, $To)) { [System.IO.Directory]::Delete($path) }
}

function Add-Folder {
    param([string] $Path)
    [void] [System.IO.Directory]::CreateDirectory($Path)
}

function Get-EmptyFolder {
    param([string[]] $Path)
    foreach ($one in $Path) {
        if (-not (Microsoft.PowerShell.Management\Test-Path -LiteralPath $one)) { continue }
        $link = [System.IO.File]::GetAttributes($one) -band [System.IO.FileAttributes]::ReparsePoint
        if (-not $link -and -not @(Microsoft.PowerShell.Management\Get-ChildItem -LiteralPath $one -Force).Count) { $one }
    }
}

# === capacity: whether the host can honour all reservations, also those of unmanaged machines.
function Test-Capacity {
    # Whether all reservations fit with this machine's new one: the sum, the memory, and each processor on a logical one.
    param([long] $Processors, [long] $Reserve, [long] $Memory)
    $plan = $script:Plan
    $cpu = if ($plan.ThreadsPerCore -eq 1) { $null } else { Get-Device -Kind 'processors' -Vm $script:Vm }
    $claims = @(@{ Cores = Get-CoreCount -Cpu $cpu -Processors $Processors; Reserve = $Reserve })
    $needed = $claims[0].Cores * $plan.ThreadsPerCore * $Reserve
    $percent = $plan.Percent
    $bytes = $plan.Memory
    $promised = @()
    foreach ($vm in @(Get-MachineList)) {
        if ([string] $vm.Id -ceq [string] $script:Vm.Id) { continue }
        $ours = (Get-Mark -Vm $vm).Application -ceq $plan.Application
        # A replica starts only at a failover.
        $starts = -not $ours -and -not (Test-Replica -Vm $vm) -and [string] $vm.AutomaticStartAction -cne 'Nothing'
        if (-not $starts -and @('off', 'saved') -ccontains (ConvertTo-RunState -State $vm.State)) { continue }
        # With dynamic memory it may have more than at its start.
        $most = [long] $vm.MemoryStartup
        if ([long] $vm.MemoryAssigned -gt $most) { $most = [long] $vm.MemoryAssigned }
        $bytes -= $most
        $cpu = Get-Device -Kind 'processors' -Vm $vm
        $claim = @{ Cores = Get-CoreCount -Cpu $cpu -Processors $cpu.Count; Reserve = [long] $cpu.Reserve }
        $claims += $claim
        $share = $claim.Cores * $plan.ThreadsPerCore * $claim.Reserve
        $percent -= $share
        if ($share) { $promised += '{0} {1}' -f $vm.Name, (ConvertTo-Processor -Percent $share) }
    }
    $free = '{0} and {1} MiB' -f (ConvertTo-Processor -Percent $percent), [long] ($bytes / 1048576)
    $asked = '{0} and {1} MiB' -f (ConvertTo-Processor -Percent $needed), [long] ($Memory / 1048576)
    $script:Shortage = 'needs {0}, free {1}' -f $asked, $free
    if ($promised.Count) { $script:Shortage += ', reserved: ' + ($promised -join ', ') }
    $script:Shortage += '; free capacity and run the script again, or make a new plan'
    $nodes = @(foreach ($one in $script:Nodes) {
        if (@($one.ProcessorsAvailability).Count -ge $Processors -and $one.MemoryTotal -ge $Memory / 1048576) { $one }
    })
    if ($script:Nodes.Count -and -not $nodes.Count) {
        $script:Shortage = 'the machine is larger than each NUMA node of this host: allow NUMA spanning'
        return $false
    }
    if ($needed -gt $percent -or $Memory -gt $bytes) { return $false }
    $script:Shortage = 'each of its processors must fit on one core with the others: ' + $script:Shortage
    # Machines as wide as the host use every core. Place the others largest first, each at the first free place.
    $wide = 0
    $sizes = @()
    foreach ($one in $claims) {
        if ($one.Reserve -gt 0 -and $one.Cores -gt $plan.Cores) { return $false }
        if ($one.Cores -eq $plan.Cores) { $wide += $one.Reserve } else { $sizes += @($one.Reserve) * $one.Cores }
    }
    $free = @(100 - $wide) * $plan.Cores
    foreach ($size in @($sizes | Microsoft.PowerShell.Utility\Sort-Object -Descending)) {
        $at = 0
        while ($at -lt $free.Count -and $free[$at] -lt $size) { $at++ }
        if ($at -eq $free.Count) { return $false }
        $free[$at] -= $size
    }
    $wide -le 100
}

function ConvertTo-Processor {
    # Write per cent as logical processors, with a decimal point: 160 is 1.6 LP.
    param([long] $Percent)
    if ($Percent -lt 0) { return '0 LP' }
    (('00' + $Percent) -creplace '^0*([0-9]+)([0-9]{2})$', '$1.$2' -creplace '\.?0+$', '') + ' LP'
}

function Get-CoreCount {
    # The cores that a machine takes if a core runs one machine at a time; otherwise each processor counts as a core.
    param($Cpu, [long] $Processors)
    if ($script:Plan.ThreadsPerCore -eq 1) { return $Processors }
    $own = $Cpu.PSObject.Properties['HwThreadCountPerCore']
    if ($null -eq $own -or $own.Value -eq 1) { return $Processors }  # then the second threads idle
    ($Processors + ($Processors -band 1)) / 2
}

# === stop: stop a virtual machine, and end a starting reservation.
function Wait-Start {
    param([long] $Milliseconds)
    if ($script:WasBegun) { return }  # the machine was started by an earlier, interrupted run
    $stop = $script:Run.ScriptPath + '.stop'
    $until = [DateTime]::UtcNow.AddMilliseconds($Milliseconds)
    while ([DateTime]::UtcNow -lt $until -and -not (Microsoft.PowerShell.Management\Test-Path -LiteralPath $stop)) {
        Start-Sleep -Milliseconds 200
    }
}

function Stop-Partition {
    # Ask the guest to shut down, force it after half of the grace, turn it off at its end. Report refusals and wait.
    param([long] $GraceMs)
    $vm = $script:Vm
    $begun = [DateTime]::UtcNow
    $until = $begun.AddMilliseconds($GraceMs)
    # -Force gives programs at most five minutes, so start it late enough for a longer grace.
    $plain = if ($GraceMs -gt 600000) { $GraceMs - 300000 } else { $GraceMs / 2 }
    $force = $begun.AddMilliseconds($plain)
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
                if ([string] $job.State -cne 'Failed') { $job } else {
                    $message = 'its guest could not be {0}; waiting for it: ' -f $asked
                    try { [void] (Receive-Job -Job $job) } catch { $script:Messages += $message + $_.Exception.Message }
                    Remove-Job -Job $job -Force
                }
            })
            Start-Sleep -Milliseconds 1000
            $now = Hyper-V\Get-VM -Id $vm.Id
        }
    } finally { foreach ($job in $jobs) { Remove-Job -Job $job -Force } }
    if ([string] $now.State -cne 'Off') { Hyper-V\Stop-VM -VM $vm -TurnOff -Force }
}

function Test-ShutdownService {
    param($Vm)
    foreach ($one in @(Hyper-V\Get-VMIntegrationService -VM $Vm)) {
        # Use its id: its name is in the host's language.
        if (-not (([string] $one.Id).ToLowerInvariant() -clike '*9f8233ac-be49-4c79-8ee3-e7e1985b2077')) { continue }
        return $one.Enabled -and @('Ok', 'Degraded') -ccontains [string] $one.PrimaryOperationalStatus
    }
    $false
}

# === disks: read virtual disks.
function Get-DiskReading {
    param([string] $Path, [string] $Parent, [switch] $Everywhere)
    if (-not (Microsoft.PowerShell.Management\Test-Path -LiteralPath $Path)) { return @{ exists = $false } }
    $disk = Hyper-V\Get-VHD -Path $Path
    $live = @{ exists = $true }
    $live['child'] = [string] $disk.VhdType -ceq 'Differencing' -and (Test-SamePath -Left $disk.ParentPath -Right $Parent)
    if ($Everywhere) { $live['used'] = Test-DiskUse -Path $Path }
    $live
}

function Test-DiskUse {
    param([string] $Path)
    $all = @(Get-MachineList)
    if (-not $all.Count) { return $false }
    $drives = @(Hyper-V\Get-VMHardDiskDrive -VM $all)
    foreach ($one in @(Hyper-V\Get-VMSnapshot -VM $all)) { $drives += @(Hyper-V\Get-VMHardDiskDrive -VMSnapshot $one) }
    foreach ($drive in $drives) {
        $at = [string] $drive.Path
        while ($at) {
            if (Test-SamePath -Left $at -Right $Path) { return $true }
            if ($at -cmatch '[*?[\]`]') { throw ('{0}: Get-VHD reads this name as a pattern; rename the file' -f $at) }
            $there = Microsoft.PowerShell.Management\Test-Path -LiteralPath $at
            $at = if ($there) { [string] (Hyper-V\Get-VHD -Path $at).ParentPath } else { '' }
        }
    }
    $false
}

function Test-SamePath {
    param([string] $Left, [string] $Right)
    Test-Same -AnyCase -Left ($Left.Replace('/', '\')) -Right ($Right.Replace('/', '\'))
}

# === tasks: read and write multimedia task classes with typed values, and the records of rarms.
function Get-TaskClassReading {
    param([string] $Task)
    $live = Get-OrdinalTable
    $live['exists'] = $false
    foreach ($name in @('values', 'record', 'robot', 'set')) { $live[$name] = '' }
    $live['empty'] = Test-EmptyKey -Task $Task
    $names = @(Get-Sorted -Text @(foreach ($name in @(Get-TaskValueName -Task $Task)) { $name.ToLowerInvariant() }))
    foreach ($name in $names) {
        $key = Microsoft.PowerShell.Management\Get-Item -LiteralPath (Get-TaskPath -Task $Task)
        $kind = ([string] $key.GetValueKind($name)).ToLowerInvariant()
        $data = $key.GetValue($name)
        if ($kind -ceq 'dword') { $data = [long] $data -band 4294967295 }
        $live['value:' + $name] = '{0}:{1}' -f ($kind -creplace '^string$', 'sz'), $data
        $live['exists'] = $true
        # Windows ignores case in the names of values.
        $live['values'] = $names -join ', '
    }
    if (-not (Microsoft.PowerShell.Management\Test-Path -LiteralPath $script:RecordRoot)) { return $live }
    foreach ($application in @(Microsoft.PowerShell.Management\Get-ChildItem -LiteralPath $script:RecordRoot)) {
        $path = Get-RecordPath -Task $Task -Application $application.PSChildName
        if (-not (Get-KeyValue -Path $path -Name 'set')) { continue }
        $live['record'] = [string] $application.PSChildName
        foreach ($name in @('robot', 'set')) { $live[$name] = '' + (Get-KeyValue -Path $path -Name $name) }
    }
    $live
}

function Get-TaskValueName {
    param([string] $Task)
    $path = Get-TaskPath -Task $Task
    if (-not (Microsoft.PowerShell.Management\Test-Path -LiteralPath $path)) { return }
    foreach ($name in @((Microsoft.PowerShell.Management\Get-Item -LiteralPath $path).GetValueNames())) {
        if ($path -cne $script:ProfileRoot -or (Test-Same -AnyCase -Left $name -Right $Task)) { $name }
    }
}

function Get-TaskPath {
    # SystemResponsiveness is a value of the parent key of the task classes. Its record is next to theirs.
    param([string] $Task)
    if ($Task -ceq 'SystemResponsiveness') { return $script:ProfileRoot }
    '{0}\Tasks\{1}' -f $script:ProfileRoot, $Task
}

function Write-TaskValue {
    # Keep values that are already set, here and below, so that an interrupted step continues.
    param([string] $Task, [string] $Name, [string] $Type, $Value)
    $path = Get-TaskPath -Task $Task
    Add-Key -Path $path
    $wanted = '{0}:{1}' -f ($Type.ToLowerInvariant() -creplace '^string$', 'sz'), $Value
    $there = [string] (Get-TaskClassReading -Task $Task)['value:' + $Name.ToLowerInvariant()]
    if (Test-Same -Left $there -Right $wanted) { return }
    [void] (New-ItemProperty -LiteralPath $path -Name $Name -PropertyType $Type -Value $Value -Force)
}

function Remove-TaskValue {
    param([string] $Task, [string] $Name = '', [string] $Keep = '')
    $listed = if ($Keep) { @($Keep -csplit ', ') } else { @($Name) }
    foreach ($one in @(Get-TaskValueName -Task $Task)) {
        $is = @(foreach ($other in $listed) { if (Test-Same -AnyCase -Left $one -Right $other) { $other } }).Count -gt 0
        if ($is -ne [bool] $Keep) { Remove-ItemProperty -LiteralPath (Get-TaskPath -Task $Task) -Name $one }
    }
}

function Remove-TaskClass {
    param([string] $Task)
    $path = Get-TaskPath -Task $Task
    if ($path -ceq $script:ProfileRoot) { throw 'the profile itself is not a task class and cannot be removed' }
    Remove-Key -Path $path
}

function Write-TaskRecord {
    # Write the earlier values first and the digest last: without a digest the record does not count.
    param([string] $Task, [string] $Application, [string] $Robot, [string] $Digest, [string] $Before)
    $path = Get-RecordPath -Task $Task -Application $Application
    foreach ($one in @($script:RecordRoot, ('{0}\{1}' -f $script:RecordRoot, $Application), $path)) { Add-Key -Path $one }
    foreach ($one in @(@('before', $Before), @('robot', $Robot), @('set', $Digest))) {
        $there = '' + (Get-KeyValue -Path $path -Name $one[0])
        if (Test-Same -Left $there -Right $one[1]) { continue }
        [void] (New-ItemProperty -LiteralPath $path -Name $one[0] -PropertyType String -Value $one[1] -Force)
    }
}

function Remove-TaskRecord {
    param([string] $Task, [string] $Application)
    Remove-Key -Path (Get-RecordPath -Task $Task -Application $Application)
    foreach ($path in @(('{0}\{1}' -f $script:RecordRoot, $Application), $script:RecordRoot)) {
        if (Test-BareKey -Path $path) { Remove-Key -Path $path }
    }
}

function Get-KeyValue {
    param([string] $Path, [string] $Name)
    if (-not (Microsoft.PowerShell.Management\Test-Path -LiteralPath $Path)) { return }
    (Microsoft.PowerShell.Management\Get-Item -LiteralPath $Path).GetValue($Name)
}

function Test-EmptyKey {
    # Whether an interrupted run left empty keys: a class without values, a record without its digest, or its parent key.
    param([string] $Task)
    $application = '{0}\{1}' -f $script:RecordRoot, $script:Plan.Application
    $record = '{0}\{1}' -f $application, $Task
    foreach ($path in @((Get-TaskPath -Task $Task), $application, $script:RecordRoot)) {
        if (Test-BareKey -Path $path) { return $true }
    }
    (Microsoft.PowerShell.Management\Test-Path -LiteralPath $record) -and -not (Get-KeyValue -Path $record -Name 'set')
}

function Test-BareKey {
    param([string] $Path)
    if (-not (Microsoft.PowerShell.Management\Test-Path -LiteralPath $Path)) { return $false }
    if (@(Microsoft.PowerShell.Management\Get-ChildItem -LiteralPath $Path).Count) { return $false }
    -not @((Microsoft.PowerShell.Management\Get-Item -LiteralPath $Path).GetValueNames()).Count
}

function Get-RecordPath {
    param([string] $Task, [string] $Application)
    '{0}\{1}\{2}' -f $script:RecordRoot, $Application, $Task
}

function Add-Key {
    # Do not use -Force: it would clear an existing key.
    param([string] $Path)
    if (-not (Microsoft.PowerShell.Management\Test-Path -LiteralPath $Path)) { [void] (New-Item -Path $Path) }
}

function Remove-Key {
    param([string] $Path)
    if (Microsoft.PowerShell.Management\Test-Path -LiteralPath $Path) { Remove-Item -LiteralPath $Path }
}

# === unread: task classes of a guest that was not read, so the record in the guest decides.
function Get-GuestTaskClassReading {
    # Like Get-TaskClassReading, with whether the class must not be changed: it is from another application or older, or
    # has values that cannot be restored: text with variables, lists, bytes, names that cmdlets read as patterns.
    param([string] $Task, [string] $Application, [bool] $Replace)
    $live = Get-TaskClassReading -Task $Task
    $ours = Test-Same -Left $live['record'] -Right $Application
    $other = if ($live['record']) { -not $ours } else { $live['exists'] -and -not $Replace }
    $live['taken'] = [bool] $other
    foreach ($name in @(Get-TaskValueName -Task $Task)) {
        $known = $live['value:' + $name.ToLowerInvariant()] -cmatch '^(dword|qword|sz):'
        $odd = $name.ToLowerInvariant() -cmatch '^(|\(default\)|ps(object|base|adapted|extended|typenames))$|[*?[\]`]'
        if ($odd -or -not $known) { $live['taken'] = $true }
    }
    $live
}

function Save-TaskRecord {
    # Save the values from before rarms only once.
    param([string] $Task, [string] $Application, [string] $Digest)
    $live = Get-TaskClassReading -Task $Task
    $before = 'null'
    if ($live['record']) {
        $before = '' + (Get-KeyValue -Path (Get-RecordPath -Task $Task -Application $Application) -Name 'before')
    } elseif ($live['exists']) {
        $values = Get-OrdinalTable
        foreach ($name in @(Get-TaskValueName -Task $Task)) {
            $kind, $data = $live['value:' + $name.ToLowerInvariant()] -csplit ':', 2
            if ($kind -cne 'sz') { $data = [long] $data }
            $values[$name] = [ordered] @{ kind = $kind; data = $data }
        }
        $before = ConvertTo-AsciiJson -Value $values
    }
    Write-TaskRecord -Task $Task -Application $Application -Robot $script:Plan.Robot -Digest $Digest -Before $before
}

function Restore-TaskClass {
    param([string] $Task, [string] $Application)
    $path = Get-RecordPath -Task $Task -Application $Application
    # Without a digest nothing was written. Without a record everything is restored.
    if (-not (Get-KeyValue -Path $path -Name 'set')) { return }
    $before = ConvertFrom-Json -InputObject ('' + (Get-KeyValue -Path $path -Name 'before'))
    if ($null -eq $before) { return Remove-TaskClass -Task $Task }
    foreach ($name in @(Get-TaskValueName -Task $Task)) { Remove-TaskValue -Task $Task -Name $name }
    foreach ($one in $before.PSObject.Properties) {
        Write-TaskValue -Task $Task -Name $one.Name -Type ($one.Value.kind -creplace '^sz$', 'string') -Value $one.Value.data
    }
}

# === shared: files that another program may read, write, replace or delete at any time.
function Use-SharedFile {
    # Return the result of the block; retry for up to five seconds while another program uses the file. A replacement
    # removes a file's name for a moment. A file that stays away is missing, and reading it gives nothing.
    param([string] $Path, [scriptblock] $Do, [switch] $Writing)
    for ($attempt = 1; $true; $attempt++) {
        try { return & $Do } catch [System.UnauthorizedAccessException] {
            # Windows also denies access to a file that is being deleted.
            if ($attempt -ge 20) { throw }
        } catch [System.IO.IOException], [System.Management.Automation.ItemNotFoundException] {
            if (-not $Writing -and $attempt -ge 5 -and -not ([System.IO.File]::Exists($Path))) { return }
            # The codes for a full disk on Windows and Linux.
            if (@(39, 112, 28) -ccontains ($_.Exception.HResult -band 65535)) { throw ('{0}: the disk is full' -f $Path) }
            $text = '{0} cannot be used; close the program that has it open: {1}'
            if ($attempt -ge 100) { throw ($text -f $Path, $_.Exception.Message) }
        }
        Start-Sleep -Milliseconds 50
    }
}

function Read-SharedFile {
    # Return the bytes of a file as text, one character per byte; nothing if the file is missing.
    param([string] $Path)
    Use-SharedFile -Path $Path -Do {
        $stream = [System.IO.FileStream]::new($Path, 'Open', 'Read', 'ReadWrite, Delete')
        try {
            $data = [System.IO.BinaryReader]::new($stream).ReadBytes([int] $stream.Length)
            [System.Text.Encoding]::GetEncoding(28591).GetString($data)
        } finally { $stream.Dispose() }
    }
}

# === receiver: started by ssh, WinRM or a script with the installed module. It reads scripts from standard input.
function Receive-RarmsPlan {
    <#
    .SYNOPSIS
        Reads scripts from standard input, checks their SHA-256, runs the first, and returns its exit code.
    .DESCRIPTION
        Input: 8 digits with the length of a table; the table: a line of arguments, and a line `name length sha256` per file;
        then the bytes of the files. Text that ends with a dot, `3 run 45 55.`, is written next to the script; `o` means
        that nothing follows and the script continues; `s`, or the end of input, asks it to stop before its next step.
    #>
    [CmdletBinding(PositionalBinding = $false)] [OutputType([int])]
    param([Parameter(Mandatory)] [System.IO.Stream] $Source)
    $folder = ''
    $held = $null
    try {
        $ascii = [System.Text.Encoding]::ASCII
        # It reads only the given length.
        $reader = [System.IO.BinaryReader]::new($Source)
        $size = [int] $ascii.GetString($reader.ReadBytes(8))
        $data = $reader.ReadBytes($size)
        if ($size -eq 0 -or $data.Length -ne $size) { throw 'the input ended too early; run rarms apply again' }
        $table = @($ascii.GetString($data) -csplit '\n')
        $known = $table[0] -cmatch '^( |-AsJson|-Force|-Abandon|-LockTimeout [0-9]{1,6})*$'
        if (-not $known) { throw 'invalid arguments: start the receiver only with rarms apply' }
        if ($env:OS -cne 'Windows_NT') { $folder = [System.IO.Directory]::CreateTempSubdirectory('rarms-').FullName } else {
            $folder = [System.IO.Path]::GetTempPath() + 'rarms-' + [guid]::NewGuid().ToString('N')
            [void] [System.IO.Directory]::CreateDirectory($folder)
            $user = [System.Security.Principal.WindowsIdentity]::GetCurrent().User.Value
            Protect-Path -Path $folder -Descriptor ('D:P(A;OICI;FA;;;' + $user + ')') -Sections 'Access'
            $path = [System.IO.Path]::Combine($folder, 'held')
            $held = [System.IO.FileStream]::new($path, 'CreateNew', 'Write', 'Inheritable')
            Clear-LeftFolder -User $user
        }
        $main = ''
        for ($at = 1; $at -lt $table.Count; $at++) {
            $part = @($table[$at] -csplit ' ')
            $known = $part[0] -cmatch '^([a-z0-9][a-z0-9.-]*\.ps1|Rarms/Rarms\.ps[dm]1)$'
            if (-not $known) { throw 'invalid file name: start the receiver only with rarms apply' }
            $data = $reader.ReadBytes([int] $part[1])
            if ((Get-Sha256 -Data $data) -cne $part[2]) { throw ($part[0] + ' was damaged: run rarms apply again') }
            $path = [System.IO.Path]::Combine($folder, $part[0])
            [void] [System.IO.Directory]::CreateDirectory([System.IO.Path]::GetDirectoryName($path))
            [System.IO.File]::WriteAllBytes($path, $data)
            if (-not $main) { $main = $path }
        }
        $start = [System.Diagnostics.ProcessStartInfo]::new()
        $start.FileName = [System.Diagnostics.Process]::GetCurrentProcess().MainModule.FileName
        $start.Arguments = '-NoProfile -NonInteractive -ExecutionPolicy RemoteSigned -File "{0}" {1}' -f $main, $table[0]
        $start.UseShellExecute = $false
        $start.RedirectStandardInput = $true
        $start.EnvironmentVariables['RARMS_RECEIVER'] = [string] $PID
        $child = [System.Diagnostics.Process]::Start($start)
        try {
            $child.StandardInput.Close()
            $data = [byte[]]::new(4096)
            $more = $Source.ReadAsync($data, 0, $data.Length)
            $line = ''
            while (-not $child.WaitForExit(200)) {
                if ($null -eq $more -or -not $more.IsCompleted) { continue }
                $line += $ascii.GetString($data, 0, $more.Result)
                $kind = if ($more.Result -eq 0 -or $line -cmatch '(^|\.)s$') { '.stop' } else { '.next' }
                $more = if ($kind -ceq '.next' -and $line -cne 'o') { $Source.ReadAsync($data, 0, $data.Length) }
                # The rest of a line may arrive later.
                if ($kind -ceq '.next' -and $line -cnotmatch '\.$') { continue }
                Write-SharedFile -Path ($main + $kind) -Text $line
                $line = ''
            }
        } finally { Wait-Child -Child $child -Script $main }
        $child.ExitCode
    } catch {
        [Console]::Out.WriteLine('rarms-bootstrap/1 failed ' + ($_.Exception.Message -creplace '\s+', ' '))
        90
    } finally {
        # Last: a file in it asks a running child to stop.
        if ($held) { $held.Dispose() }
        try { if ($folder) { Use-SharedFile -Writing -Path $folder -Do { [System.IO.Directory]::Delete($folder, $true) } } }
        catch { [Console]::Error.WriteLine('rarms could not remove ' + $folder) }
    }
}

function Clear-LeftFolder {
    # Remove folders of interrupted receivers of this user: neither a receiver nor a script has their file open.
    param([string] $User)
    foreach ($folder in @([System.IO.Directory]::GetDirectories([System.IO.Path]::GetTempPath(), 'rarms-*'))) {
        try {
            $owner = (Get-Acl -LiteralPath $folder).GetOwner([System.Security.Principal.SecurityIdentifier]).Value
            if (@($User, 'S-1-5-32-544') -cnotcontains $owner) { continue }
            $path = [System.IO.Path]::Combine($folder, 'held')
            [System.IO.FileStream]::new($path, 'Open', 'Read', 'None').Dispose()
            [System.IO.Directory]::Delete($folder, $true)
        } catch { Write-Verbose -Message $_.Exception.Message }
    }
}

function Wait-Child {
    # Ask a script to end before its next step, and wait. End a script that does not respond.
    param([System.Diagnostics.Process] $Child, [string] $Script)
    if ($Child.HasExited) { return }
    try { Write-SharedFile -Path ($Script + '.stop') -Text 's' } catch { if (-not $Child.HasExited) { $Child.Kill() } }
    $Child.WaitForExit()
}

function Write-SharedFile {
    # Write text at this byte and flush it to disk.
    param([string] $Path, [string] $Text, [long] $From = 0)
    [byte[]] $data = [System.Text.Encoding]::ASCII.GetBytes($Text)
    $stream = Use-SharedFile -Writing -Path $Path -Do {
        [System.IO.FileStream]::new($Path, 'OpenOrCreate', 'Write', 'Read')
    }
    try {
        $stream.SetLength($From)
        $stream.Position = $From
        $stream.Write($data, 0, $data.Length)
        $stream.Flush($true)
    } finally { $stream.Dispose() }
}

function Protect-Path {
    # Set the owner explicitly: policies and ssh logons give new files different owners.
    param([string] $Path, [string] $Descriptor, [string] $Sections = 'All')
    if ($env:OS -cne 'Windows_NT') { return }
    $acl = Get-Acl -LiteralPath $Path
    $acl.SetSecurityDescriptorSddlForm($Descriptor, $Sections)
    Set-Acl -LiteralPath $Path -AclObject $acl
}

function Get-Sha256 {
    param([byte[]] $Data)
    $hash = [System.Security.Cryptography.SHA256]::Create()
    ([System.BitConverter]::ToString($hash.ComputeHash($Data, 0, $Data.Length)) -creplace '-', '').ToLowerInvariant()
}
