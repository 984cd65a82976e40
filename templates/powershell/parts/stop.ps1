# --- part stop: the same bytes in every script that carries it ---------------------------------
# How a virtual machine is stopped.

function Stop-Partition {
    # Asks a guest to shut down as soon as it can be asked, forces it from half of the grace on, and turns the machine off
    # at its end. What refuses to be asked is told and waited out: a shutdown may be on its way already.
    param([long] $GraceMs)
    $vm = $script:Vm
    $begun = [DateTime]::UtcNow
    $until = $begun.AddMilliseconds($GraceMs)
    $force = $begun.AddMilliseconds($GraceMs / 2)
    # -Force gives programs five minutes and no more: a longer grace is not cut short by it.
    $last = $begun.AddMilliseconds($GraceMs - 300000)
    if ($last -gt $force) { $force = $last }
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
                if ([string] $job.State -cne 'Failed') {
                    $job
                    continue
                }
                try { [void] (Receive-Job -Job $job) } catch {
                    $message = 'its guest could not be {0}, and is waited for: {1}' -f $asked, $_.Exception.Message
                    $script:Messages += $message
                }
                Remove-Job -Job $job -Force
            })
            Start-Sleep -Milliseconds 1000
            $now = Hyper-V\Get-VM -Id $vm.Id
        }
    } finally {
        foreach ($job in $jobs) { Remove-Job -Job $job -Force }
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
