# --- part host: the same bytes in every script that carries it ---------------------------------
# Whether a script runs where it was made for, and whether a reserve has any effect there.

function Assert-VmHost {
    # Is it this host, may we, and does a reserve have any effect here?
    $plan = $script:Plan
    if ([IntPtr]::Size -ne 8) { Stop-Run -Detail 'this PowerShell has 32 bits: start the one that has 64' }
    # Where 7 does not load Hyper-V itself, its objects come through 5.1 and are none that cmdlets take.
    if ([string] (Get-Command -Name 'Hyper-V\Get-VM').CommandType -cne 'Cmdlet') {
        Stop-Run -Detail 'this PowerShell does not load Hyper-V itself: start powershell.exe'
    }
    $vmHost = Hyper-V\Get-VMHost
    if ($vmHost.Name -ne $plan.Computer) {
        Stop-Run -Detail ('this is {0}, the plan is for {1}' -f $vmHost.Name, $plan.Computer)
    }
    if ($plan.Identity -and (Get-HostIdentity) -cne $plan.Identity) {
        Stop-Run -Detail ('this {0} is not the one that the plan was made for: make a plan for this one' -f $vmHost.Name)
    }
    # An undo gives back, and promises nothing.
    if ($plan.Run -ceq 'undo') { return }
    if ($vmHost.LogicalProcessorCount -ne $plan.LogicalProcessors) {
        Stop-Run -Detail ('it has {0} logical processors now' -f $vmHost.LogicalProcessorCount)
    }
    if ($plan.AcceptScheduler) { return }
    if (Test-RootScheduler) {
        throw 'the hypervisor runs its root scheduler, under which reserve, limit and weight have no effect'
    }
}

function Get-HostIdentity {
    # What tells this Windows from every other, as observe.ps1 works it out.
    $id = [string] (Get-Item -LiteralPath 'HKLM:\SOFTWARE\Microsoft\Cryptography').GetValue('MachineGuid')
    $data = [System.Text.Encoding]::ASCII.GetBytes('rarms host ' + $id.Trim().ToLowerInvariant())
    (Get-Sha256 -Data $data).Substring(0, 32)
}

function Test-RootScheduler {
    # Event 2 of the hypervisor says 4 for root. Where it has left the log: a client Windows has root, of a server it is
    # not known, which the plan told.
    try {
        $filter = @{ ProviderName = 'Microsoft-Windows-Hyper-V-Hypervisor'; ID = 2 }
        $found = @(Get-WinEvent -FilterHashtable $filter -MaxEvents 1)
        return [int] $found[0].Properties[0].Value -eq 4
    } catch {
        Write-Verbose -Message $_.Exception.Message
    }
    $windows = Get-Item -LiteralPath 'HKLM:\SOFTWARE\Microsoft\Windows NT\CurrentVersion'
    [string] $windows.GetValue('InstallationType') -ceq 'Client'
}
# --- end of the part host ----------------------------------------------------------------------
