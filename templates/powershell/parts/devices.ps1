# --- part devices: the same bytes in every script that carries it ------------------------------
# What a machine has beside processors and memory: one call for each kind that is wanted and was not read yet.

function Get-DeviceReading {
    param([string] $Machine, [switch] $Clustered)
    Add-DeviceReading -Live (Get-MachineReading -Machine $Machine -Clustered $Clustered)
}

function Add-DeviceReading {
    param([System.Collections.IDictionary] $Live)
    $vm = $Live['vm']
    if (-not $Live['exists']) { return $Live }
    if (Test-Unread -Live $Live -Name 'secure_boot', 'boots_from') {
        $firmware = Hyper-V\Get-VMFirmware -VM $vm
        $off = [string] $firmware.SecureBoot -ceq 'Off'
        $Live['secure_boot'] = if ($off) { 'off' } else { [string] $firmware.SecureBootTemplate }
        $Live['boots_from'] = ''
        foreach ($device in @($firmware.BootOrder)) {
            if (-not $Live['boots_from']) { $Live['boots_from'] = ConvertTo-Word -Value $device.BootType }
        }
    }
    if (Test-Unread -Live $Live -Name 'adapters') { $Live['adapters'] = @(Hyper-V\Get-VMNetworkAdapter -VM $vm).Count }
    if (Test-Unread -Live $Live -Name 'disks') { $Live['disks'] = @(Hyper-V\Get-VMHardDiskDrive -VM $vm).Count }
    if (Test-Unread -Live $Live -Name 'snapshots') { $Live['snapshots'] = @(Hyper-V\Get-VMSnapshot -VM $vm).Count }
    $Live
}
# --- end of the part devices -------------------------------------------------------------------
