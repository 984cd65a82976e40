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
