# --- part stop: the same bytes in every script that carries it ---------------------------------
# How a virtual machine is stopped.

function Invoke-PartitionStop {
    # Asks a guest to shut down as soon as it can be asked; at the end of the grace the machine is turned off.
    param([long] $GraceMs)
    $vm = $script:Vm
    $begun = [DateTime]::UtcNow
    $until = $begun.AddMilliseconds($GraceMs)
    # -Force gives programs five minutes and no more: a longer grace begins without it.
    $force = $begun.AddMilliseconds($GraceMs - 300000)
    $asked = $null
    $forced = $null
    $now = $vm
    while ([DateTime]::UtcNow -lt $until -and @('running', 'busy') -ccontains (ConvertTo-RunState -State $now.State)) {
        if ($null -ne $forced -and [string] $forced.State -ceq 'Failed') {
            Receive-Job -Job $forced
            throw 'its guest could not be asked to shut down'
        }
        if ($null -eq $forced -and [string] $now.State -ceq 'Running' -and (Test-ShutdownService -Vm $now)) {
            if (-not ([DateTime]::UtcNow -lt $force)) { $forced = Hyper-V\Stop-VM -VM $vm -Force -AsJob }
            elseif ($null -eq $asked) { $asked = Hyper-V\Stop-VM -VM $vm -AsJob }
        }
        Start-Sleep -Milliseconds 500
        $now = Hyper-V\Get-VM -Id $vm.Id
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
