# --- part stop: the same bytes in every script that carries it ---------------------------------
# How a virtual machine is stopped.

function Invoke-PartitionStop {
    # Asks a running guest to shut down; after the grace, or where there is nobody to ask, the machine is turned off.
    param([long] $GraceMs)
    $vm = $script:Vm
    $until = [DateTime]::UtcNow.AddMilliseconds($GraceMs)
    if ($GraceMs -and [string] $vm.State -ceq 'Running') { [void] (Hyper-V\Stop-VM -VM $vm -Force -AsJob) }
    $state = ConvertTo-RunState -State $vm.State
    while ([DateTime]::UtcNow -lt $until -and @('running', 'busy') -ccontains $state) {
        Start-Sleep -Milliseconds 500
        $state = ConvertTo-RunState -State (Hyper-V\Get-VM -Id $vm.Id).State
    }
    if ([string] (Hyper-V\Get-VM -Id $vm.Id).State -cne 'Off') { Hyper-V\Stop-VM -VM $vm -TurnOff -Force }
}
# --- end of the part stop ----------------------------------------------------------------------
