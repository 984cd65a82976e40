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
