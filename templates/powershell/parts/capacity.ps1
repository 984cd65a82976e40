# --- part capacity: the same bytes in every script that carries it -----------------------------
# Whether the host can keep what it promises, its unmanaged machines included.

function Test-Capacity {
    # Whether all promises fit with this machine's new one: in sum, in memory, and each processor onto a logical one.
    param([string] $Name, [string] $Machine = '', [long] $Processors, [long] $Reserve, [long] $Memory)
    $own = Get-Machine -Name $Name -Machine $Machine
    $cores = Get-CoreCount -Vm $own -Processors $Processors
    $claims = @(@{ Cores = $cores; Reserve = $Reserve; Memory = $Memory })
    foreach ($vm in @(Hyper-V\Get-VM)) {
        if ([string] $vm.Id -ceq [string] $own.Id) { continue }
        $ours = (Get-Mark -Vm $vm).Application -ceq $script:Definition.Application
        $active = @('off', 'saved') -cnotcontains (ConvertTo-RunState -State $vm.State)
        $itself = -not $ours -and [string] $vm.AutomaticStartAction -cne 'Nothing'
        if (-not ($active -or $itself)) { continue }
        $cpu = Hyper-V\Get-VMProcessor -VM $vm
        $startup = [long] (Hyper-V\Get-VMMemory -VM $vm).Startup
        $cores = Get-CoreCount -Vm $vm -Processors $cpu.Count
        $claims += @{ Cores = $cores; Reserve = [long] $cpu.Reserve; Memory = $startup }
    }
    $percent = [long] 0
    $bytes = [long] 0
    $free = @(100) * $script:Definition.Cores
    foreach ($one in $claims) {
        $percent += $one.Cores * $script:Definition.ThreadsPerCore * $one.Reserve
        $bytes += $one.Memory
        if ($one.Reserve -gt 0 -and $one.Cores -gt $free.Count) { return $false }
    }
    if ($percent -gt $script:Definition.Percent -or $bytes -gt $script:Definition.Memory) { return $false }
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

function Get-CoreCount {
    # The cores that a machine takes where none runs two machines at once; elsewhere each processor counts as a core.
    param($Vm, [long] $Processors)
    if ($script:Definition.ThreadsPerCore -eq 1) { return $Processors }
    $own = (Hyper-V\Get-VMProcessor -VM $Vm).PSObject.Properties['HwThreadCountPerCore']
    # Without SMT of its own, it leaves the other thread of each core idle.
    if ($null -eq $own -or $own.Value -eq 1) { return $Processors }
    ($Processors + ($Processors -band 1)) / 2
}
# --- end of the part capacity ------------------------------------------------------------------
