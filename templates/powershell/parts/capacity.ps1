# --- part capacity: the same bytes in every script that carries it -----------------------------
# Whether the host can keep what it promises, its unmanaged machines included.

function Test-Capacity {
    # Whether all promises fit with this machine's new one: in sum, in memory, and each processor onto a logical one.
    param([string] $Name, [string] $Machine = '', [long] $Processors, [long] $Reserve, [long] $Memory)
    $claims = @(@{ Processors = $Processors; Reserve = $Reserve; Memory = $Memory })
    $own = @(foreach ($vm in @(Find-Machine -Name $Name -Machine $Machine)) { [string] $vm.Id })
    foreach ($vm in @(Hyper-V\Get-VM)) {
        if ($own -ccontains [string] $vm.Id) { continue }
        $ours = (Get-Mark -Vm $vm).Application -ceq $script:Definition.Application
        $active = @('off', 'saved') -cnotcontains (ConvertTo-RunState -State $vm.State)
        $itself = -not $ours -and [string] $vm.AutomaticStartAction -cne 'Nothing'
        if (-not ($active -or $itself)) { continue }
        $cpu = Hyper-V\Get-VMProcessor -VM $vm
        $startup = [long] (Hyper-V\Get-VMMemory -VM $vm).Startup
        $claims += @{ Processors = [long] $cpu.Count; Reserve = [long] $cpu.Reserve; Memory = $startup }
    }
    $percent = [long] 0
    $bytes = [long] 0
    $free = @(100) * $script:Definition.LogicalProcessors
    foreach ($one in $claims) {
        $percent += $one.Processors * $one.Reserve
        $bytes += $one.Memory
        if ($one.Reserve -gt 0 -and $one.Processors -gt $free.Count) { return $false }
    }
    if ($percent -gt $script:Definition.Percent -or $bytes -gt $script:Definition.Memory) { return $false }
    # Machines as wide as the host lie on every processor; of the others the largest go first, each to the first place.
    $wide = 0
    $sizes = @()
    foreach ($one in $claims) {
        if ($one.Processors -eq $free.Count) { $wide += $one.Reserve }
        else { $sizes += @($one.Reserve) * $one.Processors }
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
# --- end of the part capacity ------------------------------------------------------------------
