# --- part unseen: the same bytes in every script that carries it -------------------------------
# Task classes of a guest that could not be looked into, so that its own record decides.

function Get-GuestTaskClassReading {
    # As Get-TaskClassReading, and whether the class is not ours to take: another application's, there before rarms, or with
    # values that could not be brought back: text with variables, lists, bytes, the key's own value, and names that
    # cmdlets read as patterns or that PowerShell keeps for itself.
    param([string] $Task, [string] $Application, [bool] $Replace)
    $live = Get-TaskClassReading -Task $Task
    $other = if ($live['record']) { $live['record'] -cne $Application } else { $live['exists'] -and -not $Replace }
    $live['taken'] = [bool] $other
    foreach ($name in @(Get-TaskValueName -Task $Task)) {
        $known = $live['value:' + $name.ToLowerInvariant()] -cmatch '^(dword|qword|sz):'
        $odd = $name.ToLowerInvariant() -cmatch '^(|\(default\)|ps(object|base|adapted|extended|typenames))$|[*?[\]`]'
        if ($odd -or -not $known) { $live['taken'] = $true }
    }
    $live
}

function Save-TaskRecord {
    # What was there before rarms is kept once; a record that is ours already knows it.
    param([string] $Task, [string] $Application, [string] $Digest)
    $live = Get-TaskClassReading -Task $Task
    $before = 'null'
    if ($live['record']) {
        $path = Get-RecordPath -Task $Task -Application $Application
        $before = [string] (Get-Item -LiteralPath $path).GetValue('before')
    } elseif ($live['exists']) {
        $values = [hashtable]::new($script:Ordinal)
        foreach ($name in @(Get-TaskValueName -Task $Task)) {
            $kind, $data = $live['value:' + $name.ToLowerInvariant()] -split ':', 2
            if ($kind -cne 'sz') { $data = [long] $data }
            $values[$name] = [ordered] @{ kind = $kind; data = $data }
        }
        $before = ConvertTo-AsciiJson -Value $values
    }
    Write-TaskRecord -Task $Task -Application $Application -Digest $Digest -Before $before
}

function Restore-TaskClass {
    # Brings back what the record says was there before rarms: no class, or exactly these values.
    param([string] $Task, [string] $Application)
    $path = Get-RecordPath -Task $Task -Application $Application
    # Without its digest nothing was written yet; without the record all is back.
    if (-not (Test-Path -LiteralPath $path) -or -not (Get-Item -LiteralPath $path).GetValue('set')) { return }
    $before = ConvertFrom-Json -InputObject ([string] (Get-Item -LiteralPath $path).GetValue('before'))
    if ($null -eq $before) {
        Remove-TaskClass -Task $Task
        return
    }
    foreach ($name in @(Get-TaskValueName -Task $Task)) { Remove-TaskValue -Task $Task -Name $name }
    foreach ($one in $before.PSObject.Properties) {
        $type = $one.Value.kind -creplace '^sz$', 'string'
        Write-TaskValue -Task $Task -Name $one.Name -Type $type -Value $one.Value.data
    }
}
# --- end of the part unseen --------------------------------------------------------------------
