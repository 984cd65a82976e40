# --- part host: the same bytes in every script that carries it ---------------------------------
# Whether a script runs where it was made for, and whether a reserve has any effect there.

function Assert-VmHost {
    # Is it this host, may we, and does a reserve have any effect here?
    $plan = $script:Definition
    $vmHost = Hyper-V\Get-VMHost
    if ($vmHost.Name -ne $plan.Computer) {
        Exit-Refused -Detail ('this is {0}, the plan is for {1}' -f $vmHost.Name, $plan.Computer)
    }
    if ($vmHost.LogicalProcessorCount -ne $plan.LogicalProcessors) {
        Exit-Refused -Detail ('it has {0} logical processors now' -f $vmHost.LogicalProcessorCount)
    }
    if ($plan.AcceptScheduler) { return }
    $scheduler = Get-SchedulerType
    if ($scheduler -ceq 'root') {
        throw 'the hypervisor runs its root scheduler, under which reserve, limit and weight have no effect'
    }
    if ($scheduler -ceq 'unknown') {
        throw 'the scheduler type is not known (its event has left the log): restart the host, or accept the finding'
    }
}

function Get-SchedulerType {
    # Event 2 of the hypervisor: 1 and 2 classic, 3 core, 4 root. A client Windows always has root.
    $types = @{ 1 = 'classic'; 2 = 'classic'; 3 = 'core'; 4 = 'root' }
    try {
        $filter = @{ ProviderName = 'Microsoft-Windows-Hyper-V-Hypervisor'; ID = 2 }
        $found = @(Get-WinEvent -FilterHashtable $filter -MaxEvents 1)
        $type = [int] $found[0].Properties[0].Value
        if ($types.Contains($type)) { return $types[$type] }
    } catch {
        Write-Verbose -Message $_.Exception.Message
    }
    $windows = Get-Item -LiteralPath 'HKLM:\SOFTWARE\Microsoft\Windows NT\CurrentVersion'
    if ([string] $windows.GetValue('InstallationType') -ceq 'Client') { return 'root' }
    'unknown'
}
# --- end of the part host ----------------------------------------------------------------------
