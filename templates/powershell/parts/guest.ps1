# --- part guest: the same bytes in every script that carries it --------------------------------
# Where the script of a guest may run.

function Assert-Guest {
    # In the machine that it was made for, as Hyper-V tells its guest: by its id, or by its name where the plan makes it.
    if ([IntPtr]::Size -ne 8) { Stop-Run -Detail 'this PowerShell has 32 bits: start the one that has 64' }
    $path = 'HKLM:\SOFTWARE\Microsoft\Virtual Machine\Guest\Parameters'
    if (-not (Test-Path -LiteralPath $path)) {
        Stop-Run -Detail 'this Windows is no guest, or its service vmickvpexchange never ran: start that'
    }
    $key = Get-Item -LiteralPath $path
    $id = ([string] $key.GetValue('VirtualMachineId')).ToLowerInvariant()
    $name = [string] $key.GetValue('VirtualMachineName')
    if (@($id, $name) -ccontains $script:Plan.Guest) { return }
    Stop-Run -Detail ('this is the guest of {0} ({1}), not of {2}' -f $name, $id, $script:Plan.Guest)
}
# --- end of the part guest ---------------------------------------------------------------------
