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
